"""A store as a page or as figures, without the engine."""

from contactlab.report.report_data import DEFAULT_TRACES, PageRequest, WrittenPage
from contactlab.report.write_report import FORMATS, write_figures, write_page

__all__ = [
    "DEFAULT_TRACES",
    "FORMATS",
    "PageRequest",
    "WrittenPage",
    "write_figures",
    "write_page",
]
