"""Which effects a scene needs: ablation, the smallest set, and its verification."""

from contactlab.studies.effects.ablation import FRESH_SEEDS, Ablation
from contactlab.studies.effects.figure import draw
from contactlab.studies.effects.question import Question, ask

__all__ = [
    "FRESH_SEEDS",
    "Ablation",
    "Question",
    "ask",
    "draw",
]
