"""What accuracy costs in time: fronts, orders, floors and a recommendation, from stored runs."""

from contactlab.tradeoff.choice import EQUALLY_FAST, SAFE_MARGIN
from contactlab.tradeoff.figure import check_figure, draw, save_figure, specify
from contactlab.tradeoff.mjcf import Lines, mjcf_lines
from contactlab.tradeoff.palette import COLOURS, INK, LETTERS, REST, SHAPES
from contactlab.tradeoff.question import MODELLING, Question, chosen_error
from contactlab.tradeoff.report import tradeoff
from contactlab.tradeoff.rerun import rerun_sweep
from contactlab.tradeoff.runs import ESTIMATES

__all__ = [
    "COLOURS",
    "EQUALLY_FAST",
    "ESTIMATES",
    "INK",
    "LETTERS",
    "MODELLING",
    "REST",
    "SAFE_MARGIN",
    "SHAPES",
    "Lines",
    "Question",
    "check_figure",
    "chosen_error",
    "draw",
    "mjcf_lines",
    "rerun_sweep",
    "save_figure",
    "specify",
    "tradeoff",
]
