"""Describes the reports of commands that plan, check and copy stores."""

from collections.abc import Iterator
from math import prod

from contactlab.comparison.report import report_of
from contactlab.judge.wording import plural
from contactlab.plan.kept_traces import MANY_RUNS, OF_MANY
from contactlab.printable import shell_word
from contactlab.rendering.amounts import format_amount, format_percent
from contactlab.rendering.document import (
    Block,
    Commands,
    Document,
    Facts,
    Headline,
    Items,
    Sentence,
    document_of,
    table_of,
)
from contactlab.schema.store_reports import (
    Bisection,
    ExpandedTraces,
    RunReplay,
    StoreVerification,
    SweepForecast,
    WrittenBaseline,
    WrittenBundle,
    WrittenLock,
)
from contactlab.writers.report_document import describe_findings


def describe_forecast(report: SweepForecast) -> Document:
    """Describe the cost of a sweep, its warnings and its axes."""
    axes = [(axis.name, axis.role, axis.count, axis.values) for axis in report.axes]
    blocks: list[Block] = [Facts((*_forecast_facts(report),))]
    blocks += [Sentence(f"warning: {warning}") for warning in report.warnings]
    return document_of(blocks, [table_of(("axis", "role", "values", "range"), axes)])


def _forecast_facts(report: SweepForecast) -> Iterator[tuple[str, str]]:
    part, runs, steps = 1.0, f"{report.runs:,}", f"{report.steps:,}"
    if report.least_runs is not None:
        part = report.least_runs / report.runs
        runs, steps = f"{report.least_runs:,} to {runs}", f"{part * report.steps:,.0f} to {steps}"
    yield "runs", f"{runs} (seeds {report.seeds})"
    yield "steps", steps
    yield "start", report.start
    yield "drive", report.drive
    if report.seconds is None or report.bytes is None or report.memory_bytes is None:
        yield "time", "unknown: the runs execute code; add --allow-code to measure some of them"
        return
    least, most = report.seconds
    idle = f"{report.cores} idle core{'' if report.cores == 1 else 's'}"
    yield "time", f"{_range_text((part * least, most), 'long')} on {idle}"
    least_share = 0.05
    if report.checks_share >= least_share:
        yield "", f"{format_amount(report.checks_share, '%')} of the runs' time for their checks"
    passes = {
        "accuracy": report.accuracy_seconds,
        "timing": report.timing_seconds,
    }
    for name, seconds in passes.items():
        if seconds:
            yield "", f"{format_amount(seconds, 'long')} of it for {name}"
    yield "memory", f"at most {format_amount(report.memory_bytes, 'B')}"
    least, most = report.bytes
    least_bytes = 1e5  # smaller files do not matter
    is_large = report.scene_bytes >= least_bytes
    parts = [f"{_range_text((part * least, most), 'B')} of traces"] if most else []
    parts += [f"{format_amount(report.scene_bytes, 'B')} of the scene's files"] if is_large else []
    yield "disk", ", ".join([*parts, f"{format_amount(report.table_bytes, 'B')} of its table"])
    for form, size in report.bytes_by_format.items():
        if form != report.trace_format and size[1]:
            yield "", f"{_range_text(size, 'B')} with trace_format: {form}"
    if report.runs > MANY_RUNS and report.trace == OF_MANY:
        kept_runs = "those of unstable runs and 1,000 others; `trace: all` keeps all"
        yield "traces", f"{OF_MANY}: {kept_runs}"


def _range_text(least_most: tuple[float, float], unit: str) -> str:
    least, most = (format_amount(value, unit) for value in least_most)
    return f"{least} to {most}"


def describe_verification(report: StoreVerification) -> Document:
    """Describe whether a store is intact: its problems, or the extent of the check."""
    if not report.sound:
        return document_of([Items(report.problems)])
    left_out = " left out" if report.traces_left_out else ""
    runs, traces = plural(report.runs), plural(report.traces, "trace")
    return document_of(
        [
            Headline(f"{report.store} is sound: {runs}, {traces}{left_out}"),
            *(Sentence(f"not verified: {reason}") for reason in report.unverified),
            *(Sentence(text) for text in _simulation_text(report)),
            Facts((("physics", report.physics), ("digest", report.digest))),
        ]
    )


def _simulation_text(report: StoreVerification) -> Iterator[str]:
    if not report.simulation_asked:
        return
    text = f"simulated again: {report.simulated:,} of {report.simulation_asked:,}"
    if report.simulated < report.runs:
        forged = -(-report.runs // 100)
        missed = prod(
            max(0, report.runs - forged - position) / (report.runs - position)
            for position in range(report.simulated)
        )
        chance = f"chance to find {plural(forged, 'forged run')}: {format_percent(1 - missed)}"
        text += f", drawn from {report.runs:,} runs; {chance}"
    yield text


def describe_replay(report: RunReplay) -> Document:
    """Describe whether a run is reproduced bit for bit, or where it first differs."""
    if report.equal:
        return document_of([Headline(f"run {report.run_id}: bitwise equal ({report.hash})")])
    if report.stored_hash is None:
        return document_of([Headline(f"run {report.run_id}: no trajectory was stored")])
    facts = list[tuple[str, str]]()
    if report.step is not None:
        amount = "" if report.difference is None else f" by {report.difference:.3g}"
        facts.append(("first", f"after step {report.step}{amount}"))
    if report.damage is not None:
        facts.append(("trace", f"its stored trace is damaged: {report.damage}"))
    facts.append(("stored", f"{report.stored_hash} with {report.stored_engine}"))
    facts.append(("now", report.hash))
    return document_of([Headline(f"run {report.run_id}: differs"), Facts(tuple(facts))])


def describe_bisection(report: Bisection) -> Document:
    """Describe the release that changed an outcome, and the outcomes that it changed."""
    releases = plural(report.steps, "release")
    between = f"({releases} between the ends were run)"
    head: list[Block] = [
        Headline(f"MuJoCo {report.after} changed it, after {report.before} {between}")
    ]
    for version, reason in report.skipped.items():
        head.append(Sentence(f"or {version}, which does not run: {reason}"))
    if report.comparison is None:
        output = report.folder / report.after / "pytest.txt"
        return document_of([*head, Sentence(f"output of pytest: {output}")])
    return document_of(head, *describe_findings(report_of(report.comparison)).sections)


def describe_lock(report: WrittenLock) -> Document:
    """Describe a written lock."""
    holds = f"{report.file} holds the outcomes of {plural(report.runs)} of {report.store}"
    return document_of([Headline(holds), Commands((("check them", report.check),))])


def describe_baseline(report: WrittenBaseline) -> Document:
    """Describe a written baseline."""
    folder, size = report.baseline, format_amount(report.bytes, "B")
    holds = f"{folder} holds the {plural(report.runs)} of {report.store} without traces: {size}"
    compare = f"contactlab compare {shell_word(folder)} STORE --baseline-digest {report.digest}"
    return document_of([Headline(holds), Commands((("compare with it", compare),))])


def describe_expansion(report: ExpandedTraces) -> Document:
    """Describe traces that were written as messages."""
    count, size = plural(report.traces, "trace"), format_amount(report.bytes, "B")
    return document_of([Headline(f"{count} as messages in {report.folder}: {size}")])


def describe_bundle(report: WrittenBundle) -> Document:
    """Describe runs that were written for another machine."""
    runs = plural(report.runs)
    return document_of([Headline(f"{runs} in {report.folder}, for its check_newton.py")])
