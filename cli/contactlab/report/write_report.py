"""Write a store's page or figures; the libraries for it are an extra."""

from collections.abc import Sequence
from pathlib import Path

from contactlab.errors import OutputError
from contactlab.report.report_data import PageRequest, WrittenPage
from contactlab.report.vega_rendering import FORMATS, check_chart_libraries, render_chart
from contactlab.store import Store, atomic_write
from contactlab.tradeoff import Criteria

_EVERYTHING = PageRequest()
_NOTHING = Criteria()


def write_page(store: Store, target: Path, ask: PageRequest = _EVERYTHING) -> WrittenPage:
    """Write everything of a store into one page that needs nothing else.

    The same store gives the same bytes.

    Args:
        store: a finished store.
        target: the HTML file.
        ask: what it should hold.

    Raises:
        OutputError: libraries for it are missing, or it cannot be written.
        SweepFileError: a tolerance is of something that the store does not measure.
        StoreError: the store cannot be read.
    """
    check_chart_libraries()
    from contactlab.report.html_page import page  # noqa: PLC0415 - needs the extra

    text, notes = page(store, ask)
    data = text.encode()
    with atomic_write(target) as temporary:
        temporary.write_bytes(data)
    return WrittenPage(len(data), notes)


def write_figures(
    store: Store, folder: Path, formats: Sequence[str], question: Criteria = _NOTHING
) -> list[Path]:
    """Write every figure that a store holds what it needs for.

    The same store gives the same bytes.

    Args:
        store: a finished store.
        folder: where they go; it is made if it is missing.
        formats: of png, svg and pdf.
        question: which error stands for accuracy, and tolerances over those of the sweep.

    Returns:
        The files.

    Raises:
        OutputError: a format is not known, libraries are missing, or a file cannot be written.
        SweepFileError: a tolerance is of something that the store does not measure.
        StoreError: the store cannot be read.
    """
    for form in formats:
        if form not in FORMATS:
            raise OutputError(f"no format '{form}'; write some of {', '.join(FORMATS)}")
    check_chart_libraries()
    from contactlab.report.paper_figures import figure_specs  # noqa: PLC0415 - needs the extra
    from contactlab.report.report_data import read_report_data  # noqa: PLC0415

    gathered = read_report_data(store, question)
    _make(folder)
    written: list[Path] = []
    for name, spec in figure_specs(gathered):
        for form in formats:
            path = folder / f"{name}.{form}"
            with atomic_write(path) as temporary:
                temporary.write_bytes(render_chart(spec, form))
            written.append(path)
    return written


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make {folder}: {error.strerror}") from error
