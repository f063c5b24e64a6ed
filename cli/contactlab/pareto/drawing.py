"""The chart of a trade-off as a file; needs the extra `figures`."""

from pathlib import Path
from typing import TYPE_CHECKING

from contactlab.errors import OutputError, optional
from contactlab.schema.tradeoff_report import TradeoffReport
from contactlab.store.atomic_files import write_errors

if TYPE_CHECKING:
    import altair as alt

SUFFIXES = (".png", ".svg")


def check_figure(path: Path) -> None:
    """Check that a figure can be drawn, before anything is run; an OutputError says why not."""
    if path.suffix not in SUFFIXES:
        raise OutputError(f"{path}: write a name that ends in {' or '.join(SUFFIXES)}")
    with optional("figures", "a figure"):
        import contactlab.charts  # noqa: F401, PLC0415  # pyright: ignore[reportUnusedImport]
    if not path.parent.is_dir():
        raise OutputError(f"cannot write {path}: no folder {path.parent}")


def save_figure(chart: "alt.TopLevelMixin", path: Path) -> None:
    """Write a chart as a .png or .svg file; an OutputError if it cannot be written."""
    from contactlab.charts import render_chart, themed  # noqa: PLC0415 - an extra

    with write_errors(path):
        path.write_bytes(render_chart(themed(chart.to_dict()), path.suffix[1:]))


def draw(report: TradeoffReport, path: Path) -> None:
    """Draw a report as a .png or .svg file; an OutputError says why it cannot be."""
    check_figure(path)
    from contactlab.pareto.tradeoff_chart import specification  # noqa: PLC0415 - needs the extra

    save_figure(specification(report), path)
