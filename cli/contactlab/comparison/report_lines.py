"""The lines of a comparison, worst first, for any kind of output; and its plain text."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from contactlab.comparison.checks import format_number, format_settings, plural, value_change
from contactlab.comparison.policies import REMEASURED
from contactlab.printable import in_one_line
from contactlab.schema.comparison_report import Check, ComparedStore, ComparisonReport, RunPair
from contactlab.schema.judged_check import CheckOutcome

WORDS: dict[CheckOutcome, str] = {
    "failed": "FAIL",
    "skipped": "SKIP",
    "warned": "WARN",
    "noted": "note",
    "passed": "ok",
}
_MOST_LINES = 25
_WIDEST = 60


class ReportLine(NamedTuple):
    """One line of a comparison.

    Attributes:
        name: the check's name with its group, or how many checks.
        worst: values of the worst pair, or empty.
        where: its axis values and run, or empty.
        urgent: whether it is an error or a warning.
    """

    outcome: CheckOutcome
    name: str
    message: str
    worst: str
    where: str
    urgent: bool = False


def report_lines(report: ComparisonReport) -> list[ReportLine]:
    """Return the lines of all checks that did not pass, and of times that were measured again."""
    checks = [
        check
        for check in report.checks
        if check.outcome != "passed" or check.name.startswith(REMEASURED)
    ]
    lines = [_line(check) for check in checks if check.outcome != "skipped"]
    lines += _skipped([check for check in checks if check.outcome == "skipped"])
    order = list(WORDS)
    return sorted(lines, key=lambda line: order.index(line.outcome))


def pair_values(check: Check, pair: RunPair) -> str:
    """Return the values of a pair: `stable -> tunneling`, or numbers and their ratio."""
    before, after = pair.baseline, pair.candidate
    if before is None and after is None:
        return ""
    if before is None or after is None or isinstance(before, str) or isinstance(after, str):
        return f"{_value(before)} -> {_value(after)}"
    return value_change(before, after, check.unit)


def pair_location(pair: RunPair) -> str:
    """Return the axis values of a pair and the first digits of its run id."""
    run = (pair.candidate_run or pair.baseline_run or "")[:8]
    return f"{format_settings(pair.axes)} [{run}]".lstrip()


def passed_summary(report: ComparisonReport) -> str:
    """Return how many checks of each kind passed."""
    kinds = [check.kind for check in report.checks if check.outcome == "passed"]
    counts = ", ".join(f"{kind} {kinds.count(kind)}" for kind in dict.fromkeys(kinds))
    return f"{plural(len(kinds), 'check')} passed{f' ({counts})' if counts else ''}"


def run_summary(report: ComparisonReport) -> str:
    """Return how many runs are paired, equal, missing, new and on a knife edge."""
    pairs = report.pairs
    parts = [f"{pairs.paired:,} paired by {report.match}"]
    equal = "all" if pairs.bitwise_equal == pairs.paired else f"{pairs.bitwise_equal:,}"
    parts.append(f"{equal} bitwise equal")
    parts += [f"{pairs.missing:,} missing"] if pairs.missing else []
    parts += [f"{pairs.new:,} new"] if pairs.new else []
    if pairs.knife_edge:
        flipped = f" ({pairs.knife_edge_flipped:,} with another label now)"
        parts.append(f"{pairs.knife_edge:,} knife-edge{flipped}")
    return ", ".join(parts)


def label_changes(report: ComparisonReport) -> list[str]:
    """Return how many runs changed from which worst label to which."""
    return [
        f"{each.baseline} -> {each.candidate}: {plural(each.runs)}" for each in report.transitions
    ]


def store_summary(store: ComparedStore) -> str:
    """Return a store's sweep, size, versions and date in one line."""
    revision = f", {store.git_revision[:12]}" if store.git_revision else ""
    return (
        f"{store.store}: {store.sweep}, {plural(store.runs)}, {store.engine}, "
        f"contactlab {store.contactlab}, {store.finished[:16].replace('T', ' ')}{revision}"
    )


def _line(check: Check) -> ReportLine:
    pair = check.worst[0] if check.worst else None
    return ReportLine(
        check.outcome,
        check.full_name,
        check.full_message,
        pair_values(check, pair) if pair else "",
        pair_location(pair) if pair else "",
        check.outcome in {"failed", "warned"},
    )


def _skipped(checks: Sequence[Check]) -> list[ReportLine]:
    """Return one line for all skipped checks of one reason and level."""
    reasons: dict[tuple[str, str], list[Check]] = {}
    for check in checks:
        reasons.setdefault((check.level, check.message), []).append(check)
    return [
        ReportLine("skipped", *_together(same), level == "gate")
        for (level, _), same in reasons.items()
    ]


def _together(checks: Sequence[Check]) -> tuple[str, str, str, str]:
    reason = checks[0].message
    if len(checks) == 1:
        return checks[0].full_name, reason, "", ""
    names = list(dict.fromkeys(check.name.split()[0] for check in checks))
    shown = ", ".join(names[:3])
    return plural(len(checks), "check"), reason, "", shown if len(names) <= 3 else f"{shown}, ..."


def _value(value: float | str | None) -> str:
    if value is None:
        return "none"
    return value if isinstance(value, str) else format_number(value)


def as_text(report: ComparisonReport) -> str:
    """Return a comparison as plain text, the worst first."""
    return "\n".join(in_one_line(line).rstrip() for line in _lines(report)) + "\n"


def _lines(report: ComparisonReport) -> Iterator[str]:
    yield report.headline
    if report.baseline is None or report.candidate is None:
        return
    yield ""
    yield f"  baseline   {store_summary(report.baseline)}"
    yield f"  candidate  {store_summary(report.candidate)}"
    yield f"  runs       {run_summary(report)}"
    for each in label_changes(report):
        yield f"  label      {each}"
    yield ""
    yield from _table(report_lines(report))
    yield f"{WORDS['passed']:4}  {passed_summary(report)}"
    if report.advice:
        yield ""
        yield from report.advice


def _table(lines: Sequence[ReportLine]) -> Iterator[str]:
    shown: list[ReportLine] = []
    for outcome, word in WORDS.items():
        same = [line for line in lines if line.outcome == outcome]
        shown += same[:_MOST_LINES]
        if len(same) > _MOST_LINES:
            more = f"and {len(same) - _MOST_LINES:,} more ({word})"
            shown.append(ReportLine(outcome, more, "", "", ""))
    names, messages, worst = (
        min(max((len(str(line[column])) for line in shown), default=0), _WIDEST)
        for column in (1, 2, 3)
    )
    for line in shown:
        start = f"{WORDS[line.outcome]:4}  {line.name:{names}}  {line.message:{messages}}"
        yield f"{start}  {line.worst:{worst}}  {line.where}"
