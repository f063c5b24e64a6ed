"""`contactlab report`: a store as one page, or as figures."""

from pathlib import Path
from typing import Annotated

import typer

from contactlab.commands.options import METAVAR, Address, StoreArgument, store_at
from contactlab.commands.terminal import say
from contactlab.commands.tradeoff_command import tolerances_of
from contactlab.errors import OutputError

_ALL = 1_000_000


def report(  # noqa: PLR0913 - one argument an option
    store: StoreArgument,
    target: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="The page; STORE.html beside a store that is a folder, or here, if left out.",
        ),
    ] = None,
    *,
    error: Annotated[
        str | None, typer.Option(help="What stands for accuracy, as in `contactlab tradeoff`.")
    ] = None,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(help="What is accurate enough, over the sweep's: oracle_error=1%"),
    ] = None,
    traces: Annotated[
        str, typer.Option(help="Runs whose time series the page has: a number, all or none.")
    ] = "60",
    max_mb: Annotated[
        float, typer.Option(min=1, help="Above it the page has sums over runs instead of runs.")
    ] = 25.0,
    baseline: Annotated[
        Address | None,
        typer.Option(
            parser=store_at,
            metavar=METAVAR,
            help="A store to compare with, as `contactlab compare` does.",
        ),
    ] = None,
    figures: Annotated[
        Path | None, typer.Option(help="Write figures into this folder instead of a page.")
    ] = None,
    forms: Annotated[
        str, typer.Option("--format", help="What figures are: some of png, svg, pdf.")
    ] = "png",
) -> None:
    """Draw a store as one page that needs no network: maps, accuracy against time, every run."""
    from contactlab.report import PageRequest, write_figures, write_page
    from contactlab.store import Store
    from contactlab.tradeoff import Criteria

    question = Criteria(error, tolerances_of(tolerance or ()))
    if figures is not None:
        for path in write_figures(Store.open(store), figures, forms.split(","), question):
            typer.echo(path)
        return
    against = Store.open(baseline) if baseline else None
    ask = PageRequest(question, _count(traces), int(max_mb * 1e6), against)
    page = target or _beside(store)
    opened = Store.open(store)
    _check_target(page)
    written = write_page(opened, page, ask)
    for note in written.notes:
        say(f"note: {note}")
    say(f"{written.bytes / 1e6:.2g} MB")
    typer.echo(page)


def _beside(store: Address) -> Path:
    if not isinstance(store, Path):
        return Path(f"{store.name}.html")
    named = store if store.name else store.resolve()
    return named.with_name(f"{named.name}.html")


def _count(text: str) -> int:
    if text in {"all", "none"}:
        return _ALL if text == "all" else 0
    if not text.isdecimal():
        raise OutputError(f"--traces {text}: write a number of runs, all or none")
    return int(text)


def _check_target(page: Path) -> None:
    if page.is_dir() or page.suffix not in {".html", ".htm"}:
        raise OutputError(f"{page}: write a name that ends in .html")
    if not page.parent.is_dir():
        raise OutputError(f"cannot write {page}: no folder {page.parent}")
