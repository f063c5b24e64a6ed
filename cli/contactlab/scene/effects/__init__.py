"""Effects: what each is, which of them a run calls for, and how the others are left out."""

from contactlab.scene.effects.choosing import choose, fold, leave_out
from contactlab.scene.effects.effect import (
    NOT_IN_MODEL,
    Effect,
    EffectRequest,
    EffectState,
    ModelFacts,
    RunState,
)
from contactlab.scene.effects.facts import find_facts
from contactlab.scene.effects.removal import left_uncompiled, remove
from contactlab.scene.effects.straight import is_straight
from contactlab.scene.effects.table import COMPILED, EFFECTS
from contactlab.scene.effects.turning import FRICTIONS

__all__ = [
    "COMPILED",
    "EFFECTS",
    "FRICTIONS",
    "NOT_IN_MODEL",
    "Effect",
    "EffectRequest",
    "EffectState",
    "ModelFacts",
    "RunState",
    "choose",
    "find_facts",
    "fold",
    "is_straight",
    "leave_out",
    "left_uncompiled",
    "remove",
]
