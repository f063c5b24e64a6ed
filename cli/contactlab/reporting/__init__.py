"""A store as a page or as figures, without the engine."""

from contactlab.reporting.report_data import PageRequest, WrittenPage
from contactlab.reporting.write_report import FORMATS, write_figures, write_page

__all__ = [
    "FORMATS",
    "PageRequest",
    "WrittenPage",
    "write_figures",
    "write_page",
]
