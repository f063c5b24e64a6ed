"""`contactlab tradeoff`: what accuracy costs in time, and which configuration to use."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.commands import options as opt
from contactlab.commands.stopping import study_session
from contactlab.commands.terminal import print_json, print_table, say, write_text
from contactlab.errors import ExpectationError, OutputError

if TYPE_CHECKING:
    from contactlab.pareto.criteria import Criteria
    from contactlab.schema.tradeoff_report import (
        Configuration,
        FrontPoint,
        Method,
        Recommendation,
        Settings,
        TradeoffReport,
    )

_MOST_METHODS = 12
_MOST_RATES = 40


def tradeoff(
    name: Annotated[
        str, typer.Argument(metavar="STORE|SWEEP", help="Store, sweep file or shipped sweep.")
    ],
    *,
    error: opt.ErrorOption = None,
    tolerance: opt.ToleranceOption = None,
    figure: opt.FigureOption = None,
    write: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write a sweep file of the recommended settings."),
    ] = None,
    store: opt.SweepStoreOption = None,
    workers: opt.WorkersOption = None,
    plugin: opt.PluginOption = None,
    output: opt.FormatOption = "text",
) -> None:
    """Weigh accuracy against time, and recommend the fastest settings that are accurate enough."""
    from contactlab.pareto.drawing import draw

    opt.load_plugins(plugin)
    criteria = opt.accuracy_criteria(error, tolerance)
    _check_outputs(figure, write)
    report = _report(name, store, workers, criteria)
    if output == "json":
        print_json(report.model_dump(mode="json"))
    else:
        _print(report)
    if figure is not None:
        draw(report, figure)
        say(f"drew {figure}")
    _fail_on(report)
    if write is not None:
        _write(write, report)


def _check_outputs(figure: Path | None, write: Path | None) -> None:
    """Refuse files that cannot be written, before anything is run."""
    from contactlab.pareto.drawing import check_figure

    if figure is not None:
        check_figure(figure)
    for path in (figure, write):
        if path is not None and not path.parent.is_dir():
            raise OutputError(f"cannot write {path}: no folder {path.parent}; create it first")
    if write is not None and write.exists():
        raise OutputError(f"{write} exists; choose another file with --write")


def _report(
    name: str, target: opt.Address | None, workers: int | None, criteria: "Criteria"
) -> "TradeoffReport":
    """Return the report of a store, for which no engine is loaded, or of a sweep, which is run."""
    from contactlab.pareto.analysis import analyse
    from contactlab.pareto.criteria import find_store
    from contactlab.store.finished_store import Store

    stored = find_store(name, target)
    if stored is not None:
        return analyse(Store.open(stored), criteria)
    from contactlab.studies.tradeoff_sweep import TradeoffRequest, run

    with study_session(opt.RESULTS / "tradeoff", workers) as session:
        return run(TradeoffRequest(name, criteria, target), session)


def _fail_on(report: "TradeoffReport") -> None:
    if report.recommendation is not None:
        return
    reason = ""
    if report.blockers:
        first = report.blockers[0]
        best = "" if first.best is None else f"; the best has {first.best:.3g}"
        kind = "tolerance of" if first.kind == "tolerance" else "label"
        reason = f", most often for the {kind} {first.name} ({first.configurations}{best})"
    raise ExpectationError(
        f"none of {len(report.configurations)} configurations is feasible{reason}"
    )


def _write(path: Path, report: "TradeoffReport") -> None:
    from contactlab.pareto.configuration_export import recommended_sweep
    from contactlab.schema.evidence import ERRORS
    from contactlab.store.finished_store import Store
    from contactlab.store.store_address import parse_address

    store = Store.open(parse_address(report.store))
    write_text(path, recommended_sweep(store, report, path.parent))
    command = "tradeoff" if report.tolerances.keys() & set(ERRORS) else "sweep"
    say(f"wrote {path}\nnext: contactlab {command} {path}")


def _print(report: "TradeoffReport") -> None:
    """Print a report: Pareto front, convergence, and the recommendation."""
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
    yield f"  runs of each  {report.cases} (scenarios: {', '.join(report.scenarios) or 'one'})"
    kind = f"{report.error.kind}, {report.error.against}" if report.error.against else ""
    kind = kind or report.error.kind
    yield f"  error         {report.error.name}{unit}, largest over the runs ({kind})"
    yield f"  time          CPU seconds per simulated second, mean over the runs, from {source}"
    limits = ", ".join(f"{name} <= {value:g}" for name, value in report.tolerances.items())
    yield f"  tolerances    {limits or 'none'}"
    yield f"  feasible      {feasible}"


def _print_front(report: "TradeoffReport") -> None:
    line, what = report.front, "Pareto front of the feasible configurations"
    if not line:
        line, what = report.unconstrained_front, "Pareto front; no configuration is feasible"
    typer.echo(f"\n{what}")
    varying = _varying(report.configurations)
    header = [*varying, "error", "CPU s per s", "x real time"]
    print_table(header, [_front_row(each, varying) for each in line])


def _front_row(each: "FrontPoint", varying: Sequence[str]) -> list[object]:
    values = [each.configuration[name] for name in varying]
    return [*values, f"{each.error:.3g}", f"{each.time:.3g}", f"{each.real_time_factor:,.0f}"]


def _print_methods(methods: "Sequence[Method]") -> None:
    ordered = sorted(methods, key=lambda each: each.order.slope is None and each.floor is None)
    rows = [(each.name, _order(each), _floor(each)) for each in ordered]
    typer.echo("\nconvergence of the error with the timestep")
    _print_first(("method", "order", "floor"), rows, _MOST_METHODS)


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
    typer.echo("\nchaotic: fraction of runs as expected, with its 95 % confidence interval")
    varying = _varying(report.configurations)
    rows = [
        (
            *(each.configuration[name] for name in varying),
            f"{each.outcomes.good}/{each.outcomes.runs}",
            f"{each.outcomes.low:.0%} to {each.outcomes.high:.0%}",
        )
        for each in report.configurations
    ]
    _print_first((*varying, "as expected", "rate"), rows, _MOST_RATES)


def _print_first(header: Sequence[str], rows: Sequence[Sequence[object]], most: int) -> None:
    print_table(header, rows[:most])
    if len(rows) > most:
        typer.echo(f"and {len(rows) - most} more, see --format json")


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
    yield "\nin the MJCF"
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
        yield f"  {len(chosen.equally_fast)} others are as fast (within 5 %) and no more accurate"
    yield f"  look closer: contactlab show {report.store} {chosen.run_id[:8]}"


def _margin(name: str, value: float | None) -> str:
    return f"{name} unlimited" if value is None else f"{name} {value:.3g}"


def _next(report: "TradeoffReport") -> str:
    after = report.next_step
    if after is None:
        return "next step: no feasible configuration is more accurate"
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
    shown = [f"{name} {value}" for name, value in values if value is not None]
    return ", ".join(shown) or "the scene's own settings"


def _varying(configurations: "Sequence[Configuration]") -> list[str]:
    """Return the knobs that differ between configurations."""
    values = [each.configuration for each in configurations]
    return [name for name in values[0] if len({each[name] for each in values}) > 1]
