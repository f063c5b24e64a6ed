"""Sections of a parity report: the compared runs, and the checks."""

from collections.abc import Iterator

from contactlab.judge.wording import format_settings
from contactlab.studies.parity.parity_report import ParityReport, RunParity
from contactlab.writers.report import Report, Section

_MOST_RUNS_LISTED = 40
_NUMBERS = ("position", "noise floor", "repeat", "one step")
HEADER = ("run", "verdict", "first difference", *_NUMBERS, "settings")


def report_of(compared: ParityReport) -> Report:
    """Return the parity report for the writers."""
    more = len(compared.runs) - _MOST_RUNS_LISTED
    return Report(
        title=f"contactlab parity {compared.sweep} --against {compared.engine}",
        place=("parity", compared.engine),
        headline=compared.headline,
        passed=compared.exit_code == 0,
        record=compared,
        facts=tuple(("", line) for line in describe_report(compared)),
        findings=compared.findings,
        sections=(Section("", header=HEADER, rows=tuple(map(run_cells, worst_runs(compared)))),),
        notes=(f"and {more} more runs; --format json lists them",) * (more > 0),
    )


def describe_report(report: ParityReport) -> Iterator[str]:
    """Yield the compared engines, and their differences from the closed form, if there is one."""
    where = f" on {report.device}" if report.device else ""
    changed = f", with {', '.join(report.changes)}" if report.changes else ""
    yield (
        f"{report.sweep}: {report.scene} by MuJoCo {report.mujoco}, and by {report.engine} "
        f"{report.version}{where}{changed}"
    )
    if form := report.closed_form:
        inaccurate = {
            "mujoco": "MuJoCo is", "engine": f"{report.engine} is", "both": "both are",
            "neither": "neither is",
        }[form.inaccurate]  # fmt: skip
        yield (
            f"closed form: error {form.mujoco:.3g} of MuJoCo, {form.engine:.3g} of "
            f"{report.engine}; {inaccurate} inaccurate"
        )


def worst_runs(report: ParityReport) -> list[RunParity]:
    """Return the runs of the table, the worst first."""
    order = ["failed", "refused", "different", "ambiguous", "within noise floor", "same"]
    ranked = sorted(report.runs, key=lambda run: (order.index(run.verdict), -(run.position or 0)))
    return ranked[:_MOST_RUNS_LISTED]


def run_cells(run: RunParity) -> tuple[str, ...]:
    """Return the cells of a run in a table, as HEADER names them."""
    numbers = [
        "" if number is None else f"{number:.2g}"
        for number in (run.position, run.noise_floor, run.repeat_difference, run.step)
    ]
    difference = str(run.first_divergence) if run.first_divergence else run.reason
    seed = f" seed={run.seed}" if run.seed else ""
    return run.run_id[:8], run.verdict, difference, *numbers, f"{format_settings(run.axes)}{seed}"
