"""`contactlab report`: a store as one page, or as figures for a paper."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Arguments, Option, command, flag
from contactlab.command_line.listing import Listing
from contactlab.command_line.surroundings import rerun_with_mujoco, say
from contactlab.command_line.terminal import echo, print_table
from contactlab.errors import OutputError

if TYPE_CHECKING:
    from contactlab.pareto.criteria import Criteria
    from contactlab.store.finished_store import Store
    from contactlab.store.store_files import Address


def _print_paths(result: Path | list[Path] | Listing, arguments: Arguments) -> None:
    del arguments
    if isinstance(result, Listing):
        print_table(result.header, result.rows)
        return
    for path in [result] if isinstance(result, Path) else result:
        echo(path)


@command(
    "read",
    keeps="nothing",
    examples=("report results/grasp", "report results/grasp --figures paper --format pdf"),
    formats={"text": _print_paths},
)
def report(
    store: opt.StoreArgument,
    *,
    output: Annotated[
        str | Path | None,
        Option(
            "FILE",
            "Page to write; by default STORE.html, next to the folder of the store.",
            kind=Path,
            short="-o",
        ),
    ] = None,
    metric: opt.ErrorMetric = None,
    tolerance: opt.Tolerance = (),
    traces: Annotated[
        int | str,
        Option("N|all|none", "Number of runs with time series in the page.", kind=str),
    ] = "60",
    max_mb: Annotated[
        float,
        Option(None, "Largest page with single runs [MB]; a larger one has statistics.", least=1),
    ] = 25.0,
    baseline: Annotated[
        "Store | Address | str | None",
        Option("STORE", "Store to compare with, as `contactlab compare` does.", kind=str),
    ] = None,
    parity: Annotated[
        str | Path | None,
        Option(
            "FILE",
            "Report of `contactlab parity --format json` to show on the page.",
            kind=Path,
        ),
    ] = None,
    figures: Annotated[
        str | Path | None,
        Option(
            "FOLDER|list",
            "Write figures into this folder instead of a page; or list them.",
            kind=Path,
        ),
    ] = None,
    width: Annotated[
        str | None, Option("LENGTH", "Width of figures on paper: 85mm, a column.")
    ] = None,
    live: Annotated[
        bool,
        flag(
            "Write an interactive page, which simulates runs; by default STORE.live.html. In a "
            "checkout, `make live` first builds its script with npm and Node.js 20."
        ),
    ] = False,
    run: Annotated[
        Sequence[str],
        Option(
            "ID",
            "Run of the interactive page; may be repeated; by default one of each label.",
            kind=list[str],
        ),
    ] = (),
    mujoco: Annotated[
        str | None,
        Option(
            "VERSION|PYTHON",
            "MuJoCo that compiles the models of the interactive page; for equal bits, that of "
            "the store.",
        ),
    ] = None,
    format: Annotated[
        str | Sequence[str],
        Option(None, "File formats of the figures: png, svg, pdf.", kind=str),
    ] = "png",
) -> "Path | Any":  # noqa: ANN401 - so that a caller without `figures` has a path
    """Draw a store as one page that works offline.

    The path of the page is returned, those of the figures, or the list of figures.

    Raises:
        OutputError: an extra for figures is not installed, or a file cannot be written.
        StoreError: a store cannot be read.
    """
    from contactlab.page.report_files import write_page
    from contactlab.pareto.criteria import Criteria
    from contactlab.reporting.report import PageRequest
    from contactlab.store.finished_store import Store

    task = opt.task_of(tolerance=tolerance)
    instead = "a report weighs metrics; write --tolerance METRIC=VALUE, such as slip=1mm"
    opt.refuse_parts(task, ["tolerance"], instead)
    criteria = Criteria(metric, task.limits)
    address = opt.address_of(store)
    opened = Store.open(address)
    if width is not None and figures is None:
        raise OutputError("--width needs --figures FOLDER")
    if figures is not None:
        formats = format.split(",") if isinstance(format, str) else format
        return _write_figures(opened, Path(figures), list(formats), criteria, width)
    if live:
        others = {"figures": figures, "baseline": baseline, "parity": parity, "metric": metric}
        if unread := [
            name
            for name, option_value in {**others, "tolerance": tolerance}.items()
            if option_value
        ]:
            raise OutputError(f"--{unread[0]} does not go with --live; leave it out")
        page = opt.path_next_to(address, ".live.html") if output is None else Path(output)
        rerun_with_mujoco(mujoco, None)
        from contactlab.live.live_page import write_live_page

        _check_name(page)
        return _print_notes(page, write_live_page(opened, page, run))
    if unread := [
        name for name, option_value in {"run": run, "mujoco": mujoco}.items() if option_value
    ]:
        raise OutputError(f"--{unread[0]} needs --live")
    against = None if baseline is None else Store.open(opt.address_of(baseline))
    parity_path = None if parity is None else Path(parity)
    if not str(traces).isdecimal() and traces not in {"all", "none"}:
        raise OutputError(f"--traces {traces}: write a number of runs, all or none")
    most = {"all": opened.columns.runs, "none": 0}.get(str(traces))
    count = int(traces) if most is None else most
    request = PageRequest(criteria, count, int(max_mb * 1e6), against, parity_path)
    page = opt.path_next_to(address, ".html") if output is None else Path(output)
    _check_name(page)
    return _print_notes(page, write_page(opened, page, request))


def _check_name(page: Path) -> None:
    if page.is_dir() or page.suffix not in {".html", ".htm"}:
        raise OutputError(f"{page}: write a name that ends in .html")
    if not page.parent.is_dir():
        raise OutputError(f"cannot write {page}: no folder {page.parent}; create it first")


def _print_notes(page: Path, notes: Sequence[str]) -> Path:
    for note in notes:
        say(f"note: {note}")
    say(f"{page.stat().st_size / 1e6:.2g} MB")
    return page


def _write_figures(
    store: "Store", folder: Path, formats: list[str], criteria: "Criteria", width: str | None
) -> list[Path] | Listing:
    from contactlab.page.report_files import write_figures
    from contactlab.reporting.report import read_report_data

    if folder == Path("list"):
        from contactlab.page.paper_figures import figure_list

        return Listing(("figure", "contents"), figure_list(read_report_data(store, criteria)))
    figure_paths, missing = write_figures(store, folder, formats, criteria, width)
    for name, why in missing.items():
        say(f"no figure '{name}': {why}")
    return figure_paths
