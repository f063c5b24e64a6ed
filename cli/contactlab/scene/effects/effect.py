"""What an effect is, and what is known of a run before it starts."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import mujoco

from contactlab.scene.setting_values import Settings
from contactlab.schema.coverage import Feature

NOT_IN_MODEL = "not in the model"
"""The reason of an effect that a model does not have."""

Kind = Literal["physical", "numerical", "recording"]


@dataclass(frozen=True)
class ModelFacts:
    """What a compiled structure decides about its effects, whatever a run sets.

    Attributes:
        kinds: pairs of geom types, the smaller first, among geoms that MuJoCo's filters let touch;
            None where that is not known.
        level: whether only spheres, free and alone with their mass at their centres, and fixed
            horizontal planes can touch.
        turning: whether a body that can touch another can turn.
        crowded: whether a body has more than one geom.
        sensors: how many sensors the model has that do not record the run.
        tendons: how many tendons it has; 0 if they were not compiled.
        idle_tendons: whether its tendons can do nothing but be measured.
        energy: whether energies are recorded.
    """

    kinds: frozenset[tuple[int, int]] | None
    level: bool
    turning: bool
    crowded: bool
    sensors: int
    tendons: int
    idle_tendons: bool
    energy: bool


@dataclass(frozen=True)
class RunState:
    """A run as the proofs see it, before it starts.

    Attributes:
        model: the run's model, its settings written.
        facts: what its structure decides.
        straight: whether nothing turns or moves sideways at the start, or is pushed to.
    """

    model: mujoco.MjModel
    facts: ModelFacts
    straight: bool


Proof = Callable[[RunState], str | None]
"""Returns why nothing changes in a run without an effect; None where that is not proven."""


def never(_: RunState) -> str | None:
    """Prove nothing."""
    return None


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
