"""Commands that draw: `report` a store as a page or figures, `render` a run in 3D."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from contactlab.commands import options as opt
from contactlab.commands.terminal import echo, print_table, say
from contactlab.errors import OutputError, optional

if TYPE_CHECKING:
    from contactlab.pareto.criteria import Criteria
    from contactlab.store.finished_store import Store

_ALL = 1_000_000


def report(
    store: opt.Address = opt.STORE,
    target: Path | None = opt.output_option(
        "FILE", "Page to write; by default STORE.html, beside a store that is a folder."
    ),
    *,
    error: str | None = opt.ERROR,
    tolerance: list[str] | None = opt.TOLERANCE,
    traces: str = opt.option("N|all|none", "Runs whose time series the page includes.", "60"),
    max_mb: float = typer.Option(
        25.0, min=1, help="Size above which the page has statistics instead of runs [MB]."
    ),
    baseline: opt.Address | None = typer.Option(
        None,
        parser=opt.store_at,
        metavar="STORE",
        help="Store to compare with, as `contactlab compare` does.",
    ),
    parity: Path | None = opt.option(
        "FILE", "Report of `contactlab parity --format json` to show beside the store."
    ),
    figures: Path | None = opt.option(
        "FOLDER|list", "Write figures into this folder instead of a page; or list them."
    ),
    width: str | None = opt.option("LENGTH", "Width of figures on paper: 85mm, a column."),
    formats: str = typer.Option(
        "png", "--format", help="File formats of the figures: png, svg, pdf."
    ),
) -> None:
    """Draw a store as one page that works offline: maps, accuracy against time, every run."""
    from contactlab.reporting.report import PageRequest, write_page
    from contactlab.store.finished_store import Store

    criteria = opt.accuracy_criteria(error, tolerance)
    opened = Store.open(store)
    if width is not None and figures is None:
        raise OutputError("--width is of figures; write --figures FOLDER too")
    if figures is not None:
        _figures(opened, figures, formats.split(","), criteria, width)
        return
    against = Store.open(baseline) if baseline else None
    request = PageRequest(criteria, _count(traces), int(max_mb * 1e6), against, parity)
    page = target or opt.beside(store, ".html")
    if page.is_dir() or page.suffix not in {".html", ".htm"}:
        raise OutputError(f"{page}: write a name that ends in .html")
    if not page.parent.is_dir():
        raise OutputError(f"cannot write {page}: no folder {page.parent}; create it first")
    for note in write_page(opened, page, request):
        say(f"note: {note}")
    say(f"{page.stat().st_size / 1e6:.2g} MB")
    echo(page)


def _figures(
    store: "Store", folder: Path, formats: list[str], criteria: "Criteria", width: str | None
) -> None:
    from contactlab.plugins import extensions
    from contactlab.reporting.report import read_report_data, write_figures

    if folder == Path("list"):
        with optional("figures", "a report"):
            figure_list = extensions("page")["figure-list"].load()
        rows = figure_list(read_report_data(store, criteria))
        print_table(("figure", "what it shows"), rows)
        return
    written, missing = write_figures(store, folder, formats, criteria, width)
    for name, why in missing.items():
        say(f"no figure '{name}': {why}")
    for path in written:
        echo(path)


def _count(text: str) -> int:
    if text in {"all", "none"}:
        return _ALL if text == "all" else 0
    if not text.isdecimal():
        raise OutputError(f"--traces {text}: write a number of runs, all or none")
    return int(text)


def render(
    store: opt.Address = opt.STORE,
    run: str = opt.RUN,
    target: Path = opt.output_option(
        "FILE",
        "File to write: .mcap (Foxglove, Lichtblick), .rrd (Rerun), .mp4, .gif or .png.",
        ...,
    ),
    at: list[float] | None = opt.option("SECONDS", "Time of a .png; may be repeated."),
    speed: float | None = typer.Option(None, help="Playback speed of a film; 0.1 is slow motion."),
    size: str | None = opt.option("WIDTHxHEIGHT", "Size in pixels: 640x480."),
    camera: str | None = typer.Option(None, help="Camera of the model."),
    beside: str | None = typer.Option(
        None, "--side-by-side", metavar="RUN", help="Another run of the store, drawn beside it."
    ),
) -> None:
    """Render a stored run in 3D with its contact forces: for a viewer, as a film or pictures."""
    from contactlab.plugins import extensions
    from contactlab.store.finished_store import Store

    found = extensions("viewer")
    suffix = target.suffix.lower().removeprefix(".")
    if suffix not in found.keys() - {"window"}:
        known = ", ".join(f".{each}" for each in found if each != "window")
        raise OutputError(f"cannot write {target}: end its name in {known}")
    write = found[suffix].load()
    if note := write(
        Store.open(store),
        run,
        target,
        size=_size(size),
        camera=camera,
        speed=speed,
        at=at or (),
        beside=beside,
    ):
        say(note)
    echo(target)


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    width, cross, height = text.partition("x")
    if not (cross and width.isdecimal() and height.isdecimal()):
        raise OutputError(f"--size {text}: write width and height, as in 640x480")
    return int(width), int(height)
