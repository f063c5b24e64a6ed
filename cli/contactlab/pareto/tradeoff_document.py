"""Describes the trade-off of accuracy and time of a sweep, and the recommended configuration."""

from collections.abc import Iterator

from contactlab.pareto.recommendation import (
    next_step_text,
    robust_text,
    setting_text,
    settings_text,
)
from contactlab.printable import shell_word, shorten_lines
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
    Method,
    Recommendation,
    TradeoffReport,
)


def describe_tradeoff(report: TradeoffReport) -> Document:
    """Describe the error and the time of configurations, their front, and the recommended one."""
    head = list[Block]()
    if report.task is not None:
        head.append(Sentence(report.task.line))
    if report.verdict is not None:
        head.append(Sentence(f"as written: {report.verdict.line}"))
    count = len(report.configurations)
    head.append(Headline(f"{report.sweep}: {count} configurations of {report.scene}"))
    head.append(Facts(tuple(_list_facts(report))))
    notes = tuple(Sentence(f"note: {note}") for note in report.notes)
    return document_of(
        Section(tuple(head), "head"),
        *_table_sections(report),
        *_answer_sections(report),
        Section(notes, "notes", follows=True),
    )


def _list_facts(report: TradeoffReport) -> Iterator[tuple[str, str]]:
    unit = f" [{report.error.unit}]" if report.error.unit not in {"", "any"} else ""
    source = "a timing pass" if report.time.source == "timing" else "the recorded runs"
    scenarios = ", ".join(report.scenarios) or "one"
    yield "runs of each", f"{report.runs_per_configuration} (scenarios: {scenarios})"
    reference_text = "against the model as written" if report.error.reference == "written" else None
    over = "mean" if report.error.name == REALITY else "largest"
    kind = ", ".join(filter(None, (report.error.kind, report.error.against, reference_text)))
    yield "error", f"{report.error.name}{unit}, {over} over the runs ({kind})"
    yield "time", f"CPU seconds per simulated second, mean over the runs, from {source}"
    limits = ", ".join(f"{name} <= {value:g}" for name, value in report.tolerances.items())
    yield "tolerances", limits or "none"
    yield "feasible", str(sum(each.feasible for each in report.configurations))
    if (current := report.baseline) is not None:
        # Settings, error and time of the model as written, and why it is not feasible.
        setting_names = [name for name in report.varying if current.configuration[name] is not None]
        settings = settings_text(current.configuration, setting_names, report.units)
        parts = [settings] if settings else []
        parts += [] if current.error is None else [f"error {format_amount(current.error)}"]
        parts += [] if current.time is None else [f"{format_amount(current.time)} CPU s per s"]
        yield "current", "; ".join([*parts, *current.reasons[:1]])


def _table_sections(report: TradeoffReport) -> Iterator[Section]:
    """Yield the front, the convergence of methods, and the rates of a chaotic motion."""
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
    header = (*_knob_titles(report), "error", "CPU s per s", "x real time")
    yield Section((table_of(header, rows),), "front", title)

    if len(report.methods) < len(report.configurations):
        methods = [
            (
                each.name,
                _order_text(each),
                f"{format_amount(each.floor.error)} up to {setting_text(each.floor.timestep, 's')}"
                if each.floor
                else "-",
            )
            for each in sorted(
                report.methods, key=lambda each: each.order.slope is None and each.floor is None
            )
        ]
        table = table_of(("method", "order", "floor"), methods, most=12)
        yield Section((table,), "convergence", "convergence of the error with the timestep")

    if report.chaotic:
        rates = [
            (
                *(each.configuration[name] for name in report.varying),
                f"{each.outcomes.good}/{each.outcomes.runs}",
                format_interval(each.outcomes.low, each.outcomes.high),
            )
            for each in report.configurations
        ]
        title = "chaotic: fraction of runs as expected, with its 95 % confidence interval"
        table = table_of((*_knob_titles(report), "as expected", "rate"), rates, most=40)
        yield Section((table,), "rates", title)


def _knob_titles(report: TradeoffReport) -> list[str]:
    units = (report.units.get(name, "") for name in report.varying)
    return [
        name if unit in {"", "1", "any"} else f"{name} [{unit}]"
        for name, unit in zip(report.varying, units, strict=True)
    ]


def _order_text(method: Method) -> str:
    order = method.order
    if order.slope is None or order.standard_error is None:
        return f"none: {order.reason}"
    return f"{order.slope:.2f} +- {order.standard_error:.2f} over {order.points} timesteps"


def _answer_sections(report: TradeoffReport) -> Iterator[Section]:
    chosen, robust = report.recommendation, report.robust
    if chosen is None:
        title = f"no configuration {'of mujoco ' if report.front else ''}is feasible"
        yield Section((Items(tuple(each.sentence for each in report.blockers), title),), "answer")
        return
    now = report.baseline and report.baseline.time
    title = f"recommended{f', {now / chosen.time:.2f}x as fast as written' if now else ''}"
    blocks: list[Block] = [_describe_choice(report, chosen, title)]
    if text := robust_text(report):
        blocks.append(Sentence(text))
    if robust is not None and robust.run_id != chosen.run_id:
        blocks.append(_describe_choice(report, robust))
    step = next_step_text(report) or "no feasible configuration is more accurate"
    yield Section((*blocks, Sentence(f"next step: {step}")), "answer")

    if report.baseline and chosen.configuration == report.baseline.configuration:
        yield Section((Sentence("No change recommended."),), "changes")
    elif not (chosen.mjcf or chosen.other):
        how = f"write the model: contactlab tradeoff {shell_word(report.store)} --model FOLDER"
        yield Section((Code((how,), indent=0),), "changes")
    else:
        most_lines = 12
        lines = shorten_lines(chosen.mjcf, most_lines, "the patch that --model FOLDER writes")
        lines += [f"{name}: {value}" for name, value in chosen.other.items()]
        yield Section((Code(tuple(lines)),), "changes", "changes of the model")


def _describe_choice(report: TradeoffReport, chosen: Recommendation, title: str = "") -> Items:
    error = "unknown" if chosen.error is None else format_amount(chosen.error)
    factor = format_amount(chosen.real_time_factor, "count")
    texts = [
        settings_text(chosen.configuration, report.varying, report.units) or "as in the sweep",
        f"error {error}; {format_amount(chosen.time)} CPU s per s, {factor}x real time",
    ]
    if chosen.margins:
        margins = (
            f"{name} {'unlimited' if each is None else format_amount(each)}"
            for name, each in chosen.margins.items()
        )
        texts.append(f"margins (tolerance over worst value): {', '.join(margins)}")
    if chosen.equally_fast:
        more = len(chosen.equally_fast)
        are = "configuration is" if more == 1 else "configurations are"
        texts.append(f"{more} other {are} as fast (within 5 %) and not more accurate")
    texts.append(f"details: contactlab show {shell_word(report.store)} {chosen.run_id[:8]}")
    return Items(tuple(texts), title)
