"""Draw a report: what each effect changes, and what it costs; the libraries are an extra."""

from pathlib import Path

from contactlab.schema import EffectsReport
from contactlab.tradeoff import check_figure, save_figure


def draw(report: EffectsReport, path: Path) -> None:
    """Draw a report as two columns of bars, one row an effect.

    Args:
        report: what to draw.
        path: a .png or .svg file.

    Raises:
        OutputError: as `check_figure`, or it cannot be written.
    """
    check_figure(path)
    from contactlab.studies.effects.effects_chart import specification  # noqa: PLC0415 - needs the extra

    save_figure(specification(report), path)
