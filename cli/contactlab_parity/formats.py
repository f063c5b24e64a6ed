"""A parity report as text, Markdown, JUnit XML and annotations of GitHub."""

from collections.abc import Iterator, Sequence

from contactlab.ci_output import annotations, junit, junit_case
from contactlab.comparison.checks import format_settings
from contactlab.printable import in_markdown, in_one_line
from contactlab_parity.parity_report import ParityReport, RunParity

_WORDS = {"failed": "FAIL", "skipped": "SKIP", "warned": "WARN", "noted": "note", "passed": "ok"}
_MOST_RUNS = 40
_NUMBERS = ("position", "floor", "repeat", "one step")
HEADER = ("run", "verdict", "first difference", *_NUMBERS, "settings")


def as_text(report: ParityReport) -> str:
    """Return a report as plain text: headline, checks, closed form, and runs, the worst first."""
    lines = [report.headline, "", *(f"  {each}" for each in about(report)), ""]
    checks = [(_WORDS[each.outcome], each.name, each.full_message) for each in report.checks]
    lines += [*_columns(checks), "", *_columns([HEADER, *map(row, shown(report))])]
    more = len(report.runs) - _MOST_RUNS
    lines += [f"and {more} more runs, which --format json lists"] if more > 0 else []
    return "\n".join(in_one_line(line).rstrip() for line in lines) + "\n"


def _columns(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for cells in rows:
        yield "  ".join(f"{each:{width}}" for each, width in zip(cells, widths, strict=True))


def as_markdown(report: ParityReport) -> str:
    """Return a report as Markdown, for the summary of a job."""
    lines = [f"### {in_markdown(report.headline)}", ""]
    lines += [f"- {in_markdown(each)}" for each in about(report)]
    lines += ["", "| | check | result |", "|---|---|---|"]
    for each in report.checks:
        cells = (_WORDS[each.outcome], each.name, each.full_message)
        lines.append(f"| {' | '.join(map(in_markdown, cells))} |")
    lines += ["", f"| {' | '.join(HEADER)} |", "|---" * len(HEADER) + "|"]
    lines += [f"| {' | '.join(map(in_markdown, row(each)))} |" for each in shown(report)]
    return "\n".join(lines) + "\n"


def as_junit(report: ParityReport) -> str:
    """Return a report as JUnit XML: a test case a check."""
    cases = [
        junit_case(
            each,
            ("parity", report.engine, each.kind),
            each.verdict,
            [f"{format_settings(pair.axes)}: {pair.candidate}" for pair in each.worst],
        )
        for each in report.checks
    ]
    return junit(f"contactlab parity {report.sweep} --against {report.engine}", cases)


def as_annotations(report: ParityReport) -> str:
    """Return the annotations of failed checks and of runs that differ, and warnings, of GitHub."""
    told = {
        outcome: [
            f"{each.name}: {each.full_message}" for each in report.checks if each.outcome == outcome
        ]
        for outcome in ("failed", "warned")
    }
    runs = [each for each in shown(report) if each.verdict in {"different", "failed"}]
    differing = [f"{format_settings(each.axes)}: {each.first or each.reason}" for each in runs]
    title = f"contactlab parity {report.sweep} --against {report.engine}"
    return annotations(title, [*told["failed"], *differing], told["warned"])


def about(report: ParityReport) -> Iterator[str]:
    """Yield what was compared with what, and who is off where the scene has a closed form."""
    where = f" on {report.device}" if report.device else ""
    changed = f", with {', '.join(report.changes)}" if report.changes else ""
    yield (
        f"{report.sweep}: {report.scene} by MuJoCo {report.mujoco}, and by {report.engine} "
        f"{report.version}{where}{changed}"
    )
    if form := report.closed_form:
        off = {
            "mujoco": "MuJoCo is", "engine": f"{report.engine} is", "both": "both are",
            "neither": "neither is",
        }[form.off]  # fmt: skip
        yield (
            f"closed form: MuJoCo is within {form.mujoco:.3g}, {report.engine} within "
            f"{form.engine:.3g}; {off} off"
        )


def shown(report: ParityReport) -> list[RunParity]:
    """Return the runs that a table shows, the worst first."""
    order = ["failed", "refused", "different", "ambiguous", "within floor", "same"]
    ranked = sorted(
        report.runs, key=lambda each: (order.index(each.verdict), -(each.position or 0))
    )
    return ranked[:_MOST_RUNS]


def row(run: RunParity) -> tuple[str, ...]:
    """Return the cells of a run in a table, as HEADER names them."""
    numbers = [
        "" if each is None else f"{each:.2g}"
        for each in (run.position, run.floor, run.repeat, run.step)
    ]
    told = str(run.first) if run.first else run.reason
    seed = f" seed={run.seed}" if run.seed else ""
    return run.run_id[:8], run.verdict, told, *numbers, f"{format_settings(run.axes)}{seed}"
