"""The catalogue of hard cases: shipped sweeps with expectations of which runs fail."""

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from contactlab import resources
from contactlab.errors import SweepFileError, did_you_mean
from contactlab.run.sweep_request import read_request
from contactlab.scene.scene_source import is_menagerie
from contactlab.schema.check_report import StabilityReport, StabilityResult
from contactlab.tasks.session import Session

FOLDER = "stability"


class StabilityCase(NamedTuple):
    """One hard case: a sweep file with expectations."""

    name: str
    source: Path


def run_cases(cases: Sequence[StabilityCase], session: Session) -> StabilityReport:
    """Run hard cases, each into a store of its own; one that was interrupted is resumed.

    The session is notified of each finished case. Cases that this engine cannot run are left out of
    the report. Raises an OutputError if the session's folder cannot be written; a
    StoppedError if the session was stopped.
    """
    for case in cases:
        session.claim(case.name, case.name)
    results: list[StabilityResult] = []
    for number, case in enumerate(cases, 1):
        started = time.monotonic()
        store = session.folder / case.name
        sweep = read_request(
            case.source,
            case.name,
            store,
            folder=case.source.parent,
            workers=session.workers,
            partly=True,
        )
        sweep = replace(sweep, fresh=(store / "manifest.json").is_file())
        rows = session.run(sweep).table.to_pylist() if sweep.plan.count else []
        seconds = time.monotonic() - started
        # Runs without an expectation count as runs only.
        expected = [row for row in rows if row["expectation_met"] is not None]
        stable = [row for row in expected if "stable" in (row["expected"] or ["stable"])]
        failed = [row for row in stable if not row["expectation_met"]]
        errors = [row["oracle_error"] for row in stable if row["oracle_error"] is not None]
        steps = [row["label_step"] for row in failed if row["label_step"] is not None]
        result = StabilityResult(
            name=sweep.name,
            runs=len(rows),
            expected=len(expected),
            as_expected=sum(row["expectation_met"] for row in expected),
            controls=sum(row["expectation_met"] for row in expected if row not in stable),
            labels=dict(Counter(row["label"] for row in rows)),
            error=max(errors, default=None),
            step=min(steps, default=None),
            misses=tuple(
                f"{row['run_id'][:8]}: {row['expectation_reason']}"
                + (f" ({row['label_reason']})" if row["label_reason"] else "")
                for row in expected
                if not row["expectation_met"]
            ),
            seconds=seconds,
            store=str(sweep.store),
            skipped=sweep.left_out,
        )
        verdict = "not run" if not result.runs else "ok" if result.passed else "NOT AS EXPECTED"
        skipped = "; skipped: " + "; ".join(result.skipped) if result.skipped else ""
        session.notify(f"{number}/{len(cases)} {case.name}: {verdict}{skipped}")
        results += [result] if result.runs else []
    return StabilityReport(tuple(results))


def find_cases(names: Sequence[str] = ()) -> list[StabilityCase]:
    """Return cases by name, or all.

    Raises:
        SweepFileError: there is no such case.
    """
    case_files = {path.stem: path for path in sorted((resources.SWEEPS / FOLDER).glob("*.yaml"))}
    for name in names:
        shipped = name in resources.scene_names()
        if name not in case_files and (shipped or is_menagerie(name) or set(name) & set("./")):
            raise SweepFileError(
                f"{name}: no case but a model; write `contactlab examine {name} --section labels`"
            )
        if name not in case_files:
            raise SweepFileError(
                f"no case '{name}'{did_you_mean(name, case_files)}; there are "
                f"{', '.join(case_files)}"
            )
    return [StabilityCase(name, case_files[name]) for name in names or case_files]
