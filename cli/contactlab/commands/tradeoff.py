"""`contactlab tradeoff`: what accuracy costs in time, and which configuration to use."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands.cores import cores
from contactlab.commands.output import Format, FormatOption, print_json, say
from contactlab.commands.running import RESULTS, resumable, sweep_path
from contactlab.commands.stores import METAVAR, Address, store_at
from contactlab.errors import ExpectationError, OutputError, SweepFileError

if TYPE_CHECKING:
    from contactlab.run import Ask
    from contactlab.schema import Sweep, TradeoffReport
    from contactlab.tradeoff import Question

_MANIFEST = "manifest.json"


def tradeoff(  # noqa: PLR0913 - one argument an option
    name: Annotated[
        str, typer.Argument(metavar="STORE|SWEEP", help="A store, a sweep file or a shipped sweep.")
    ],
    *,
    error: Annotated[
        str | None,
        typer.Option(help="What stands for accuracy: error_final, oracle_error or any metric."),
    ] = None,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(help="What is accurate enough, over the sweep's: oracle_error=1%"),
    ] = None,
    figure: Annotated[Path | None, typer.Option(help="Draw it: a .png or .svg file.")] = None,
    write: Annotated[
        Path | None, typer.Option(help="Write a sweep file of the recommendation alone.")
    ] = None,
    store: Annotated[
        Address | None,
        typer.Option(
            "-o",
            "--output",
            parser=store_at,
            metavar=METAVAR,
            help="A sweep's store; results/tradeoff/SWEEP if left out.",
        ),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=0, help="Worker processes; one for each core if left out.")
    ] = None,
    output: FormatOption = Format.text,
) -> None:
    """Weigh accuracy against time, and recommend the cheapest configuration that will do."""
    from contactlab.commands.tradeoff_text import print_tradeoff
    from contactlab.store import Store
    from contactlab.tradeoff import Question, draw, rerun_sweep
    from contactlab.tradeoff import tradeoff as weighed

    question = Question(error, tolerances_of(tolerance or ()))
    _check_outputs(figure, write)
    opened = Store.open(_store(name, store, cores() if workers is None else workers, question))
    report = weighed(opened, question)
    if output is Format.json:
        print_json(report.model_dump(mode="json"))
    else:
        print_tradeoff(report)
    if figure is not None:
        draw(report, figure)
        say(f"drew {figure}")
    _fail_on(report)
    if write is not None:
        _write(write, rerun_sweep(opened, report, write.parent), report)


def _check_outputs(figure: Path | None, write: Path | None) -> None:
    """Refuse what cannot be written before anything is run for it."""
    from contactlab.tradeoff import check_figure

    if figure is not None:
        check_figure(figure)
    for path in (figure, write):
        if path is not None and not path.parent.is_dir():
            raise OutputError(f"cannot write {path}: no folder {path.parent}")
    if write is not None and write.exists():
        raise OutputError(f"{write} exists; choose another file with --write")


def tolerances_of(texts: Sequence[str]) -> dict[str, float]:
    """Return tolerances that are written as METRIC=VALUE.

    Raises:
        SweepFileError: one is not.
    """
    found: dict[str, float] = {}
    for text in texts:
        name, _, value = text.partition("=")
        number = _number(value)
        if not name or number is None:
            raise SweepFileError(
                f"'{text}' is no tolerance; write METRIC=VALUE, such as oracle_error=1%"
            )
        found[name] = number
    return found


def _number(text: str) -> float | None:
    try:
        number = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        return None
    return number if math.isfinite(number) and number >= 0 else None


def _store(name: str, target: Address | None, workers: int, question: "Question") -> Address:
    """Return the store to weigh, after running the sweep if it is one."""
    path = store_at(name)
    if not isinstance(path, Path):
        if target is not None:
            raise SweepFileError(f"{path} is a store; -o says where the store of a sweep goes")
        return path
    if path.is_dir() and (target is not None or (path / _MANIFEST).is_file()):
        if target is not None:
            raise SweepFileError(f"{path} is a folder; -o says where the store of a sweep goes")
        return path
    return path if path.is_dir() else _run(sweep_path(name), target, workers, question)


def _run(path: Path, target: Address | None, workers: int, question: "Question") -> Address:
    from contactlab.commands.progress import progress
    from contactlab.run import run_sweep

    ask = _ask(path, target or RESULTS / "tradeoff" / path.stem, workers, question)
    for warning in ask.plan.warnings:
        say(str(warning))
    with resumable() as stop, progress() as shown:
        run_sweep(ask, shown.begin, shown.advance, stop)
    return ask.store


def _ask(path: Path, store: Address, workers: int, question: "Question") -> "Ask":
    """Return what to run: the sweep, with errors and times measured even if it does not ask."""
    from contactlab.plan import Overrides
    from contactlab.run import ask_for

    plain = ask_for(path, path.stem, store, folder=path.parent, workers=workers)
    added = _added(plain.plan.sweep, question)
    return ask_for(
        path,
        path.stem,
        store,
        folder=path.parent,
        workers=workers,
        overrides=Overrides(assign=added),
    )


def _added(sweep: "Sweep", question: "Question") -> tuple[str, ...]:
    """Return what a sweep is to measure that its file leaves out.

    Runs against a reference cost more than all others; they are left out where the error is of
    another kind.
    """
    from contactlab.schema import ERRORS
    from contactlab.tradeoff import chosen_error

    error = question.error or chosen_error({**sweep.tolerances, **question.tolerances})
    wanted = error is None or error in ERRORS
    accuracy = ("accuracy={error: auto}",) if wanted and sweep.accuracy is None else ()
    timing = ("timing={rounds: 3}",) if sweep.timing is None else ()
    return (*accuracy, *timing)


def _fail_on(report: "TradeoffReport") -> None:
    if report.recommendation is not None:
        return
    most = report.blockers[0] if report.blockers else None
    what = ""
    if most is not None:
        best = "" if most.best is None else f", and the best has {most.best:.3g}"
        kind = "tolerance of " if most.kind == "tolerance" else "label "
        what = f"; most fail by the {kind}{most.name} ({most.configurations}{best})"
    raise ExpectationError(f"none of {len(report.configurations)} configurations is feasible{what}")


def _write(path: Path, text: str, report: "TradeoffReport") -> None:
    from contactlab.schema import ERRORS
    from contactlab.store import cannot_write

    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise cannot_write(path, error) from error
    command = "tradeoff" if report.tolerances.keys() & set(ERRORS) else "sweep"
    say(f"wrote {path}\nnext: contactlab {command} {path}")
