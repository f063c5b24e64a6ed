"""Runs the original and a changed model next to each other, and compares every measure.

The runs load a model in the ways that its users will: its task from the seeds that settings were
chosen by and from fresh ones, rest, tilted gravity, doubled inputs, no actuation, each actuator
alone, and its grip. A fix that is meant to change the motion is also run without constraints, where
it has to move as the original does. A change passes if no measure is worse than the original's by
more than its tolerance.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from statistics import stdev

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.restarts import run_at_once
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.reporting.verified_measures import describe_measure, measure_change
from contactlab.schema.examination import RunLabel
from contactlab.schema.grip import GripReport
from contactlab.schema.task import Task
from contactlab.schema.verification import SkippedRun, VerifiedChange, VerifiedMeasure
from contactlab.shares import SURE, unequal_chance
from contactlab.studies.verification.falls import repeat_measure
from contactlab.studies.verification.grip_measures import compare_grips
from contactlab.studies.verification.loop_runs import LoopRuns, has_policy
from contactlab.studies.verification.panel_cost import MAX_TRACKED_ACTUATORS
from contactlab.studies.verification.run_measures import (
    RELATIVE_TOLERANCE,
    Tables,
    compare_run,
    find_chaotic_bodies,
    find_unresolved_bodies,
    is_chaotic,
    tabulate_run,
)
from contactlab.studies.verification.runs import (
    PairedRun,
    build_doubled_run,
    build_load_runs,
    build_tracking_runs,
    build_unconstrained_runs,
    pair_motions,
)
from contactlab.studies.verification.state_tables import EXTREME_UNITS, StateTable
from contactlab.tasks.checked_model import CheckedModel
from contactlab.tasks.reference_error import ErrorEstimate, TaskReference
from contactlab.tasks.task_motions import shorten_task, with_new_seeds
from contactlab.tasks.task_verdict import run_labels
from contactlab.temporary_folders import temporary_folder

ERROR_FLOOR = 1e-3
"""Numerical error that no setting is rejected for: a tenth of a percent of the real forces is far
below the error of any measured parameter."""
REPEATED_RUNS = 16
LABEL_CHANCE = 0.125
"""A label of chaotic motion is worse if three of sixteen runs have it that none had: equal models
have that by chance once in nine times, and a new label was seen before."""
_RATES = (8, 10, 12, 16, 20, 24, 25, 32, 40)
"""Steps of the reference in one step of the original. One of them fits nearly any usual ratio."""
_LEAST_STEPS = 2
"""Steps of the reference in one of the changed model. A reference with one is the changed model
itself, so that its error seems to be zero."""
_COARSE_RATES = (2, 3, 4, 5, 6)
"""The same of a reference that is fine enough for errors far below the limit."""
_CLEAR_SHARE = 0.25
"""A coarse reference decides errors below this share of the limit. Against half the step, an error
of first order shows by half, so against a fine step it is at most half of the limit."""


@dataclass(frozen=True)
class OriginalRuns:
    """Runs of an original model, which are the same for every change of it.

    Attributes:
        tables: states of the original, its reference and its twin, by the name of the run and the
            timestep of the reference [s].
        labels: how many runs have each label, by the name of the task.
        references: motions at a fine step with the original's own error, by the name of the task
            and the rate of the reference.
        grips: reports of its grips, by keyframe; None for one that cannot be judged.
        falls: states of the original from nudged starts, by the name of the run.
        chaotic_bodies: which judged bodies end elsewhere after a nudge, if known.
        unresolved_bodies: which judged bodies end elsewhere at a finer step than the reference's,
            by the name of the run and the timestep of the reference [s].
    """

    tables: dict[tuple[str, float], tuple[StateTable, StateTable, StateTable]] = field(
        default_factory=dict[tuple[str, float], tuple[StateTable, StateTable, StateTable]]
    )
    labels: dict[str, Counter[str]] = field(default_factory=dict[str, Counter[str]])
    references: dict[tuple[str, int], tuple[TaskReference, ErrorEstimate]] = field(
        default_factory=dict[tuple[str, int], tuple[TaskReference, ErrorEstimate]]
    )
    grips: dict[str | None, GripReport | None] = field(
        default_factory=dict[str | None, GripReport | None]
    )
    falls: dict[str, StateTable] = field(default_factory=dict[str, StateTable])
    chaotic_bodies: list[np.ndarray] = field(default_factory=list[np.ndarray])
    unresolved_bodies: dict[tuple[str, float], np.ndarray] = field(
        default_factory=dict[tuple[str, float], np.ndarray]
    )


@dataclass(frozen=True)
class VerificationRequest:
    """A changed model to verify against its original.

    Attributes:
        original: the model as its author wrote it.
        changed: the changed model, as saved.
        same_model: True if the change computes the same model in another way. Otherwise it is
            another model, and has its own reference for the numerical error.
        keeps_motion: False if the change is meant to move bodies otherwise, as one that removes a
            failure is. Then ends of bodies are compared in runs without constraints only.
        keeps_start: False if the change only begins elsewhere. Then joint limits, rest, energy and
            tracking are not compared: they depend on where a body falls from and comes to rest.
        must_improve: names of measures; the largest of them has to become better by more than its
            spread.
        allowed_error: error that the change may cost, as a share of each motion. 0 demands that it
            is no less accurate than the original.
        stop_early: True to stop at the first measure that is worse.
        with_labels: False if the caller compares the labels of runs.
        most_seeds: most seeds of the task, on its own and fresh; None for all.
        length_share: share of the length of each run, if a model is too slow for whole runs.
        runs: of the original; pass the same object to verify several changes of one model.
        notify: called with the name of each run as it begins.
        find_time_left: returns the time that is left [s]; runs that would begin later are skipped.
    """

    original: CheckedModel
    changed: CheckedModel
    same_model: bool = True
    keeps_motion: bool = True
    keeps_start: bool = True
    must_improve: tuple[str, ...] = ()
    allowed_error: float = 0.0
    stop_early: bool = False
    with_labels: bool = True
    most_seeds: int | None = None
    length_share: float = 1.0
    runs: OriginalRuns = field(default_factory=OriginalRuns)
    notify: Callable[[str], None] = lambda _: None
    find_time_left: Callable[[], float] = lambda: math.inf


def verify_change(request: VerificationRequest) -> VerifiedChange:
    """Run original and changed model next to each other, and compare all measures.

    Raises:
        EngineError: nothing moves in the original, or another engine than MuJoCo simulates it.
    """
    return Verification(request).complete_runs()


class Verification:
    """The verification of one change. Its loads may come long before its other runs."""

    def __init__(self, request: VerificationRequest) -> None:
        """Run nothing yet."""
        self._request, self._panel = request, _Panel(request)
        self._measures = list[VerifiedMeasure]()
        self._loads, self._others = self._panel.measure_loads(), self._panel.measure_others()

    def run_loads(self) -> bool:
        """Run the loads, which need no seeds of the task; return whether a measure is worse."""
        self._compare_runs(self._loads)
        return self._finds_harm

    def complete_runs(self) -> VerifiedChange:
        """Run all that was not run, and return the result.

        Raises:
            EngineError: nothing moves in the original, or another engine than MuJoCo simulates it.
        """
        for runs in (self._loads, self._others):
            if not (self._finds_harm and self._request.stop_early):
                self._compare_runs(runs)
        measures, request, panel = self._measures, self._request, self._panel
        # A change that is meant to improve a measure has to do so beyond the spread of its repeats.
        aims = [measure for measure in measures if measure.name in request.must_improve]
        aim = max(aims, key=lambda measure: measure.before or 0.0, default=None)
        is_better = not request.must_improve
        if aim is not None and aim.before is not None and aim.after is not None:
            is_better = aim.before - aim.after > aim.spread
        idle = not self._finds_harm and not is_better
        summary = summarize_measures(measures)
        if panel.ended_early and not measures:
            summary = "the time limit came before the first run"
        elif panel.ended_early and not self._finds_harm:
            summary += "; the time limit ended it early"
        if idle:
            summary = f"no {request.must_improve[0]} was measured"
            if aim is not None:
                summary = f"no better: {describe_measure(aim)}"
        task = _shorten_task(request)
        return VerifiedChange(
            seeds=task.seeds,
            fresh_seeds=with_new_seeds(task).seeds,
            measures=tuple(measures),
            skipped=tuple(panel.skipped),
            identical=panel.identical and not self._finds_harm,
            passed=not self._finds_harm and not idle,
            sentence=summary,
            ended_early=panel.ended_early,
        )

    @property
    def _finds_harm(self) -> bool:
        return any(measure.worse for measure in self._measures)

    def _compare_runs(self, runs: Iterator[VerifiedMeasure]) -> None:
        for measure in runs:
            self._measures.append(measure)
            if measure.worse and self._request.stop_early:
                return


def summarize_measures(measures: Sequence[VerifiedMeasure]) -> str:
    """Return the result in one line, such as "nothing worse in 14 measures of 5 runs"."""
    worse = [measure for measure in measures if measure.worse]
    if worse:
        first = worst_measure(worse)
        more = f" (and {len(worse) - 1} more)" if len(worse) > 1 else ""
        return f"{describe_measure(first)}{more}"
    runs = len({measure.run for measure in measures})
    # The line of a fix, and a point of the front, have the numerical error.
    others = (measure for measure in measures if measure.name != "numerical error")
    better = [measure for measure in others if _is_better(measure)]
    best = max(better, key=measure_change, default=None)
    gain = f"; {describe_measure(best)}" if best else ""
    return f"nothing worse in {len(measures)} measures of {runs} runs{gain}"


def _is_better(measure: VerifiedMeasure) -> bool:
    if measure.before is None or measure.after is None:
        return measure.before is None and not measure.worse
    gain = measure.before - measure.after
    return (-gain if measure.more_is_better else gain) > measure.tolerance


def worst_measure(measures: Sequence[VerifiedMeasure]) -> VerifiedMeasure:
    """Return the measure that exceeds its tolerance by the largest factor."""
    return max(measures, key=measure_change)


def _shorten_task(request: VerificationRequest) -> Task:
    task = shorten_task(request.original.task, request.length_share)
    return task.model_copy(update={"seeds": task.seeds[: request.most_seeds]})


class _Panel:
    """The runs of one verification."""

    def __init__(self, request: VerificationRequest) -> None:
        self._request = request
        self._original, self._changed = request.original, request.changed
        self.skipped = list[SkippedRun]()
        self.ended_early = False
        self._equal_runs = list[bool]()
        self._is_chaotic = False
        self._repeated = dict[str, Counter[str]]()
        task = _shorten_task(request)
        self._tasks = {"task": task, "task on fresh seeds": with_new_seeds(task)}
        self._motions = dict[str, tuple[list[Motion], list[Motion]]]()
        self._in_loop = has_policy(request.original)

    @property
    def _chaotic_bodies(self) -> np.ndarray:
        # Shorter runs may not show the chaos of the whole task.
        chaotic = self._request.runs.chaotic_bodies
        if not chaotic:
            task = self._original.task
            seeds = task.seeds[: self._request.most_seeds]
            motions = self._original.motions_of(task.model_copy(update={"seeds": seeds}))
            threads = self._original.threads
            chaotic.append(
                np.any([find_chaotic_bodies(motion, threads) for motion in motions], axis=0)
            )
        return chaotic[0]

    @property
    def identical(self) -> bool:
        """Whether runs were compared, and all have equal bits."""
        return bool(self._equal_runs) and all(self._equal_runs)

    def measure_loads(self) -> Iterator[VerifiedMeasure]:
        """Yield the measures of loads and actuators, which find most harm for their time."""
        # Without its policy, a model does not hold itself under a load.
        if self._in_loop or not self._has_same_layout(self._motions_of("task")):
            return
        own, other = (motions[0] for motions in self._motions_of("task"))
        share, actuators = self._request.length_share, self._choose_actuators(own.model)
        runs = build_load_runs(own, other, share)
        if not self._request.keeps_motion and self._request.keeps_start:
            runs += build_unconstrained_runs(own, other, actuators, share)
        runs += build_tracking_runs(own, other, actuators, share)
        for run in runs:
            yield from self._compare_states(run)

    def measure_others(self) -> Iterator[VerifiedMeasure]:
        """Yield all other measures."""
        if self._in_loop:
            yield from self._measure_loops()
        else:
            yield from self._measure_motions()
        yield from self._compare_grips()
        for name, task in self._tasks.items() if self._request.with_labels else ():
            yield from self._compare_labels(name, task)

    def _measure_motions(self) -> Iterator[VerifiedMeasure]:
        first = self._motions_of("task")
        comparable = self._has_same_layout(first)
        motions = {name: self._motions_of(name) for name in self._tasks}
        yield from self._measure_errors(motions)
        if comparable:
            largest = dict[str, float]()
            for name, (own, other) in motions.items():
                for place, (before, after) in enumerate(zip(own, other, strict=False)):
                    if place and self._request.keeps_motion:
                        after = self._with_original_start(before, after)  # noqa: PLW2901
                    run = pair_motions(f"{name}, {before.name}", before, after)
                    for measure in self._compare_states(run):
                        yield self._allow_earlier(measure, largest)
            last, changed = first[0][-1], first[1][-1]
            if last.inputs.any() and last.name == changed.name:
                if len(first[0]) > 1 and self._request.keeps_motion:
                    changed = self._with_original_start(last, changed)
                for measure in self._compare_states(build_doubled_run(last, changed)):
                    yield self._allow_earlier(measure, largest)

    def _with_original_start(self, before: Motion, after: Motion) -> Motion:
        # A chaotic phase ends elsewhere by chance, and so would all phases after it.
        if before.seeds != after.seeds or _state_size(before.model) != _state_size(after.model):
            return after
        return replace(after, starts=before.starts)

    def _allow_earlier(
        self, measure: VerifiedMeasure, largest: dict[str, float]
    ) -> VerifiedMeasure:
        # A motion that the change is meant to alter begins its next phase in another state, so a
        # measure may be as large as the original's was in any earlier phase of the task.
        before, after = measure.before, measure.after
        if self._request.keeps_motion or before is None or after is None:
            return measure
        earlier = largest[measure.name] = max(before, largest.get(measure.name, before))
        tolerance = max(measure.tolerance, earlier - before)
        worse = measure.worse and after > before + tolerance
        return measure.model_copy(update={"tolerance": tolerance, "worse": worse})

    def _measure_loops(self) -> Iterator[VerifiedMeasure]:
        # Replays of recorded controls say nothing of a loop, so all runs have the policy in them.
        self._skip_run("numerical error", "a policy acts, so its loop is compared as a whole")
        self._skip_run("step and sine", "without its policy, a model does not hold itself")
        own, other = (each.prepared.model for each in (self._original, self._changed))
        if not self._has_same_sizes(own, other):
            return
        loops = LoopRuns(self._original, self._changed)
        for name, task in self._tasks.items():
            for run in loops.build_task_runs(name, task):
                yield from self._compare_states(run)
        for run in loops.build_tilted_runs(self._tasks["task"]):
            yield from self._compare_states(run)

    def _motions_of(self, name: str) -> tuple[list[Motion], list[Motion]]:
        # The original comes first, then the changed model.
        if name not in self._motions:
            task = self._tasks[name]
            self._motions[name] = self._original.motions_of(task), self._changed.motions_of(task)
        return self._motions[name]

    def _skip_run(self, run: str, reason: str) -> None:
        if all(skipped.run != run for skipped in self.skipped):
            self.skipped.append(SkippedRun(run=run, reason=reason))

    def _begin_run(self, name: str) -> bool:
        if self._request.find_time_left() < 0:
            self.ended_early = True
            self._skip_run(name, "the time limit")
            return False
        self._request.notify(name)
        return True

    def _has_same_layout(self, motions: tuple[list[Motion], list[Motion]]) -> bool:
        own, other = (each[0].model for each in motions)
        return self._has_same_sizes(own, other)

    def _has_same_sizes(self, own: mujoco.MjModel, other: mujoco.MjModel) -> bool:
        same = all(
            getattr(own, size) == getattr(other, size) for size in ("nq", "nv", "nu", "nbody")
        )
        if not same:
            self._skip_run("loads", "the models have other joints, bodies or actuators")
        return same

    def _compare_states(self, run: PairedRun) -> Iterator[VerifiedMeasure]:
        if not self._begin_run(run.name):
            return
        sizes = {motion.seeds for motion in (run.original, run.reference, run.twin, run.changed)}
        if len(sizes) > 1:
            yield self._count_lost_seeds(run)
            return
        tables = tabulate_run(run, self._original.threads, self._request.runs.tables)
        self._equal_runs.append(tables.original.bits == tables.changed.bits)
        chaotic = is_chaotic(run, tables)
        self._is_chaotic |= chaotic
        repeated = {*EXTREME_UNITS, *(("creep",) if chaotic else ())}
        request = self._request
        # Without constraints, a fix has no effect that it is meant to have.
        compared = compare_run(
            run,
            tables,
            0.0 if run.unconstrained else request.allowed_error,
            keeps_motion=request.keeps_motion or run.unconstrained,
            keeps_start=request.keeps_start,
            chaotic_bodies=None if run.in_loop or run.unconstrained else self._chaotic_bodies,
            find_unresolved=None if run.in_loop else partial(self._find_unresolved, run, tables),
        )
        for measure in compared:
            if not run.in_loop and measure.worse and measure.name in repeated:
                yield repeat_measure(run, measure, self._original.threads, request.runs.falls)
            else:
                yield measure

    def _find_unresolved(self, run: PairedRun, tables: Tables) -> np.ndarray:
        bodies_by_run = self._request.runs.unresolved_bodies
        key = run.name, float(run.reference.model.opt.timestep)
        if key not in bodies_by_run:
            bodies_by_run[key] = find_unresolved_bodies(run, tables, self._original.threads)
        return bodies_by_run[key]

    def _count_lost_seeds(self, run: PairedRun) -> VerifiedMeasure:
        # A seed that the engine gave up in an earlier phase does not reach this one.
        seeds = len(self._original.task.seeds)
        before, after = (float(seeds - motion.seeds) for motion in (run.original, run.changed))
        self._skip_run(run.name, "not all seeds reach it in both models")
        return VerifiedMeasure(
            name="runs that the engine gave up",
            run=run.name,
            unit="1",
            before=before,
            after=after,
            spread=0.0,
            tolerance=0.0,
            place="",
            worse=after > before,
        )

    def _choose_actuators(self, model: mujoco.MjModel) -> list[int]:
        count = int(model.nu)
        chosen = np.linspace(0, count - 1, min(count, MAX_TRACKED_ACTUATORS)).round().astype(int)
        if len(chosen) < count:
            reason = f"{len(chosen)} of {count} actuators were moved alone"
            self._skip_run("step and sine of the other actuators", reason)
        return np.unique(chosen).tolist()

    def _measure_errors(
        self, motions: Mapping[str, tuple[list[Motion], list[Motion]]]
    ) -> Iterator[VerifiedMeasure]:
        # Both errors are measured against the original's motion at a fine step.
        pairs = dict[str, tuple[ErrorEstimate, ErrorEstimate]]()
        floor = max(ERROR_FLOOR, self._request.allowed_error)
        if not self._request.keeps_motion:
            # Another motion has another error, which may be up to half of the tolerance.
            floor = max(floor, self._original.task.tolerance / 2)
        for name, (own, other) in motions.items():
            if not self._begin_run(f"numerical error, {name}"):
                break
            pair = _measure_error_pair(self._request, (name, own, other), floor)
            if pair is None:
                reason = "its step has no two steps of any reference"
                self._skip_run("numerical error", reason)
                break
            pairs[name] = pair
        spread = self._spread_errors([own for own, _ in pairs.values()])
        for name, (own, other) in pairs.items():
            before, after, tolerance = own.error, other.error, 0.0
            if math.isfinite(before):
                tolerance = max(spread, RELATIVE_TOLERANCE * before, floor - before)
            yield VerifiedMeasure(
                name="numerical error",
                run=name,
                unit="1",
                before=before,
                after=after,
                spread=spread,
                tolerance=tolerance,
                place=other.body,
                worse=math.isfinite(before) and not after <= before + tolerance,
            )

    def _spread_errors(self, errors: Sequence[ErrorEstimate]) -> float:
        # The range over the seeds of all tasks, so that slow models with one seed each have one. In
        # chaotic motion, windows have the impacts of chance: then it is the distance from the mean
        # that the error of another seed rarely exceeds.
        from scipy.special import stdtrit  # noqa: PLC0415 - it takes a while to load

        finite = [own for own in errors if math.isfinite(own.high)]
        shares = [share for own in finite for share in own.shares or (own.low, own.high)]
        spread = max(shares, default=0.0) - min(shares, default=0.0)
        if len(shares) > 1 and self._chaotic_bodies.any():
            factor = float(stdtrit(len(shares) - 1, SURE)) * math.sqrt(1 + 1 / len(shares))
            spread = max(spread, factor * stdev(shares))
        return spread

    def _compare_grips(self) -> Iterator[VerifiedMeasure]:
        if self._original.values or self._changed.values:
            self._skip_run("grip", "settings are not in the file, and grips are judged as written")
            return
        if not self._begin_run("grip"):
            return
        yield from compare_grips(self._original, self._changed, self._request.runs.grips)

    def _compare_labels(self, name: str, task: Task) -> Iterator[VerifiedMeasure]:
        if not self._begin_run(f"labels, {name}"):
            return
        known_labels = self._request.runs.labels
        after = self._count_failure_labels(self._changed, task)
        if name not in known_labels:
            is_fresh = task is not self._tasks["task"]
            if is_fresh and not after and not any(known_labels.values()):
                return  # neither the changed model nor the original's own seeds have one
            known_labels[name] = self._count_failure_labels(self._original, task)
        before = known_labels[name]
        for label in sorted({*before, *after}):
            own, other = before[label], after[label]
            worse = not own and other > 0
            if worse and self._is_chaotic:
                # Chance decides where bodies go, and so which run has a label.
                own, other = (counts[label] for counts in self._count_repeated_labels(task))
                worse = exceeds_chance(own, other, REPEATED_RUNS)
            yield VerifiedMeasure(
                name=f"label {label}",
                run=name,
                unit="runs",
                before=own,
                after=other,
                spread=0.0,
                tolerance=0.0,
                place="",
                worse=worse,
            )

    def _count_repeated_labels(self, task: Task) -> tuple[Counter[str], Counter[str]]:
        # How many of many runs have each label, of the original and the changed model.
        name = "task on repeated seeds"
        if name not in self._repeated:
            first = 1 + 2 * (1 + max(self._tasks["task on fresh seeds"].seeds))
            seeds = tuple(range(first, first + REPEATED_RUNS))
            many = task.model_copy(update={"seeds": seeds})
            known_labels = self._request.runs.labels
            if name not in known_labels:
                known_labels[name] = self._count_failure_labels(self._original, many)
            self._repeated[name] = self._count_failure_labels(self._changed, many)
        return self._request.runs.labels[name], self._repeated[name]

    def _count_failure_labels(self, checked: CheckedModel, task: Task) -> Counter[str]:
        share = self._request.length_share
        if share == 1 and checked.has_run and task.seeds == checked.task.seeds:
            return count_labels(run_labels(task, [run.record for run in checked.runs]))
        with temporary_folder() as folder:
            alone = replace(checked, session=replace(checked.session, folder=Path(folder)))
            if share < 1:
                alone = replace(alone, duration=share * checked.task.duration)
            what = "Verified against the original"
            runs = alone.run("labels", what, seeds=task.seeds, trace="none")
            return count_labels(run_labels(task, [run.record for run in runs]))


def exceeds_chance(before: int, after: int, runs: int) -> bool:
    """Return whether `after` of `runs` runs is rare for a model that equals one with `before`."""
    return unequal_chance(after, runs, before, runs) < LABEL_CHANCE


def count_labels(labels: Sequence[RunLabel]) -> Counter[str]:
    """Return how many runs have each label."""
    counts = Counter[str]()
    for each in labels:
        counts[each.label] += each.runs
    return counts


def _measure_error_pair(
    request: VerificationRequest, run: tuple[str, Sequence[Motion], Sequence[Motion]], floor: float
) -> tuple[ErrorEstimate, ErrorEstimate] | None:
    # The result is the error before and after; no error up to `floor` is worse. A coarse reference
    # is tried if the original's budget says that its error is small.
    original, most = request.original, floor / 2
    if (
        most > ERROR_FLOOR
        and original.has_budget
        and all(phase.run.error <= most for phase in original.budget.phases)
    ):
        pair = _measure_errors_at(request, run, _COARSE_RATES)
        if pair is not None and all(each.error <= _CLEAR_SHARE * floor for each in pair):
            return pair
    return _measure_errors_at(request, run, _RATES)


def _measure_errors_at(
    request: VerificationRequest,
    run: tuple[str, Sequence[Motion], Sequence[Motion]],
    rates: Sequence[int],
) -> tuple[ErrorEstimate, ErrorEstimate] | None:
    name, own, other = run
    threads, known_errors = request.original.threads, request.runs.references
    shared = request.same_model and _state_size(own[0].model) == _state_size(other[0].model)
    # Another model is compared with its own motion at a fine step.
    ratio = float(other[0].model.opt.timestep / own[0].model.opt.timestep) if shared else 1.0
    fitting = (each for each in rates if _is_whole(each * ratio))
    rate = next((each for each in fitting if round(each * ratio) >= _LEAST_STEPS), None)
    if rate is None:
        return None
    if (name, rate) not in known_errors:
        fine = TaskReference.run_references(own, rate, threads).complete_phases()
        known_errors[name, rate] = fine, fine.estimate_error(run_at_once(own[0].model), rate)
    references, before = known_errors[name, rate]
    if not shared:
        references = TaskReference.run_references(other, rate, threads).complete_phases()
    return before, references.estimate_error(run_at_once(other[0].model), round(rate * ratio))


def _is_whole(value: float) -> bool:
    return round(value) >= 1 and abs(value - round(value)) <= COARSE_ROUNDING * value


def _state_size(model: mujoco.MjModel) -> int:
    return int(mujoco.mj_stateSize(model, INTEGRATION))
