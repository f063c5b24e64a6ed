"""What a comparison of engines says, as a report: what was compared, its checks and runs."""

from collections.abc import Iterator

from contactlab.judge.wording import format_settings
from contactlab.studies.parity.parity_report import ParityReport, RunParity
from contactlab.writers.report import Report, Section

_MOST_RUNS_LISTED = 40
_NUMBERS = ("position", "floor", "repeat", "one step")
HEADER = ("run", "verdict", "first difference", *_NUMBERS, "settings")


def report_of(compared: ParityReport) -> Report:
    """Return a comparison of engines as what is written of it."""
    more = len(compared.runs) - _MOST_RUNS_LISTED
    return Report(
        title=f"contactlab parity {compared.sweep} --against {compared.engine}",
        place=("parity", compared.engine),
        headline=compared.headline,
        passed=compared.exit_code == 0,
        record=compared,
        facts=tuple(("", line) for line in about(compared)),
        findings=compared.findings,
        sections=(Section("", header=HEADER, rows=tuple(map(row, shown(compared)))),),
        notes=(f"and {more} more runs, which --format json lists",) * (more > 0),
    )


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
