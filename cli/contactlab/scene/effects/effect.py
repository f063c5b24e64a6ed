"""What an effect is, and ways to turn one on and off: by flags, options, or contact dimensions."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import mujoco
import numpy as np

from contactlab.scene.effects.proofs import Proof, RunState, most_condim, never
from contactlab.scene.model_options import read_flag, read_option, write_flags, write_option
from contactlab.scene.setting_values import Settings
from contactlab.schema.coverage import Feature

NOT_IN_MODEL = "not in the model"
"""The reason of an effect that a model does not have."""

Kind = Literal["physical", "numerical", "recording"]
_REMOVE_TENDONS = (
    "in <tendon>, set no stiffness, damping, friction loss, armature or range; "
    "remove what no actuator, equality or sensor refers to"
)


@dataclass(frozen=True)
class EffectRequest:
    """The effects that a run requests.

    Attributes:
        requested: effects that the sweep or the scene switches by name.
        changed: settings that the sweep sets; no effect is left out that would overwrite them.
        auto: whether to leave out what provably changes nothing.
    """

    requested: Mapping[str, bool]
    changed: frozenset[str]
    auto: bool


@dataclass(frozen=True)
class EffectMjcf:
    """What turns an effect on or off in MJCF.

    Attributes:
        options: attributes of <option>.
        flags: attributes of <flag>.
        condim: bound on every contact's dimensions: at least, to turn on; at most, to turn off.
        comment: what to edit by hand, where no attribute does it.
    """

    options: Mapping[str, str] = field(default_factory=dict[str, str])
    flags: Mapping[str, bool] = field(default_factory=dict[str, bool])
    condim: int | None = None
    comment: str | None = None


@dataclass(frozen=True)
class Switch:
    """How an effect is read from a model, and how it is turned on or off.

    Attributes:
        is_on: returns whether a run's model has it.
        write: turns it on or off in a compiled model, in place.
        mjcf: returns what turns it on or off in MJCF.
        flag: MuJoCo's flag, if it is one.
        settings: the settings that it overwrites.
        fold: turns it on or off in resolved settings; None where settings do not carry it.
    """

    is_on: Callable[[RunState], bool]
    write: Callable[[mujoco.MjModel, bool], None]
    mjcf: Callable[[bool], EffectMjcf]
    flag: str | None = None
    settings: tuple[str, ...] = ()
    fold: Callable[[Settings, bool], None] | None = None


@dataclass(frozen=True)
class Effect:
    """One physical or numerical feature that can be on or off.

    Attributes:
        name: its name in sweeps, scenes and records.
        kind: whether it is part of the physics, of how it is computed, or of what is recorded.
        what: what it is.
        switch: how it is turned on and off.
        called_by: what in a scene needs it.
        unused: a proof that nothing changes without it.
        on: axis values with which a study turns it on; none where studies do not.
        off: axis values with which a study turns it off; its own axis, if left out.
        studied: whether studies change it; some effects define the model itself.
        feature: what runs must exercise to show what it does; None where every run does.
    """

    name: str
    kind: Kind
    what: str
    switch: Switch
    called_by: str
    unused: Proof = never
    on: Mapping[str, object] = field(default_factory=dict[str, object])
    off: Mapping[str, object] = field(default_factory=dict[str, object])
    studied: bool = True
    feature: Feature | None = None


@dataclass(frozen=True, slots=True)
class EffectState:
    """Whether an effect is on in a run, and why."""

    on: bool
    reason: str


def by_flag(name: str) -> Switch:
    """Return the switch of one of MuJoCo's flags."""
    return Switch(
        is_on=lambda run: read_flag(run.model, name),
        write=lambda model, on: write_flags(model, {name: on}),
        mjcf=lambda on: EffectMjcf(flags={name: on}),
        flag=name,
    )


def by_condim(least: int, most: int) -> Switch:
    """Return the switch of a friction effect, which is on where contacts have enough dimensions.

    Contacts take the larger condim of their two geoms, so that a bound on each geom bounds the
    contact: to the least that the effect needs, or the most that are left without it.
    """

    def write(model: mujoco.MjModel, on: bool) -> None:
        bound, value = (np.maximum, least) if on else (np.minimum, most)
        for name in ("geom_condim", "pair_dim", "flex_condim"):
            array = getattr(model, name)
            array[:] = bound(array, value)

    return Switch(
        is_on=lambda run: most_condim(run.model) >= least,
        write=write,
        mjcf=lambda on: EffectMjcf(condim=least if on else most),
        settings=("condim",),
    )


def by_options(
    off: Mapping[str, object],
    on: Mapping[str, object],
    is_on: Callable[[Settings], bool] | None = None,
) -> Switch:
    """Return the switch of an effect that is a matter of options.

    Args:
        off: settings that turn it off.
        on: settings that turn it on where it is off; empty if none does by itself.
        is_on: returns whether settings have it; if left out, all but those that turn it off have.
    """
    values = {True: on, False: off}
    has = is_on or (lambda settings: any(settings[name] != off[name] for name in off))

    def write(model: mujoco.MjModel, state: bool) -> None:
        for name, value in values[state].items():
            write_option(model, name, value)

    def fold(settings: Settings, state: bool) -> None:
        # Settings in this state already are kept: RK4 is as explicit as Euler.
        if has(settings) != state:
            settings.update(values[state])

    return Switch(
        is_on=lambda run: has(Settings({name: read_option(run.model, name) for name in off})),
        write=write,
        mjcf=lambda state: EffectMjcf({name: _text(each) for name, each in values[state].items()}),
        settings=tuple(off),
        fold=fold,
    )


def by_tendons() -> Switch:
    """Return the switch of tendons: idle ones are not compiled, others lose their coefficients."""

    def write(model: mujoco.MjModel, on: bool) -> None:
        for name in ("stiffness", "damping", "frictionloss", "armature", "limited"):
            if not on and hasattr(model, f"tendon_{name}"):
                getattr(model, f"tendon_{name}")[:] = 0

    return Switch(
        is_on=lambda run: run.facts.tendons > 0,
        write=write,
        mjcf=lambda on: EffectMjcf(comment=None if on else _REMOVE_TENDONS),
    )


def by_compiling(compiled: Callable[[RunState], bool], remove: str | None = None) -> Switch:
    """Return the switch of what is compiled or not; `remove` says how to remove it by hand."""
    return Switch(
        is_on=compiled,
        write=lambda *_: None,
        mjcf=lambda on: EffectMjcf(comment=None if on else remove),
    )


def _text(value: object) -> str:
    if isinstance(value, tuple):
        return " ".join(f"{part:g}" for part in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
