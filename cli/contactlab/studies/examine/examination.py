"""Examines a model under its task: runs and labels, budget and verdict, checks, and changes.

Each part of the report is a section that may be asked for alone, with the same numbers: `check`,
`stability` and `explain` of a model ask for theirs.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

import numpy as np

from contactlab.budget import (
    ErrorBudget,
    Motion,
    Remedy,
    Settings,
    Trial,
    Verdict,
    budget_report,
)
from contactlab.budget.verdict import Word, percent
from contactlab.engines.closed_loop import allowed_policy
from contactlab.errors import SceneError, SweepFileError
from contactlab.judge.conclusion import failed_names
from contactlab.judge.limits import LIMITS
from contactlab.judge.waivers import unused_waivers
from contactlab.measure import THRESHOLDS
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.printable import first_names
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.mujoco_versions import VERSION
from contactlab.schema.coverage import Exercised
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.examination import MOST_CHANGES, Examination, RunLabel, SectionName
from contactlab.schema.finding import Waiver
from contactlab.schema.task import Task
from contactlab.store.table_layout import record_to_row
from contactlab.studies.check.check_entries import CHECKS, Check
from contactlab.studies.check.checked_model import CheckedModel
from contactlab.studies.check.chosen_checks import chosen_checks, judged_findings
from contactlab.studies.check.own_runs import reference_of
from contactlab.studies.examine.changes import Again, Changes, fresh
from contactlab.studies.examine.facts import facts
from contactlab.studies.examine.linted_file import file_facts
from contactlab.studies.examine.resting_contacts import resting_contacts
from contactlab.studies.examine.task_motions import Change
from contactlab.studies.grip.grip_fact import grip_facts
from contactlab.studies.session import Session, Values, read_settings
from contactlab.studies.task_verdict import refuse_lengths, run_labels

SECTIONS: tuple[SectionName, ...] = get_args(SectionName)
REFERENCE = "reference.json"
RESULTS = "examine"
"""Name of its place in a folder of results."""
_OF_MOTIONS = {"budget", "facts", "changes"}
_OF_RUNS = {"labels", "checks", "contacts"}
SETTINGS = Settings(priced=True)
MAX_CPU = 60.0
"""CPU within which an examination ends, its page included [s]."""
# Parts of it by whose end rows that judge nothing, and changes, have been measured.
_BUDGETING, _CHANGING = 0.4, 0.7
_CHANGED = "changed"  # store of runs with a change
_NOT_MOVED = "sound as far as labels tell: MuJoCo moves nothing in it"
_OPENINGS: Mapping[Word, str] = {
    "unresolved": "unresolved",
    "not resolved": "not resolved",
    "model": "numerically sound, but its softness decides",
    "sound": "sound",
}


@dataclass(frozen=True)
class ExamineRequest:
    """Which model to examine, and how.

    Attributes:
        model: a scene, its folder, a model file, or a robot.
        assign: settings, `NAME=VALUE` each.
        task: what replaces parts of the model's own; its limits are of checks or labels, by name.
        sections: parts of the report that are wanted.
        checks: names of checks; all if empty.
        accepted: findings of checks that are known and accepted.
        write: file for the model with the first change that computes it otherwise.
        accept: words of changes that make another model, which are written too.
        max_cpu: CPU within which it ends [s], with what is known by then.
        begins: called with words as a part of the examination begins.
    """

    model: str
    assign: Sequence[str] = ()
    task: TaskOptions = AS_INFERRED
    sections: tuple[SectionName, ...] = SECTIONS
    checks: Sequence[str] = ()
    accepted: Sequence[Waiver] = ()
    write: Path | None = None
    accept: Sequence[str] = ()
    max_cpu: float = MAX_CPU
    begins: Callable[[str], None] = lambda _: None

    @property
    def has_runs(self) -> bool:
        """Whether a wanted section is read from stored runs, which a page needs."""
        return bool({*self.sections} & _OF_RUNS)

    @property
    def parts(self) -> int:
        """Number of parts that it has at most."""
        wanted = {*self.sections}
        measured = wanted != {"contacts"}
        return self.has_runs + ("checks" in wanted) + measured + 2 * ("changes" in wanted)


def run(request: ExamineRequest, session: Session) -> Examination:
    """Examine a model; its runs are stored in the session's folder.

    Raises:
        SceneError: there is no such model, keyframe or body, or it does not compile.
        SweepFileError: a setting or the name of a check or limit is wrong, or the tolerance is no
            share.
        EngineError: nothing moves, or MuJoCo is not what simulates.
        PolicyError: what is accepted is no finding of any check.
        OutputError: stores or the changed model cannot be written.
        StoppedError: it was interrupted.
    """
    begun, wanted = time.process_time(), {*request.sections}
    checks = {name: CHECKS[name] for name in chosen_checks(request.checks)}
    judged_findings([], request.accepted)
    examined = open_model(request, session)
    task = examined.task
    if wanted & _OF_MOTIONS and not examined.moves:
        examined.motions_of(task)  # which says why there are none, before anything is run
    session.claim(RESULTS, request.model)
    session.notify(f"examining {request.model}: {task.line}")
    report = Examination(
        model=request.model, mujoco=VERSION, task=task, sections=request.sections, sentence=""
    )
    if request.has_runs:
        request.begins("running its task")
        report = _ran(report, examined)
    if "checks" in wanted:
        request.begins("checking it")
        report = _checked(report, checks, examined, request.accepted)
    until = begun + _CHANGING * request.max_cpu
    return report if wanted == {"contacts"} else _measured(request, report, examined, until)


def _ran(report: Examination, examined: CheckedModel) -> Examination:
    """Return a report with what the runs of the task show."""
    if "contacts" in report.sections:
        contacts = tuple(resting_contacts(examined))
        report = report.model_copy(update={"contacts": contacts})
    if report.sections == ("contacts",):
        return report
    budget = examined.budget if examined.moves else None
    labels = tuple(
        label.model_copy(update={"reason": examined.told(label.reason)})
        for label in run_labels(report.task, [run.record for run in examined.runs], budget)
    )
    return report.model_copy(update={"verdict": examined.verdict, "labels": labels})


def _measured(
    request: ExamineRequest, report: Examination, examined: CheckedModel, until: float
) -> Examination:
    """Return a report with its budget, facts and changes, and the verdict in a sentence.

    Changes are tried until the process has used so much CPU [s].
    """
    request.begins("measuring its error budget")
    if not examined.moves:
        return report.model_copy(update={"sentence": _whole(_NOT_MOVED, report)})
    task, verdict, changes = report.task, examined.judged, None
    if "changes" in request.sections:
        changes = _changes(request, examined, verdict, report.labels, until)
    tried = changes.tried if changes else ()
    untried = [*examined.unmeasured, *(changes.untried if changes else ())]
    if "facts" in request.sections:
        begins = {phase.name: phase.begin for phase in task.phases}
        times = [begins.get(motion.name, 0.0) for motion in examined.motions]
        found = facts(examined.motions, times)
        if not request.assign:
            found += grip_facts(request.model, examined.motions[0].model, task.start)
            found += tuple(file_facts(request.model))
        report = report.model_copy(update={"facts": found})
    late, told = bool(changes and changes.untried), changes.told() if changes else ()
    sentence = _sentence(verdict, tried, task, examined.budget, late=late)
    unlabelling = [change.name for change in told if change.removes == "labels"]
    if verdict.reasons and unlabelling and not any(remedy.removes for remedy in tried):
        sentence += f"; {unlabelling[0]} leaves no label"
    report = report.model_copy(
        update={
            "sentence": _whole(sentence, report),
            "budget": budget_report(examined.budget, verdict, tried),
            "changes": told,
            "untried": tuple(untried),
        }
    )
    return _written(request, examined, report, changes)


def sections_of(names: Sequence[str]) -> tuple[SectionName, ...]:
    """Return the sections of these names, in the order of a report; all if none is named.

    Raises:
        SweepFileError: there is no such section.
    """
    for name in names:
        others = f"; there are {', '.join(SECTIONS)}"
        SweepFileError.unless_known(
            name, SECTIONS, f"no section '{name}' of an examination", others
        )
    return tuple(section for section in SECTIONS if section in names or not names)


def open_model(request: ExamineRequest, session: Session) -> CheckedModel:
    """Open a model for its examination.

    Raises:
        SceneError: there is no such model, keyframe or body, it does not compile, or its drive is
            code that may not run.
        SweepFileError: a setting or the name of a limit is wrong, or the tolerance is no share.
    """
    refuse_lengths(request.task)
    if request.accept and request.write is None:
        raise SweepFileError("'--accept' says what is written; name the file too: --write FILE")
    names = {**LIMITS, **THRESHOLDS}
    for name in request.task.limits:
        SweepFileError.unless_known(name, names, f"no limit '{name}' of a check or a label")
    scenes = SceneLoader(Path(), request.task.drive, allow_code=session.allow_code)
    asked = [*request.assign, *request.task.settings]
    values, given = read_settings(scenes, request.model, asked, ("duration", "must"))
    limits = request.task.limits
    rows = {"budget", "changes"} & {*request.sections}
    examined = CheckedModel(
        reference=request.model,
        scenes=scenes,
        # A handful of runs, which one process makes at once.
        session=replace(session, workers=0),
        threads=max(1, session.workers),
        values=values,
        duration=given.duration,
        options=request.task,
        thresholds={name: limits[name] for name in limits if name in THRESHOLDS},
        limits={name: limits[name] for name in limits if name in LIMITS},
        settings=SETTINGS if rows else Settings(places=False),
        rows=None if rows else (),
        seconds=_BUDGETING * request.max_cpu,
    )
    allowed_policy(examined.scene.drive, allowed=session.allow_code)
    step = examined.resolved.timestep
    if not 0 < step < math.inf:
        raise SceneError(
            f"{examined.scene.source.model}: its timestep is {step:g} s; write one above 0 there, "
            "or `--set timestep=`"
        )
    return examined


def _checked(
    report: Examination,
    checks: Mapping[str, Check],
    examined: CheckedModel,
    accepted: Sequence[Waiver],
) -> Examination:
    """Return a report with its checks and their findings, and the acceptances that are stale."""
    results = [check(examined) for check in checks.values()]
    findings = judged_findings(results, accepted)
    stale = (
        f"'{entry.check}' is accepted ({entry.reason}), but does not fail: remove it"
        for entry in unused_waivers(findings, accepted)
    )
    idle = Exercised.of(record_to_row(run.record) for run in examined.runs).idle()
    if "repeat" in checks and examined.runs[0].record.trajectory_hash is not None:
        reference = reference_of(examined.runs[0]).model_dump_json(indent=2) + "\n"
        examined.session.write({REFERENCE: reference})
    return report.model_copy(
        update={
            "checks": tuple(results),
            "findings": tuple(findings),
            "notes": (*report.notes, *stale, *map(first_names, map(examined.told, idle))),
        }
    )


def _changes(
    request: ExamineRequest,
    examined: CheckedModel,
    verdict: Verdict,
    labels: Sequence[RunLabel],
    until: float,
) -> Changes:
    """Return the changes that were tried, and those that help on fresh seeds too."""
    task, threads = examined.task, examined.threads
    if verdict.reasons:
        request.begins(f"{verdict.reasons[0].sentence}; looking for changes that remove it")

    def moved(settings: Values, change: Change, file: Path | None) -> Iterator[list[Motion]]:
        scene = examined.scenes.open(str(file)) if file else None
        for seeds in (task, fresh(task)):
            yield examined.motions_of(seeds, settings, change, scene)

    def left() -> float:
        return until - time.process_time()

    trial = Trial(SETTINGS, None, MOST_CHANGES, request.accept, threads, left)

    def labelled(settings: Values) -> Iterator[tuple[RunLabel, ...]]:
        first, *others = (*task.seeds, *fresh(task).seeds)
        records = list[EvidenceRecord]()
        for seeds in ([first], others):
            runs = examined.run(_CHANGED, "With a change", settings, seeds=seeds, trace="none")
            records += [run.record for run in runs]
            yield run_labels(task, records)

    scene, values = examined.scene.with_effects("all"), examined.values
    again = Again(moved, labelled, labels)
    return Changes(scene, values, examined.motions, verdict, trial, again)


def _written(
    request: ExamineRequest, examined: CheckedModel, report: Examination, changes: Changes | None
) -> Examination:
    """Write the model with what is accepted, or the first change of computation; or say why not."""
    if request.write is None or changes is None:
        return report
    made, reason = changes.write(request.write)
    if made is None:
        examined.session.notify(f"{request.write} is not written: {reason}")
        return report
    asked = made.resolve() == request.write.resolve()
    return report.model_copy(update={"written": str(request.write if asked else made)})


def _sentence(
    verdict: Verdict,
    tried: Sequence[Remedy],
    task: Task,
    budget: ErrorBudget,
    *,
    late: bool = False,
) -> str:
    """Return a verdict in one sentence: what, where, when, and the cheapest change that mends it.

    Times count from the beginning of the run. `late` says that there was no time for all changes.
    """
    if not verdict.reasons:
        phase = max(budget.phases, key=lambda phase: phase.run.share)
        worst = f"{percent(phase.run.share)} in the worst body, {phase.bodies[phase.run.body]}"
        return f"sound within {percent(verdict.within)}: {worst}"
    reason = verdict.reasons[0]
    parts = [reason.sentence]
    if reason.place and reason.place not in reason.sentence:
        parts.append(f"most at {reason.place}")
    if not np.isfinite(reason.time):
        parts.append(f"in the phase {reason.phase}")
    else:
        begins = {phase.name: phase.begin for phase in task.phases}
        parts.append(f"at {begins.get(reason.phase, 0.0) + reason.time:.2f} s")
    return f"{_OPENINGS[verdict.word]}: {', '.join(parts)}{_remedied(tried, late=late)}"


def _whole(numerics: str, report: Examination) -> str:
    """Return the sentence of a verdict with what runs and checks show besides the numerics."""
    failed, own = failed_names(report.findings), {"phantom_forces", "labelled_runs"}
    judged = not report.findings or "labelled_runs" in failed
    phases = dict.fromkeys(label.phase for label in report.labels if judged)
    found = [
        f"labelled {_listed([each.label for each in report.labels if each.phase == phase])} in "
        f"{phase}"
        for phase in phases
    ]
    found += [f"fails {name}" for name in failed if name not in own]
    if not found:
        return numerics
    if numerics.startswith((_OPENINGS["sound"], _OPENINGS["model"])):
        opening = "" if numerics.startswith(_OPENINGS["model"]) else "numerically "
        return f"not sound: {', '.join(found)}; {opening}{numerics}"
    return f"{numerics}; {', '.join(found)}"


def _listed(names: Sequence[str]) -> str:
    *first, last = names
    return " and ".join(filter(None, (", ".join(first), last)))


def _remedied(tried: Sequence[Remedy], *, late: bool) -> str:
    if not tried:
        return "; there was no time to try changes" if late else ""
    best = tried[0]
    if not best.removes:
        more = ", and there was no time for all" if late else ""
        return f"; none of the changes tried removes it{more}"
    cost = f", at {best.price.ratio:.2g} times the time" if best.price else ""
    kind = ", another model" if best.physics else ""
    return f"; removed by {best.name}{kind}{cost}"
