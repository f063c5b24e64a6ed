"""The catalogue of hard cases: shipped sweeps whose expectations say what holds and what fails."""

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from contactlab import resources
from contactlab.errors import SweepFileError, did_you_mean
from contactlab.plan.overrides import Overrides
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.run.sweep_request import SweepRequest, read_request
from contactlab.scene.scene_source import MODEL_SUFFIXES, is_menagerie, menagerie_name
from contactlab.schema.check_report import StabilityReport, StabilityResult
from contactlab.schema.coverage import Exercised
from contactlab.schema.task import SEEDS
from contactlab.store.finished_store import Store
from contactlab.studies.session import Session
from contactlab.studies.task_verdict import records_of, refuse_lengths, task_verdict

FOLDER = "stability"


@dataclass(frozen=True)
class StabilityRequest:
    """Which cases to run."""

    # Cases of the catalogue; model files, folders of scenes or menagerie:ROBOT, for generic checks
    # of these; every case of the catalogue if empty.
    names: Sequence[str] = ()
    # What replaces parts of the task of models; its limits are of thresholds, by name.
    task: TaskOptions = AS_INFERRED
    assign: Sequence[str] = ()  # settings of models, `NAME=VALUE` each, as those of a sweep


class StabilityCase(NamedTuple):
    """One hard case: a sweep file, or the text of a generic one, with expectations."""

    name: str
    source: Path | str
    folder: Path  # where relative paths of its scene start
    origin: str  # what was named: a case, a model, a folder or a robot

    @property
    def is_generic(self) -> bool:
        """Whether it is the generic one of a model."""
        return isinstance(self.source, str)


def run(request: StabilityRequest, session: Session) -> StabilityReport:
    """Run hard cases, each into a store of its own; one that was interrupted is resumed.

    The session is notified of each case that is done. Cases of which this engine can do nothing are
    left out of the report. Raises a SweepFileError if there is no such case, or a setting is wrong,
    or not of a model; an OutputError if the session's folder cannot be written; a StoppedError if
    the session was stopped.
    """
    refuse_lengths(request.task)
    cases = find_cases(request.names)
    said = {"a drive": request.task.drive, "--watch": request.task.watch}
    said |= {"a share of --within": request.task.within}
    own = [*_assigned(request), *(name for name, value in said.items() if value)]
    if own and (shipped := [case.name for case in cases if not case.is_generic]):
        raise SweepFileError(
            f"{', '.join(own)}: '{shipped[0]}' is a case with settings and a drive of its own; "
            "give them to a model, or to the case's sweep"
        )
    for case in cases:
        session.claim(case.name, case.origin)
    results: list[StabilityResult] = []
    for number, case in enumerate(cases, 1):
        result = _run_case(case, session, request)
        session.notify(f"{number}/{len(cases)} {case.name}: {_verdict(result)}")
        results += [result] if result.runs else []
    return StabilityReport(tuple(results))


def _assigned(request: StabilityRequest) -> list[str]:
    limits = request.task.limits.items()
    return [
        *request.assign,
        *request.task.settings,
        *(f"thresholds.{name}={value!r}" for name, value in limits),
    ]


def find_cases(names: Sequence[str] = ()) -> list[StabilityCase]:
    """Return cases by name, or all; a generic one for a model file, a scene's folder or a robot."""
    known = {path.stem: path for path in sorted((resources.SWEEPS / FOLDER).glob("*.yaml"))}
    return [_case(name, known) for name in names or known]


def _run_case(case: StabilityCase, session: Session, request: StabilityRequest) -> StabilityResult:
    started = time.monotonic()
    store = session.folder / case.name
    sweep = read_request(
        case.source,
        case.name,
        store,
        folder=case.folder,
        workers=session.workers,
        overrides=Overrides(_assigned(request)),
        drive=request.task.drive,
        partly=True,
    )
    sweep = replace(sweep, fresh=(store / "manifest.json").is_file())
    rows = session.run(sweep).table.to_pylist() if sweep.plan.count else []
    seconds = time.monotonic() - started
    result = _result(sweep, rows, seconds, whole=case.is_generic)
    if not case.is_generic or not sweep.plan.count:
        return result
    values, asked = next(sweep.plan.runs()).values, request.task
    seeds, duration = sweep.plan.sweep.seed_values, sweep.plan.sweep.duration
    task = sweep.scene.task(
        values, duration, watch=asked.watch, within=asked.within, seeds=tuple(seeds)
    )
    store_of_runs = Store.open(store)
    records = records_of(store_of_runs, sweep.scene, values, task)
    verdict = task_verdict(task, sweep.scene, values, records, session)
    return result.model_copy(update={"task": task, "verdict": verdict})


def _case(name: str, known: dict[str, Path]) -> StabilityCase:
    if name in known:
        return StabilityCase(name, known[name], known[name].parent, name)
    path, robot = Path(name), is_menagerie(name)
    if robot or path.suffix in MODEL_SUFFIXES or path.is_dir():
        text = _GENERIC.format(scene=name if robot else path.resolve(), seeds=len(SEEDS))
        return StabilityCase(menagerie_name(name) if robot else path.stem, text, Path(), name)
    raise SweepFileError(
        f"no case '{name}'{did_you_mean(name, known)}; there are {', '.join(known)}, "
        "and any model file, folder of a scene or menagerie:ROBOT"
    )


_GENERIC = """\
version: 1
scene: "{scene}"
description: Generic checks of a model, from its start and from two slightly off
axes: {{}}
seeds: {seeds}
checks: all
trace: flagged
expect:
  - {{label: stable, reason: a sound model needs no excuse}}
"""


def _result(
    sweep: SweepRequest, rows: Sequence[Mapping[str, Any]], seconds: float, *, whole: bool
) -> StabilityResult:
    """Return the result of a case, which is about all of its model's parts if it is `whole`."""
    expected = [row for row in rows if row["expectation_met"] is not None]
    stable = [row for row in expected if "stable" in (row["expected"] or ["stable"])]
    failed = [row for row in stable if not row["expectation_met"]]
    errors = [row["oracle_error"] for row in stable if row["oracle_error"] is not None]
    steps = [row["label_step"] for row in failed if row["label_step"] is not None]
    return StabilityResult(
        name=sweep.name,
        runs=len(rows),
        asked=len(expected),
        met=sum(row["expectation_met"] for row in expected),
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
        left_out=sweep.left_out,
        not_exercised=Exercised.of(rows).idle() if whole else (),
    )


def _verdict(result: StabilityResult) -> str:
    left_out = "; left out: " + "; ".join(result.left_out) if result.left_out else ""
    if not result.runs:
        return "skipped" + left_out
    return ("ok" if result.passed else "NOT AS EXPECTED") + left_out
