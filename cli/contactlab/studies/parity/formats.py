"""A parity report as text, Markdown, JUnit XML and annotations of GitHub."""

from collections.abc import Iterator, Sequence

from contactlab.ci_output import annotations, junit, junit_case
from contactlab.comparison.checks import format_settings
from contactlab.printable import in_markdown, in_one_line
from contactlab.studies.parity.parity_report import ParityReport, RunParity

_WORDS = {"failed": "FAIL", "skipped": "SKIP", "warned": "WARN", "noted": "note", "passed": "ok"}
_MOST_RUNS_LISTED = 40
_NUMBERS = ("position", "floor", "repeat", "one step")
HEADER = ("run", "verdict", "first difference", *_NUMBERS, "settings")


def as_text(report: ParityReport) -> str:
    """Return a report as plain text: headline, checks, closed form, and runs, the worst first."""
    lines = [report.headline, "", *(f"  {line}" for line in about(report)), ""]
    checks = [(_WORDS[check.outcome], check.name, check.full_message) for check in report.checks]
    lines += [*_columns(checks), "", *_columns([HEADER, *map(row, shown(report))])]
    more = len(report.runs) - _MOST_RUNS_LISTED
    lines += [f"and {more} more runs, which --format json lists"] if more > 0 else []
    return "\n".join(in_one_line(line).rstrip() for line in lines) + "\n"


def _columns(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for cells in rows:
        yield "  ".join(f"{cell:{width}}" for cell, width in zip(cells, widths, strict=True))


def as_markdown(report: ParityReport) -> str:
    """Return a report as Markdown, for the summary of a job."""
    lines = [f"### {in_markdown(report.headline)}", ""]
    lines += [f"- {in_markdown(line)}" for line in about(report)]
    lines += ["", "| | check | result |", "|---|---|---|"]
    for check in report.checks:
        cells = (_WORDS[check.outcome], check.name, check.full_message)
        lines.append(f"| {' | '.join(map(in_markdown, cells))} |")
    lines += ["", f"| {' | '.join(HEADER)} |", "|---" * len(HEADER) + "|"]
    lines += [f"| {' | '.join(map(in_markdown, row(run)))} |" for run in shown(report)]
    return "\n".join(lines) + "\n"


def as_junit(report: ParityReport) -> str:
    """Return a report as JUnit XML: a test case a check."""
    cases = [
        junit_case(
            check,
            ("parity", report.engine, check.kind),
            check.verdict,
            [f"{format_settings(pair.axes)}: {pair.candidate}" for pair in check.worst],
        )
        for check in report.checks
    ]
    return junit(f"contactlab parity {report.sweep} --against {report.engine}", cases)


def as_annotations(report: ParityReport) -> str:
    """Return the annotations of failed checks and of runs that differ, and warnings, of GitHub."""
    told = {
        outcome: [
            f"{check.name}: {check.full_message}"
            for check in report.checks
            if check.outcome == outcome
        ]
        for outcome in ("failed", "warned")
    }
    runs = [run for run in shown(report) if run.verdict in {"different", "failed"}]
    differing = [f"{format_settings(run.axes)}: {run.first or run.reason}" for run in runs]
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
    ranked = sorted(report.runs, key=lambda run: (order.index(run.verdict), -(run.position or 0)))
    return ranked[:_MOST_RUNS_LISTED]


def row(run: RunParity) -> tuple[str, ...]:
    """Return the cells of a run in a table, as HEADER names them."""
    numbers = [
        "" if number is None else f"{number:.2g}"
        for number in (run.position, run.floor, run.repeat, run.step)
    ]
    told = str(run.first) if run.first else run.reason
    seed = f" seed={run.seed}" if run.seed else ""
    return run.run_id[:8], run.verdict, told, *numbers, f"{format_settings(run.axes)}{seed}"
