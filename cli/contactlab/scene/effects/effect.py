"""Effects, and ways to turn one on and off: by flags, options, or contact dimensions."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from contactlab.scene.effects.proofs import Proof, RunState, most_condim, proof_of_absence
from contactlab.scene.model_edits import read_flag, read_option, write_flags, write_option
from contactlab.schema.coverage import Feature
from contactlab.schema.setting_values import Settings

NOT_IN_MODEL = "not in the model"  # reason for an effect that a model does not have

Kind = Literal["physical", "numerical", "recording"]


@dataclass(frozen=True)
class EffectRequest:
    """The effects that a run requests, switched by name by the sweep or the scene.

    An effect is kept if leaving it out would overwrite a changed setting. If `auto`, other effects
    are left out if they provably change nothing.
    """

    requested: Mapping[str, bool]
    changed_settings: frozenset[str]
    auto: bool


@dataclass(frozen=True)
class Switch:
    """Functions that read an effect from a model, and turn it on or off."""

    is_on: Callable[[RunState], bool]  # returns whether a run's model has it
    # Turns it on or off in a compiled model, in place.
    write: Callable[[mujoco.MjModel, bool], None]
    flag: str | None = None  # MuJoCo's flag, if it is one
    settings: tuple[str, ...] = ()  # the settings that it overwrites
    # Turns it on or off in resolved settings; returns whether they carry it.
    fold: Callable[[Settings, bool], bool] = lambda _settings, _on: False


@dataclass(frozen=True)
class Effect:
    """One physical or numerical feature that can be on or off."""

    name: str  # its name in sweeps, scenes and records
    kind: Kind  # whether it belongs to the physics, to the numerics, or to the recording
    what: str  # its description
    switch: Switch  # the functions that turn it on and off
    called_by: str = ""  # the part of a scene that needs it
    unused: Proof = proof_of_absence  # a proof that nothing changes without it
    # The feature that runs must exercise to show the effect; None if every run shows it.
    feature: Feature | None = None

    def needed_by(
        self,
        called_by: str,
        unused: Proof = proof_of_absence,
        feature: Feature | None = None,
    ) -> "Effect":
        """Return it with its need."""
        return replace(self, called_by=called_by, unused=unused, feature=feature)


@dataclass(frozen=True, slots=True)
class EffectState:
    """Whether an effect is on in a run, and why."""

    on: bool
    reason: str


def flag_switch(name: str) -> Switch:
    """Return the switch of one of MuJoCo's flags."""
    return Switch(
        lambda run: read_flag(run.model, name),
        lambda model, on: write_flags(model, {name: on}),
        flag=name,
    )


def condim_switch(least: int, most: int) -> Switch:
    """Return the switch of a friction effect, which is on if contacts have enough dimensions.

    Contacts take the larger condim of their two geoms, so a bound on each geom bounds the contact.
    The bound is the least condim that the effect needs, or the most that remain without it.
    """

    def write(model: mujoco.MjModel, on: bool) -> None:
        bound, value = (np.maximum, least) if on else (np.minimum, most)
        for name in ("geom_condim", "pair_dim", "flex_condim"):
            array = getattr(model, name)
            array[:] = bound(array, value)

    return Switch(lambda run: most_condim(run.model) >= least, write, settings=("condim",))


def option_switch(
    off: Mapping[str, object],
    on: Mapping[str, object],
    is_on: Callable[[Settings], bool] | None = None,
) -> Switch:
    """Return the switch of an effect that options control.

    The `off` settings turn it off, and the `on` settings, if not empty, turn it on. Without
    `is_on`, all settings have the effect except those that turn it off.
    """
    values = {True: on, False: off}
    has = is_on or (lambda settings: any(settings[name] != off[name] for name in off))

    def write(model: mujoco.MjModel, state: bool) -> None:
        for name, value in values[state].items():
            write_option(model, name, value)

    def fold(settings: Settings, state: bool) -> bool:
        # Settings that are in this state already are kept: RK4 is as explicit as Euler.
        if has(settings) != state:
            settings.update(values[state])
        return True

    return Switch(
        lambda run: has(Settings({name: read_option(run.model, name) for name in off})),
        write,
        settings=tuple(off),
        fold=fold,
    )


def compile_switch(compiled: Callable[[RunState], bool], *fields: str) -> Switch:
    """Return the switch of an effect that is compiled into the model or omitted.

    If it is compiled although it is off, the named fields of the model are set to zero.
    """

    def write(model: mujoco.MjModel, on: bool) -> None:
        for name in fields:
            if not on and hasattr(model, name):
                getattr(model, name)[:] = 0

    return Switch(compiled, write)
