"""A store's page and figures, written to files."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryFile

from contactlab.errors import OutputError
from contactlab.pareto.criteria import Criteria
from contactlab.reporting.report import DEFAULT_CRITERIA, PageRequest, read_report_data
from contactlab.store.atomic_files import atomic_write, write_errors
from contactlab.store.finished_store import Store

# ruff: noqa: PLC0415 - drawing takes a while to load

FORMATS = ("png", "svg", "pdf")
_DEFAULT_PAGE = PageRequest()


def write_page(store: Store, target: Path, request: PageRequest = _DEFAULT_PAGE) -> tuple[str, ...]:
    """Write a store as one HTML page that needs no other file and no network.

    The same store gives the same bytes; notes name omitted data. Besides the errors of
    `read_report_data`, an OutputError names a missing library, or a file that cannot be written.
    """
    from contactlab.page.page_view import html_page

    with write_errors(target), TemporaryFile(dir=target.parent):
        pass  # drawing takes a while
    text, notes = html_page(store, request)
    with atomic_write(target) as temporary:
        temporary.write_bytes(text.encode())
    return notes


def write_figures(
    store: Store,
    folder: Path,
    formats: Sequence[str],
    criteria: Criteria = DEFAULT_CRITERIA,
    width: str | None = None,
) -> tuple[list[Path], dict[str, str]]:
    """Write every figure that a store has data for as png, svg or pdf.

    Returns the files, and the reasons why other figures are missing. The same store gives the same
    bytes. A width, as in `85mm`, lays them out for paper. Besides the errors of `read_report_data`,
    an OutputError says that a format or a width is wrong, a library is missing, or a file cannot be
    written.
    """
    for form in formats:
        if form not in FORMATS:
            raise OutputError(f"unknown format '{form}'; choose from {', '.join(FORMATS)}")
    from contactlab.page.paper_figures import figure_files

    files, missing = figure_files(read_report_data(store, criteria), formats, width)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make {folder}: {error.strerror}") from error
    for name, content in files.items():
        with atomic_write(folder / name) as temporary:
            temporary.write_bytes(content)
    return [folder / name for name in files], missing
