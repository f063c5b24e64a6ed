"""How effects are read from a model and written into it, settings and MJCF."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np

from contactlab.scene.effects.effect import EffectMjcf, RunState
from contactlab.scene.effects.proofs import most_condim
from contactlab.scene.engine_flags import read_flag, write_flags
from contactlab.scene.model_settings import read_option, write_option
from contactlab.scene.settings import Settings


@dataclass(frozen=True)
class FlagSwitch:
    """An effect that is one of MuJoCo's flags."""

    flag: str
    settings: tuple[str, ...] = ()

    def is_on(self, run: RunState) -> bool:
        """Say whether the flag is set."""
        return read_flag(run.model, self.flag)

    def write(self, model: mujoco.MjModel, *, on: bool) -> None:
        """Set the flag, in place."""
        write_flags(model, {self.flag: on})

    def mjcf(self, *, on: bool) -> EffectMjcf:
        """Return the attribute of <flag>."""
        return EffectMjcf(flags={self.flag: on})


@dataclass(frozen=True)
class CondimSwitch:
    """A friction effect, on where contacts have enough dimensions.

    Contacts take the larger condim of their two geoms, so that a bound on each geom bounds the
    contact.

    Attributes:
        least: dimensions that the effect needs.
        most: dimensions that are left without it.
    """

    least: int
    most: int
    settings: tuple[str, ...] = ("condim",)

    def is_on(self, run: RunState) -> bool:
        """Say whether any contact could have the dimensions."""
        return most_condim(run.model) >= self.least

    def write(self, model: mujoco.MjModel, *, on: bool) -> None:
        """Bound the dimensions of every contact, in place."""
        bound, value = (np.maximum, self.least) if on else (np.minimum, self.most)
        for field_name in ("geom_condim", "pair_dim", "flex_condim"):
            array = getattr(model, field_name)
            array[:] = bound(array, value)

    def mjcf(self, *, on: bool) -> EffectMjcf:
        """Return the bound on condim."""
        return EffectMjcf(condim=self.least if on else self.most)


@dataclass(frozen=True)
class OptionSwitch:
    """An effect that is a matter of options.

    Attributes:
        has: says whether settings have the effect.
        off: settings that turn it off.
        on: settings that turn it on, where it is off; none if no single value does.
    """

    has: Callable[[Settings], bool]
    off: Mapping[str, object]
    on: Mapping[str, object] = field(default_factory=dict[str, object])

    @property
    def settings(self) -> tuple[str, ...]:
        """The options."""
        return tuple(self.off)

    def is_on(self, run: RunState) -> bool:
        """Say whether the options of a run's model have the effect."""
        return self.has(Settings({name: read_option(run.model, name) for name in self.off}))

    def write_settings(self, settings: Settings, *, on: bool) -> None:
        """Turn the effect on or off in resolved settings; settings that have it so stay."""
        if self.has(settings) != on:
            settings.update(self.on if on else self.off)

    def write(self, model: mujoco.MjModel, *, on: bool) -> None:
        """Write the options, in place."""
        for name, value in (self.on if on else self.off).items():
            write_option(model, name, value)

    def mjcf(self, *, on: bool) -> EffectMjcf:
        """Return the attributes of <option>."""
        values = self.on if on else self.off
        return EffectMjcf(options={name: _text(value) for name, value in values.items()})


@dataclass(frozen=True)
class TendonSwitch:
    """Tendons: idle ones are left out before a model is compiled, others lose what acts."""

    settings: tuple[str, ...] = ()

    def is_on(self, run: RunState) -> bool:
        """Say whether the model has tendons."""
        return run.facts.tendons > 0

    def write(self, model: mujoco.MjModel, *, on: bool) -> None:
        """Leave tendons nothing that acts, in place."""
        for coefficient in ("stiffness", "damping", "frictionloss", "armature", "limited"):
            if not on and hasattr(model, f"tendon_{coefficient}"):
                getattr(model, f"tendon_{coefficient}")[:] = 0

    def mjcf(self, *, on: bool) -> EffectMjcf:
        """Return what to do with the model's tendons."""
        comment = (
            "in <tendon>, set no stiffness, damping, friction loss, armature or range; "
            "remove what no actuator, equality or sensor refers to"
        )
        return EffectMjcf(comment=None if on else comment)


@dataclass(frozen=True)
class RecordingSwitch:
    """Sensors, which are left out before a model is compiled.

    Attributes:
        present: says whether they are there.
        comment: how to leave them out of a model by hand, where it has them.
    """

    present: Callable[[RunState], bool]
    comment: str | None = None
    settings: tuple[str, ...] = ()

    def is_on(self, run: RunState) -> bool:
        """Say whether they were compiled."""
        return self.present(run)

    def write(self, model: mujoco.MjModel, *, on: bool) -> None:
        """Do nothing: a compiled model keeps its sensors."""

    def mjcf(self, *, on: bool) -> EffectMjcf:
        """Return what to do with the model's sensors."""
        return EffectMjcf(comment=None if on else self.comment)


def _text(value: object) -> str:
    if isinstance(value, tuple):
        return " ".join(f"{part:g}" for part in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
