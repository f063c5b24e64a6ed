"""Examines a model under its task: motions, budget, verdict, and the changes that mend it."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from contactlab.budget import (
    ErrorBudget,
    Motion,
    Remedy,
    Settings,
    Verdict,
    budget_report,
    error_budget,
    judge,
    remedies,
)
from contactlab.budget.remedies import CANDIDATES
from contactlab.budget.verdict import Word, percent
from contactlab.errors import SweepFileError
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.mujoco_versions import VERSION
from contactlab.scene.scene import Scene
from contactlab.schema.examination import Examination
from contactlab.schema.task import Task
from contactlab.studies.examine.changes import (
    MOST_CHANGES,
    confirmed,
    fresh,
    model_change,
    write_first,
)
from contactlab.studies.examine.facts import facts
from contactlab.studies.examine.task_motions import task_motions
from contactlab.studies.examine.watched import of_watched
from contactlab.studies.session import Values, read_settings

SETTINGS = Settings(priced=True)
_ALIKE = 1.1  # ratio of costs that are equal
_PLACES = {candidate.name: place for place, candidate in enumerate(CANDIDATES)}
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
        task: what replaces parts of the model's own.
        workers: threads; one for each processor by default.
        allow_code: whether policies and environments may run, which are code.
        write: file for the model with the first change that computes it otherwise.
        told: called with a line of text as a part of the examination begins.
    """

    model: str
    assign: Sequence[str] = ()
    task: TaskOptions = AS_INFERRED
    workers: int | None = None
    allow_code: bool = False
    write: Path | None = None
    told: Callable[[str], None] = lambda _: None


def run(request: ExamineRequest) -> Examination:
    """Examine a model.

    Raises:
        SceneError: there is no such model, keyframe or body, or it does not compile.
        SweepFileError: a setting is wrong, or the tolerance is no share.
        EngineError: nothing moves, or MuJoCo is not what simulates.
        OutputError: the changed model cannot be written.
    """
    if request.task.limits or (request.task.within or (0, "1"))[1] != "1":
        raise SweepFileError("'--within' is a share of the real forces here; write 10%")
    scenes = SceneLoader(Path(), request.task.drive, allow_code=request.allow_code)
    scene = scenes.open(request.model).with_effects("all")
    asked = [*request.assign, *request.task.settings]
    values, given = read_settings(scenes, request.model, asked, ("duration",))
    task = scene.task(values, given.duration, watch=request.task.watch, within=request.task.within)
    motions = task_motions(scene, values, task, allow_code=request.allow_code)
    request.told(f"examining {request.model}: {task.line}")
    workers = request.workers
    if workers is not None:
        workers = max(1, workers)
    measured = error_budget(motions, settings=SETTINGS, workers=workers)
    budget = of_watched(measured, task.watched)
    verdict = judge(budget, task.within)
    if verdict.reasons:
        request.told(f"{verdict.reasons[0].sentence}; looking for changes that remove it")
    tried = _tried(motions, verdict, task, workers)
    if tried and tried[0].removes:
        request.told("judging changes on fresh seeds")
        again = task_motions(scene, values, fresh(task), allow_code=request.allow_code)
        tried = tuple(sorted(confirmed(tried, again, verdict, workers), key=_by_use))
    helping = [remedy for remedy in tried if remedy.removes][:MOST_CHANGES]
    changes = tuple(model_change(scene, remedy, values) for remedy in helping)
    begins = {phase.name: phase.begin for phase in task.phases}
    report = Examination(
        model=request.model,
        mujoco=VERSION,
        task=task,
        sentence=_sentence(verdict, tried, task, budget),
        budget=budget_report(budget, verdict, tried),
        facts=facts(motions, [begins.get(motion.name, 0.0) for motion in motions]),
        changes=changes,
    )
    return report if request.write is None else _written(request, scene, values, report)


def _written(
    request: ExamineRequest, scene: Scene, values: Values, report: Examination
) -> Examination:
    """Write the model with the first change that computes it otherwise; say so if there is none."""
    assert request.write is not None
    made = write_first(scene, report.changes, values, request.write)
    if made is None:
        request.told(
            f"{request.write} is not written: no change of how the model is computed removes what "
            "the verdict names"
        )
        return report
    return report.model_copy(update={"written": str(request.write)})


def _tried(
    motions: Sequence[Motion], verdict: Verdict, task: Task, workers: int | None
) -> tuple[Remedy, ...]:
    """Try changes, the finest steps only if no coarser ones remove the verdict.

    A finer step costs about as many times as it is finer, so which are tried hangs on no clock.
    """
    tried, coarser = list[Remedy](), 0
    for finest in sorted({candidate.rate for candidate in CANDIDATES} - {1}):
        some = [candidate for candidate in CANDIDATES if coarser < candidate.rate <= finest]
        found = remedies(motions, verdict, settings=SETTINGS, candidates=some, workers=workers)
        tried += [_judged_again(remedy, verdict, task) for remedy in found]
        if any(remedy.removes for remedy in tried):
            break
        coarser = finest
    return tuple(sorted(tried, key=_by_use))


def _by_use(remedy: Remedy) -> tuple[bool, float, int]:
    """Return the place of a remedy: what removes, then what is cheap, then what is simple.

    Costs within a tenth are equal: the clock tells no more.
    """
    cost = round(math.log(remedy.price.ratio, _ALIKE)) if remedy.price else math.inf
    return not remedy.removes, cost, _PLACES[remedy.name]


def _judged_again(remedy: Remedy, verdict: Verdict, task: Task) -> Remedy:
    """Return a remedy by what it does for the watched bodies."""
    if not task.watched:
        return remedy
    budget = of_watched(remedy.budget, task.watched)
    found = judge(budget, verdict.within)
    removes = found.word == "sound" or (verdict.word != "model" and found.word == "model")
    return replace(remedy, removes=removes, budget=budget, verdict=found)


def _sentence(verdict: Verdict, tried: Sequence[Remedy], task: Task, budget: ErrorBudget) -> str:
    """Return a verdict in one sentence: what, where, when, and the cheapest change that mends it.

    Times count from the beginning of the run.
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
    return f"{_OPENINGS[verdict.word]}: {', '.join(parts)}{_remedied(tried)}"


def _remedied(tried: Sequence[Remedy]) -> str:
    if not tried:
        return ""
    best = tried[0]
    if not best.removes:
        return "; none of the changes tried removes it"
    cost = f", at {best.price.ratio:.2g} times the time" if best.price else ""
    return f"; removed by {best.name}{cost}"
