"""Which effects a scene needs: ablation, the smallest set, and its verification."""

from contactlab.studies.effects.ablation import FRESH_SEEDS, Ablation
from contactlab.studies.effects.effects_request import EffectsRequest, ask
from contactlab.studies.effects.figure import draw

__all__ = [
    "FRESH_SEEDS",
    "Ablation",
    "EffectsRequest",
    "ask",
    "draw",
]
