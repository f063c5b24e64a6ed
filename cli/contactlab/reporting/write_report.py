"""Write a store's page or figures; the libraries that draw them are an extra."""

from collections.abc import Sequence
from pathlib import Path

from contactlab.errors import OutputError, optional
from contactlab.pareto.criteria import Criteria
from contactlab.reporting.report_data import PageRequest, read_report_data
from contactlab.store.atomic_files import atomic_write
from contactlab.store.finished_store import Store

FORMATS = ("png", "svg", "pdf")
_DEFAULT_PAGE = PageRequest()
_DEFAULT_CRITERIA = Criteria()


def write_page(store: Store, target: Path, request: PageRequest = _DEFAULT_PAGE) -> tuple[str, ...]:
    """Write a store as one HTML page that needs no other file and no network.

    The same store gives the same bytes; notes say what the page leaves out.

    Raises:
        OutputError: a library is missing, or the file cannot be written.
        SweepFileError: a tolerance names a metric that the store does not have.
        StoreError: the store cannot be read.
    """
    with optional("figures", "a report"):
        from contactlab.reporting.html_page import html_page  # noqa: PLC0415 - an extra
    text, notes = html_page(store, request)
    with atomic_write(target) as temporary:
        temporary.write_bytes(text.encode())
    return notes


def write_figures(
    store: Store, folder: Path, formats: Sequence[str], criteria: Criteria = _DEFAULT_CRITERIA
) -> list[Path]:
    """Write every figure for which a store has the data as png, svg or pdf; return the files.

    The same store gives the same bytes.

    Raises:
        OutputError: a format is unknown, a library is missing, or a file cannot be written.
        SweepFileError: a tolerance names a metric that the store does not have.
        StoreError: the store cannot be read.
    """
    for form in formats:
        if form not in FORMATS:
            raise OutputError(f"unknown format '{form}'; choose from {', '.join(FORMATS)}")
    with optional("figures", "a report"):
        from contactlab.reporting.paper_figures import figure_specs  # noqa: PLC0415 - an extra
        from contactlab.reporting.vega_rendering import render_chart  # noqa: PLC0415 - an extra
    data = read_report_data(store, criteria)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make {folder}: {error.strerror}") from error
    written: list[Path] = []
    for name, spec in figure_specs(data).items():
        for form in formats:
            path = folder / f"{name}.{form}"
            with atomic_write(path) as temporary:
                temporary.write_bytes(render_chart(spec, form))
            written.append(path)
    return written
