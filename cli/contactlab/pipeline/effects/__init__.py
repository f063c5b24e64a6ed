"""Which effects a scene needs: ablation, the smallest set, and its verification."""

from contactlab.pipeline.effects.ablation import FRESH_SEEDS, Ablation
from contactlab.pipeline.effects.figure import draw
from contactlab.pipeline.effects.question import Question, ask

__all__ = ["FRESH_SEEDS", "Ablation", "Question", "ask", "draw"]
