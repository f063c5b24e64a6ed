"""What an effect is, and what is known of a run before it starts."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import mujoco

NOT_IN_MODEL = "not in the model"
"""The reason of an effect that a model does not have."""

Kind = Literal["physical", "numerical", "recording"]


@dataclass(frozen=True)
class ModelFacts:
    """What one structure of a scene decides about its effects, whatever a run sets.

    Attributes:
        kinds: pairs of geom types, the smaller first, among geoms that the engine's filters let
            touch; None where that is not known.
        level: whether all that can touch are spheres, turning about their own centres and loose
            from all else, and level planes that never move.
        turning: whether a body that can touch another can turn.
        crowded: whether a body has more than one geom.
        sensors: how many sensors the model has that do not record the run.
        tendons: how many tendons it has; 0 if they were left out.
        idle_tendons: whether none of them can do anything but be measured.
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
    """A run as far as the static analysis looks at it.

    Attributes:
        model: the run's model, its settings written.
        facts: what its structure decides.
        straight: whether at the start nothing turns or moves sideways, and nothing pushes that way.
    """

    model: mujoco.MjModel
    facts: ModelFacts
    straight: bool


@dataclass(frozen=True)
class EffectRequest:
    """What is asked of a run's effects.

    Attributes:
        asked: effects that the sweep or the scene switches itself.
        changed: settings that the sweep sets; nothing is left out that would write over them.
        auto: whether to leave out what provably changes nothing.
    """

    asked: Mapping[str, bool]
    changed: frozenset[str]
    auto: bool


@dataclass(frozen=True)
class Effect:
    """One physical or numerical feature that can be on or off.

    Attributes:
        name: its name in sweeps, scenes and records.
        kind: part of the physics, of how it is computed, or of what is recorded.
        what: what it is.
        switch: how the engine is told to leave it out.
        called_by: what in a scene calls for it.
        changes: whether it can change a trajectory by more than rounding.
        is_on: reads a situation.
        turn: writes a model, in place; None where it is decided before the model is compiled, or
            through a setting.
        unused: a proof that nothing changes without it, in words; None without one.
        touches: settings that `turn` would write over.
    """

    name: str
    kind: Kind
    what: str
    switch: str
    called_by: str
    changes: bool
    is_on: Callable[[RunState], bool]
    turn: Callable[[mujoco.MjModel, bool], None] | None
    unused: Callable[[RunState], str | None]
    touches: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class EffectState:
    """Whether an effect is on in a run, and why."""

    on: bool
    reason: str
