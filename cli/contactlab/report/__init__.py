"""Stores to pages and pictures, without the engine."""

from contactlab.report.report_data import DEFAULT_TRACES, MOST_BYTES, PageRequest, WrittenPage
from contactlab.report.vega_rendering import FORMATS
from contactlab.report.write_report import write_figures, write_page

__all__ = [
    "DEFAULT_TRACES",
    "FORMATS",
    "MOST_BYTES",
    "PageRequest",
    "WrittenPage",
    "write_figures",
    "write_page",
]
