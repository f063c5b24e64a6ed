"""What accuracy costs in time: fronts, orders, floors and a recommendation, from stored runs."""

from contactlab.pareto.analysis import ToleranceTable, analyse, tolerance_table
from contactlab.pareto.configuration_export import MjcfLines, mjcf_lines, recommended_sweep
from contactlab.pareto.configurations import ESTIMATES
from contactlab.pareto.criteria import MODELLING, Criteria, chosen_error, find_store
from contactlab.pareto.drawing import check_figure, draw, save_figure, specify
from contactlab.pareto.pareto import EQUALLY_FAST, SAFE_MARGIN

__all__ = [
    "EQUALLY_FAST",
    "ESTIMATES",
    "MODELLING",
    "SAFE_MARGIN",
    "Criteria",
    "MjcfLines",
    "ToleranceTable",
    "analyse",
    "check_figure",
    "chosen_error",
    "draw",
    "find_store",
    "mjcf_lines",
    "recommended_sweep",
    "save_figure",
    "specify",
    "tolerance_table",
]
