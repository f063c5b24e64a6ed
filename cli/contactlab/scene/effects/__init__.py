"""Effects: what each is, which of them a run calls for, and how the others are left out."""

from contactlab.scene.effects.effect import (
    NOT_IN_MODEL,
    Effect,
    EffectMjcf,
    EffectRequest,
    EffectState,
    ModelFacts,
    RunState,
)
from contactlab.scene.effects.effect_choice import (
    choose,
    find_facts,
    is_straight,
    leave_out,
    left_uncompiled,
    remove,
)
from contactlab.scene.effects.effect_table import EFFECTS

__all__ = [
    "EFFECTS",
    "NOT_IN_MODEL",
    "Effect",
    "EffectMjcf",
    "EffectRequest",
    "EffectState",
    "ModelFacts",
    "RunState",
    "choose",
    "find_facts",
    "is_straight",
    "leave_out",
    "left_uncompiled",
    "remove",
]
