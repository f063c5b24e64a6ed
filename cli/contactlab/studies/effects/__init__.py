"""Which effects a scene needs: ablation, the smallest set, and its verification."""

from contactlab.studies.effects.ablation import FRESH_SEEDS, REPORT, run
from contactlab.studies.effects.effects_request import EffectsRequest

__all__ = [
    "FRESH_SEEDS",
    "REPORT",
    "EffectsRequest",
    "run",
]
