"""The chart of a trade-off as a file; needs the extra `figures`."""

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from contactlab.errors import OutputError
from contactlab.schema.tradeoff_report import TradeoffReport

if TYPE_CHECKING:
    import altair as alt

SUFFIXES = (".png", ".svg")
_LIBRARIES = ("altair", "vl_convert")
_SCALE = 2.0


def check_figure(path: Path) -> None:
    """Check that a figure can be drawn, before anything is run; an OutputError says why not."""
    if path.suffix not in SUFFIXES:
        raise OutputError(f"{path}: write a name that ends in {' or '.join(SUFFIXES)}")
    if not all(find_spec(library) for library in _LIBRARIES):
        raise OutputError(
            "figures need Altair and vl-convert; install them with "
            "`pip install 'contactlab[figures]'`"
        )
    if not path.parent.is_dir():
        raise OutputError(f"cannot write {path}: no folder {path.parent}")


def save_figure(chart: "alt.TopLevelMixin", path: Path) -> None:
    """Write a chart as a .png or .svg file; an OutputError if it cannot be written."""
    try:
        chart.save(path, scale_factor=_SCALE)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}") from error


def draw(report: TradeoffReport, path: Path) -> None:
    """Draw a report as a .png or .svg file; an OutputError says why it cannot be."""
    check_figure(path)
    from contactlab.pareto.tradeoff_chart import specification  # noqa: PLC0415 - needs the extra

    save_figure(specification(report), path)
