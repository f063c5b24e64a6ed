"""Describes the trade-off of accuracy and time of a sweep, and the recommended configuration."""

from collections.abc import Iterator, Sequence

from contactlab.pareto.recommendation import (
    next_step_text,
    robust_text,
    settings_text,
)
from contactlab.printable import shell_word, shortened
from contactlab.rendering.amounts import format_amount, format_interval
from contactlab.rendering.document import (
    Block,
    Code,
    Document,
    Facts,
    Headline,
    Items,
    Section,
    Sentence,
    document_of,
    table_of,
)
from contactlab.schema.tradeoff_report import (
    REALITY,
    Configuration,
    Method,
    Recommendation,
    TradeoffReport,
)

_MOST_METHODS = 12
_MOST_RATES = 40
_MOST_LINES = 12  # of the changes of the model


def describe_tradeoff(report: TradeoffReport) -> Document:
    """Describe the error and the time of configurations, their front, and the recommended one."""
    sections = [Section(tuple(_head(report)), "head"), _front(report)]
    if len(report.methods) < len(report.configurations):
        sections.append(_convergence(report.methods))
    if report.chaotic:
        sections.append(_rates(report))
    sections += _answer(report)
    notes = tuple(Sentence(f"note: {note}") for note in report.notes)
    sections.append(Section(notes, "notes", follows=True))
    return document_of(*sections)


def _head(report: TradeoffReport) -> Iterator[Block]:
    if report.task is not None:
        yield Sentence(report.task.line)
    if report.verdict is not None:
        yield Sentence(f"as written: {report.verdict.line}")
    count = len(report.configurations)
    yield Headline(f"{report.sweep}: {count} configurations of {report.scene}")
    yield Facts(tuple(_facts(report)))


def _facts(report: TradeoffReport) -> Iterator[tuple[str, str]]:
    unit = f" [{report.error.unit}]" if report.error.unit not in {"", "any"} else ""
    source = "a timing pass" if report.time.source == "timing" else "the recorded runs"
    scenarios = ", ".join(report.scenarios) or "one"
    yield "runs of each", f"{report.runs_per_configuration} (scenarios: {scenarios})"
    written = "against the model as written" if report.error.reference == "written" else None
    over = "mean" if report.error.name == REALITY else "largest"
    kind = ", ".join(filter(None, (report.error.kind, report.error.against, written)))
    yield "error", f"{report.error.name}{unit}, {over} over the runs ({kind})"
    yield "time", f"CPU seconds per simulated second, mean over the runs, from {source}"
    limits = ", ".join(f"{name} <= {value:g}" for name, value in report.tolerances.items())
    yield "tolerances", limits or "none"
    yield "feasible", str(sum(each.feasible for each in report.configurations))
    if report.baseline is not None:
        yield "current", _current_text(report, report.baseline)


def _current_text(report: TradeoffReport, current: Configuration) -> str:
    """Return settings, error and time of the model as written, and why it is not feasible."""
    known = [name for name in report.varying if current.configuration[name] is not None]
    parts = [settings_text(current.configuration, known)] if known else []
    parts += [] if current.error is None else [f"error {format_amount(current.error)}"]
    parts += [] if current.time is None else [f"{format_amount(current.time)} CPU s per s"]
    return "; ".join([*parts, *current.reasons[:1]])


def _front(report: TradeoffReport) -> Section:
    points, title = report.front, "Pareto front of the feasible configurations"
    if not points:
        points, title = report.unconstrained_front, "Pareto front; no configuration is feasible"
    rows = [
        (
            *(each.configuration[name] for name in report.varying),
            format_amount(each.error),
            format_amount(each.time),
            format_amount(each.real_time_factor, "count"),
        )
        for each in points
    ]
    header = (*report.varying, "error", "CPU s per s", "x real time")
    return Section((table_of(header, rows),), "front", title)


def _convergence(methods: Sequence[Method]) -> Section:
    ordered = sorted(methods, key=lambda each: each.order.slope is None and each.floor is None)
    rows = [
        (
            each.name,
            _order_text(each),
            f"{format_amount(each.floor.error)} up to {each.floor.timestep:g} s"
            if each.floor
            else "-",
        )
        for each in ordered
    ]
    table = table_of(("method", "order", "floor"), rows, most=_MOST_METHODS)
    return Section((table,), "convergence", "convergence of the error with the timestep")


def _order_text(method: Method) -> str:
    order = method.order
    if order.slope is None or order.standard_error is None:
        return f"none: {order.reason}"
    return f"{order.slope:.2f} +- {order.standard_error:.2f} over {order.points} timesteps"


def _rates(report: TradeoffReport) -> Section:
    rows = [
        (
            *(each.configuration[name] for name in report.varying),
            f"{each.outcomes.good}/{each.outcomes.runs}",
            format_interval(each.outcomes.low, each.outcomes.high),
        )
        for each in report.configurations
    ]
    title = "chaotic: fraction of runs as expected, with its 95 % confidence interval"
    table = table_of((*report.varying, "as expected", "rate"), rows, most=_MOST_RATES)
    return Section((table,), "rates", title)


def _answer(report: TradeoffReport) -> Iterator[Section]:
    chosen, robust = report.recommendation, report.robust
    if chosen is None:
        title = f"no configuration {'of mujoco ' if report.front else ''}is feasible"
        yield Section((Items(tuple(each.sentence for each in report.blockers), title),), "answer")
        return
    now = report.baseline and report.baseline.time
    title = f"recommended{f', {now / chosen.time:.2f}x as fast as written' if now else ''}"
    blocks: list[Block] = [_described(report, chosen, title)]
    if text := robust_text(report):
        blocks.append(Sentence(text))
    if robust is not None and robust.run_id != chosen.run_id:
        blocks.append(_described(report, robust))
    step = next_step_text(report) or "no feasible configuration is more accurate"
    yield Section((*blocks, Sentence(f"next step: {step}")), "answer")
    yield _changes(report, chosen)


def _changes(report: TradeoffReport, chosen: Recommendation) -> Section:
    if report.baseline and chosen.configuration == report.baseline.configuration:
        return Section((Sentence("No change recommended."),), "changes")
    if not (chosen.mjcf or chosen.other):
        how = f"write the model: contactlab tradeoff {shell_word(report.store)} --model FOLDER"
        return Section((Code((how,), indent=0),), "changes")
    rest = "the patch that --model FOLDER writes"
    lines = shortened(chosen.mjcf, _MOST_LINES, rest)
    lines += [f"{name}: {value}" for name, value in chosen.other.items()]
    return Section((Code(tuple(lines)),), "changes", "changes of the model")


def _described(report: TradeoffReport, chosen: Recommendation, title: str = "") -> Items:
    error = "unknown" if chosen.error is None else format_amount(chosen.error)
    factor = format_amount(chosen.real_time_factor, "count")
    texts = [
        settings_text(chosen.configuration, report.varying) or "as in the sweep",
        f"error {error}; {format_amount(chosen.time)} CPU s per s, {factor}x real time",
    ]
    if chosen.margins:
        margins = (
            f"{name} {'unlimited' if each is None else format_amount(each)}"
            for name, each in chosen.margins.items()
        )
        texts.append(f"margins: {', '.join(margins)}")
    if chosen.equally_fast:
        texts.append(
            f"{len(chosen.equally_fast)} other configurations are as fast (within 5 %) and not "
            "more accurate"
        )
    texts.append(f"details: contactlab show {shell_word(report.store)} {chosen.run_id[:8]}")
    return Items(tuple(texts), title)
