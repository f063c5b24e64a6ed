"""Stores to pages and pictures, without the engine."""

from contactlab.report.asking import DEFAULT_TRACES, MOST_BYTES, PageAsk, Written
from contactlab.report.drawing import FORMATS
from contactlab.report.writing import write_figures, write_page

__all__ = [
    "DEFAULT_TRACES",
    "FORMATS",
    "MOST_BYTES",
    "PageAsk",
    "Written",
    "write_figures",
    "write_page",
]
