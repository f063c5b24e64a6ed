"""A comparison as plain text, Markdown, annotations of GitHub and JUnit XML, the worst first."""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from contactlab.ci_output import annotations, junit, junit_case
from contactlab.comparison.checks import format_number, format_settings, plural, value_change
from contactlab.comparison.policies import REMEASURED
from contactlab.printable import in_markdown, in_one_line
from contactlab.schema.comparison import (
    Check,
    CheckOutcome,
    ComparedStore,
    ComparisonReport,
    RunPair,
)

MOST_BYTES = 900_000  # a job summary of more than 1 MiB is lost
_WORDS: dict[CheckOutcome, str] = {
    "failed": "FAIL",
    "skipped": "SKIP",
    "warned": "WARN",
    "noted": "note",
    "passed": "ok",
}
_SIGNS = {"failed": "❌", "skipped": "⚪", "warned": "⚠️", "noted": "ℹ️", "passed": "✅"}  # noqa: RUF001
assert set(_SIGNS) == set(_WORDS)
_MOST_OF_OUTCOME, _WIDEST = 25, 60
_MOST_FIRST, _MOST_ROWS = 12, 1_000
_HEAD = ("| | check | result | worst | where |", "|---|---|---|---|---|")


class ReportLine(NamedTuple):
    """One line of a comparison: a check, its worst pair and where that is; errors are urgent."""

    outcome: CheckOutcome
    name: str
    message: str = ""
    worst: str = ""
    where: str = ""
    urgent: bool = False


def report_lines(report: ComparisonReport) -> list[ReportLine]:
    """Return the lines of all checks that did not pass, and of times that were measured again."""
    lines: list[ReportLine] = []
    skipped: dict[tuple[str, str], list[Check]] = {}
    for check in report.checks:
        if check.outcome == "skipped":
            skipped.setdefault((check.level, check.message), []).append(check)
        elif check.outcome != "passed" or check.name.startswith(REMEASURED):
            lines.append(_line(check))
    lines += [_line(same[0]) if len(same) == 1 else _together(same) for same in skipped.values()]
    order = list(_WORDS)
    return sorted(lines, key=lambda line: order.index(line.outcome))


def _line(check: Check) -> ReportLine:
    pair = check.worst[0] if check.worst else None
    return ReportLine(
        check.outcome,
        check.full_name,
        check.full_message,
        _pair_values(check, pair) if pair else "",
        _pair_location(pair) if pair else "",
        check.outcome in {"failed", "warned"} or check.is_open,
    )


def _together(checks: Sequence[Check]) -> ReportLine:
    """Return one line for all skipped checks of one reason and level."""
    names = list(dict.fromkeys(check.name.split()[0] for check in checks))
    where = ", ".join(names if len(names) <= 3 else [*names[:3], "..."])
    name = plural(len(checks), "check")
    return ReportLine("skipped", name, checks[0].message, "", where, checks[0].is_open)


def _pair_values(check: Check, pair: RunPair) -> str:
    """Return the values of a pair: `stable -> tunneling`, or numbers and their ratio."""
    before, after = pair.baseline, pair.candidate
    if before is None and after is None:
        return ""
    if before is None or after is None or isinstance(before, str) or isinstance(after, str):
        return f"{_value(before)} -> {_value(after)}"
    return value_change(before, after, check.unit)


def _value(value: float | str | None) -> str:
    if value is None:
        return "none"
    return value if isinstance(value, str) else format_number(value)


def _pair_location(pair: RunPair) -> str:
    """Return the axis values of a pair and the first digits of its run id."""
    run = (pair.candidate_run or pair.baseline_run or "")[:8]
    return f"{format_settings(pair.axes)} [{run}]".lstrip()


def _passed_summary(report: ComparisonReport) -> str:
    """Return how many checks of each kind passed."""
    kinds = [check.kind for check in report.checks if check.outcome == "passed"]
    counts = ", ".join(f"{kind} {kinds.count(kind)}" for kind in dict.fromkeys(kinds))
    return f"{plural(len(kinds), 'check')} passed{f' ({counts})' if counts else ''}"


def _run_summary(report: ComparisonReport) -> str:
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


def _label_changes(report: ComparisonReport) -> list[str]:
    """Return how many runs changed from which worst label to which."""
    return [
        f"{transition.baseline} -> {transition.candidate}: {plural(transition.runs)}"
        for transition in report.transitions
    ]


def _store_summary(store: ComparedStore) -> str:
    """Return a store's sweep, size, versions and date in one line."""
    revision = f", {store.git_revision[:12]}" if store.git_revision else ""
    return (
        f"{store.store}: {store.sweep}, {plural(store.runs)}, {store.engine}, "
        f"contactlab {store.contactlab}, {store.finished[:16].replace('T', ' ')}{revision}"
    )


def as_text(report: ComparisonReport) -> str:
    """Return a comparison as plain text, the worst first."""
    return "\n".join(in_one_line(line).rstrip() for line in _text_lines(report)) + "\n"


def _text_lines(report: ComparisonReport) -> Iterator[str]:
    yield report.headline
    if report.baseline is None or report.candidate is None:
        return
    yield ""
    yield f"  baseline   {_store_summary(report.baseline)}"
    yield f"  candidate  {_store_summary(report.candidate)}"
    yield f"  runs       {_run_summary(report)}"
    yield from (f"  label      {change}" for change in _label_changes(report))
    yield ""
    yield from _columns(report_lines(report))
    yield f"{_WORDS['passed']:4}  {_passed_summary(report)}"
    if report.advice:
        yield ""
        yield from report.advice


def _columns(lines: Sequence[ReportLine]) -> Iterator[str]:
    shown: list[ReportLine] = []
    for outcome, word in _WORDS.items():
        same = [line for line in lines if line.outcome == outcome]
        shown += same[:_MOST_OF_OUTCOME]
        if len(same) > _MOST_OF_OUTCOME:
            more = f"and {len(same) - _MOST_OF_OUTCOME:,} more ({word})"
            shown.append(ReportLine(outcome, more))
    names, messages, worst = (
        min(max((len(str(line[column])) for line in shown), default=0), _WIDEST)
        for column in (1, 2, 3)
    )
    for line in shown:
        start = f"{_WORDS[line.outcome]:4}  {line.name:{names}}  {line.message:{messages}}"
        yield f"{start}  {line.worst:{worst}}  {line.where}"


def as_markdown(report: ComparisonReport) -> str:
    """Return a comparison as Markdown of less than 0.9 MB, the worst first."""
    lines: list[str] = []
    left = MOST_BYTES - 1_000
    for line in _markdown_lines(report):
        left -= len(line.encode()) + 1
        if left < 0:
            lines.append("\nThe rest is left out: a job summary holds no more.\n")
            break
        lines.append(line)
    return "\n".join(lines) + "\n"


def _markdown_lines(report: ComparisonReport) -> Iterator[str]:
    sign = _SIGNS["passed" if report.exit_code == 0 else "failed"]
    yield f"### {sign} {in_markdown(report.headline)}"
    if report.baseline is None or report.candidate is None:
        return
    yield ""
    yield f"- baseline {in_markdown(_store_summary(report.baseline))}"
    yield f"- candidate {in_markdown(_store_summary(report.candidate))}"
    yield f"- runs: {in_markdown(_run_summary(report))}"
    if changes := _label_changes(report):
        yield f"- labels: {in_markdown(', '.join(changes))}"
    # Stable: within the urgent ones and the others the worst come first.
    shown = sorted(report_lines(report), key=lambda line: not line.urgent)
    first = min(_MOST_FIRST, sum(line.urgent for line in shown))
    yield from _rows(shown[:first])
    yield ""
    yield f"{_SIGNS['passed']} {_passed_summary(report)}"
    if rest := shown[first:]:
        yield from _folded(f"{len(rest)} more", _rows(rest))
    if report.advice:
        parts = (advice.partition(": ") for advice in report.advice)
        lines = (line for what, _, command in parts for line in (f"# {what}", command))
        commands = (in_one_line(line).replace("`", "'") for line in lines)
        yield from _folded("commands", ["", "```sh", *commands, "```"])


def _rows(lines: Sequence[ReportLine]) -> Iterator[str]:
    if not lines:
        return
    yield ""
    yield from _HEAD
    for line in lines[:_MOST_ROWS]:
        cells = (_SIGNS[line.outcome], *(in_markdown(cell) for cell in line[1:5]))
        yield f"| {' | '.join(cells)} |"
    if len(lines) > _MOST_ROWS:
        yield f"| | and {len(lines) - _MOST_ROWS:,} more | | | |"


def _folded(title: str, lines: Iterable[str]) -> Iterator[str]:
    yield ""
    yield f"<details><summary>{title}</summary>"
    yield from lines
    yield ""
    yield "</details>"


def as_annotations(report: ComparisonReport) -> str:
    """Return the annotations of errors and warnings: 9 of each, and how many more."""
    if report.baseline is None or report.candidate is None:
        return annotations("contactlab compare", [report.headline], [])
    errors: list[str] = []
    warnings: list[str] = []
    for line in report_lines(report):
        if line.urgent:
            where = f" ({line.worst} at {line.where})" if line.worst else ""
            kind = warnings if line.outcome == "warned" else errors
            kind.append(f"{line.name}: {line.message}{where}")
    return annotations(f"contactlab {report.candidate.sweep}", errors, warnings)


def as_junit(report: ComparisonReport) -> str:
    """Return a comparison as JUnit XML; what cannot be compared is a skipped case."""
    sweep = "stores" if report.baseline is None else report.baseline.sweep
    cases = [
        junit_case(
            check,
            (sweep, check.kind, check.group),
            check.verdict,
            [*_pairs(check), *(report.advice if check.outcome == "failed" else ())],
        )
        for check in report.checks
    ]
    return junit(f"contactlab compare {sweep}", cases)


def _pairs(check: Check) -> Iterator[str]:
    for pair in check.worst:
        values = _pair_values(check, pair)
        yield f"{check.full_name}: {f'{values} ' if values else ''}at {_pair_location(pair)}"
