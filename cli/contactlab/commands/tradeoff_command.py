"""`contactlab tradeoff`: what accuracy costs in time, and which configuration to use."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands.options import METAVAR, Address, cores, store_at
from contactlab.commands.stopping import RESULTS, resumable, sweep_path
from contactlab.commands.terminal import Format, FormatOption, print_json, print_table, say
from contactlab.errors import ExpectationError, OutputError, SweepFileError

if TYPE_CHECKING:
    from contactlab.run import SweepRequest
    from contactlab.schema import (
        Configuration,
        FrontPoint,
        Method,
        Recommendation,
        Settings,
        Sweep,
        TradeoffReport,
    )
    from contactlab.tradeoff import Criteria

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
    from contactlab.store import Store
    from contactlab.tradeoff import Criteria, analyse, draw, recommended_sweep

    question = Criteria(error, tolerances_of(tolerance or ()))
    _check_outputs(figure, write)
    opened = Store.open(_store(name, store, cores() if workers is None else workers, question))
    report = analyse(opened, question)
    if output is Format.json:
        print_json(report.model_dump(mode="json"))
    else:
        print_tradeoff(report)
    if figure is not None:
        draw(report, figure)
        say(f"drew {figure}")
    _fail_on(report)
    if write is not None:
        _write(write, recommended_sweep(opened, report, write.parent), report)


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


def _store(name: str, target: Address | None, workers: int, question: "Criteria") -> Address:
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


def _run(path: Path, target: Address | None, workers: int, question: "Criteria") -> Address:
    from contactlab.commands.terminal import progress
    from contactlab.run import run_sweep

    ask = _ask(path, target or RESULTS / "tradeoff" / path.stem, workers, question)
    for warning in ask.plan.warnings:
        say(str(warning))
    with resumable() as stop, progress() as shown:
        run_sweep(ask, shown.begin, shown.advance, stop)
    return ask.store


def _ask(path: Path, store: Address, workers: int, question: "Criteria") -> "SweepRequest":
    """Return what to run: the sweep, with errors and times measured even if it does not ask."""
    from contactlab.plan import Overrides
    from contactlab.run import read_request

    plain = read_request(path, path.stem, store, folder=path.parent, workers=workers)
    added = _added(plain.plan.sweep, question)
    return read_request(
        path,
        path.stem,
        store,
        folder=path.parent,
        workers=workers,
        overrides=Overrides(assign=added),
    )


def _added(sweep: "Sweep", question: "Criteria") -> tuple[str, ...]:
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
    from contactlab.store import write_error

    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise write_error(path, error) from error
    command = "tradeoff" if report.tolerances.keys() & set(ERRORS) else "sweep"
    say(f"wrote {path}\nnext: contactlab {command} {path}")


_MOST_METHODS = 12
_MOST_RATES = 40


def print_tradeoff(report: "TradeoffReport") -> None:
    """Print a report: the front, the methods, and what to use."""
    typer.echo("\n".join(_head(report)))
    _print_front(report)
    if len(report.methods) < len(report.configurations):
        _print_methods(report.methods)
    if report.chaotic:
        _print_rates(report)
    for line in _answer(report):
        typer.echo(line)
    for note in report.notes:
        typer.echo(f"note: {note}")


def _head(report: "TradeoffReport") -> Iterator[str]:
    feasible = sum(each.feasible for each in report.configurations)
    unit = f" [{report.error.unit}]" if report.error.unit not in {"", "any"} else ""
    source = "a timing pass" if report.time.source == "timing" else "the recorded runs"
    yield f"{report.sweep}: {len(report.configurations)} configurations of {report.scene}"
    yield f"  runs of each  {report.cases} (scenarios {', '.join(report.scenarios) or 'one'})"
    kind = f"{report.error.kind}, {report.error.against}" if report.error.against else ""
    kind = kind or report.error.kind
    yield f"  error         {report.error.name}{unit}, the worst of its runs ({kind})"
    yield f"  time          CPU seconds per simulated second, the mean of its runs, of {source}"
    limits = ", ".join(f"{name} <= {value:g}" for name, value in report.tolerances.items())
    yield f"  tolerances    {limits or 'none'}"
    yield f"  feasible      {feasible}"


def _print_front(report: "TradeoffReport") -> None:
    line, what = report.front, "front of the feasible configurations"
    if not line:
        line, what = report.unconstrained_front, "front, none of which is feasible"
    typer.echo(f"\n{what}")
    varying = _varying(report.configurations)
    header = [*varying, "error", "CPU s per s", "x real time"]
    print_table(header, [_front_row(each, varying) for each in line])


def _front_row(each: "FrontPoint", varying: Sequence[str]) -> list[object]:
    values = [each.configuration[name] for name in varying]
    return [*values, f"{each.error:.3g}", f"{each.time:.3g}", f"{each.real_time_factor:,.0f}"]


def _print_methods(methods: "Sequence[Method]") -> None:
    telling = sorted(methods, key=lambda each: each.order.slope is None and each.floor is None)
    rows = [(each.name, _order(each), _floor(each)) for each in telling]
    typer.echo("\nhow the error falls with the timestep")
    print_table(("method", "order", "floor"), rows[:_MOST_METHODS])
    if len(rows) > _MOST_METHODS:
        typer.echo(f"and {len(rows) - _MOST_METHODS} more methods, see --format json")


def _order(method: "Method") -> str:
    order = method.order
    if order.slope is None or order.standard_error is None:
        return f"none: {order.reason}"
    return f"{order.slope:.2f} +- {order.standard_error:.2f} over {order.points} timesteps"


def _floor(method: "Method") -> str:
    if method.floor is None:
        return "-"
    return f"{method.floor.error:.3g} up to {method.floor.timestep:g} s"


def _print_rates(report: "TradeoffReport") -> None:
    typer.echo("\nchaotic: what holds is how often a run is as wanted, with its 95 % interval")
    varying = _varying(report.configurations)
    rows = [
        (
            *(each.configuration[name] for name in varying),
            f"{each.outcomes.good}/{each.outcomes.runs}",
            f"{each.outcomes.low:.0%} to {each.outcomes.high:.0%}",
        )
        for each in report.configurations
    ]
    print_table((*varying, "as wanted", "rate"), rows[:_MOST_RATES])
    if len(rows) > _MOST_RATES:
        typer.echo(f"and {len(rows) - _MOST_RATES} more configurations, see --format json")


def _answer(report: "TradeoffReport") -> Iterator[str]:
    chosen, robust = report.recommendation, report.robust
    if chosen is None:
        yield from _nothing(report)
        return
    yield "\nrecommended"
    yield from _described(report, chosen)
    if robust is None:
        yield "with a margin of 1.25 on every tolerance: none"
    elif robust.configuration == chosen.configuration:
        yield "with a margin of 1.25 on every tolerance: the same"
    else:
        cost = f"{robust.time / chosen.time:.2g}x the time"
        yield f"with a margin of 1.25 on every tolerance, {cost}"
        yield from _described(report, robust)
    yield _next(report)
    yield "\nin the model"
    yield from (f"  {line}" for line in chosen.mjcf)
    yield from (f"  <!-- {name}: {value} -->" for name, value in chosen.other.items())


def _described(report: "TradeoffReport", chosen: "Recommendation") -> Iterator[str]:
    yield f"  {_values(chosen.configuration, _varying(report.configurations))}"
    error = "unknown" if chosen.error is None else f"{chosen.error:.3g}"
    speed = f"{chosen.time:.3g} CPU s per s, {chosen.real_time_factor:,.0f} times real time"
    yield f"  error {error}; {speed}"
    if chosen.margins:
        yield f"  margins: {', '.join(_margin(*each) for each in chosen.margins.items())}"
    if chosen.equally_fast:
        yield f"  as fast, within 5 %, and no more accurate: {len(chosen.equally_fast)} others"
    yield f"  look closer: contactlab show {report.store} {chosen.run_id[:8]}"


def _margin(name: str, value: float | None) -> str:
    return f"{name} untouched" if value is None else f"{name} {value:.3g}"


def _next(report: "TradeoffReport") -> str:
    after = report.next_step
    if after is None:
        return "next step: nothing that was tried is more accurate and within tolerance"
    gain = "without error" if after.error_ratio is None else f"{after.error_ratio:.3g}x less error"
    values = _values(after.configuration, _varying(report.configurations))
    return f"next step: {after.time_ratio:.3g}x the time buys {gain}: {values}"


def _nothing(report: "TradeoffReport") -> Iterator[str]:
    yield "\nnothing is feasible"
    for each in report.blockers:
        best = "" if each.best is None else f", the best has {each.best:.3g}"
        yield f"  {each.kind} {each.name}: {each.configurations} configurations{best}"


def _values(configuration: "Settings", varying: Sequence[str]) -> str:
    values = [(name, configuration[name]) for name in varying]
    told = [f"{name} {value}" for name, value in values if value is not None]
    return ", ".join(told) or "as the scene has it"


def _varying(configurations: "Sequence[Configuration]") -> list[str]:
    """Return the knobs that differ between configurations."""
    values = [each.configuration for each in configurations]
    return [name for name in values[0] if len({each[name] for each in values}) > 1]
