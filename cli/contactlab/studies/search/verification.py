"""Writes and verifies the recommended settings on fresh seeds.

A candidate that fails verification is skipped, and the next best one is tried. Before the time
limit or the number of tries is reached, the most conservative candidate is tried.
"""

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory

import mujoco

from contactlab.budget import ErrorBudget, Motion, Settings, error_budget, judge
from contactlab.budget.measuring import evaluations
from contactlab.errors import SceneError
from contactlab.judge.wording import plural
from contactlab.scene.model_names import printed_geom_name
from contactlab.scene.model_writer import WrittenModel, write_model
from contactlab.schema.task import Task
from contactlab.schema.tune_report import MODEL, CurrentVerdict, Target, Verification
from contactlab.studies.check.checked_model import CheckedModel
from contactlab.studies.examine.examination import ExamineRequest, open_model
from contactlab.studies.examine.fixes import with_new_seeds
from contactlab.studies.search.configuration import (
    INTEGRATOR,
    Configuration,
    Key,
    changed_settings,
    format_settings,
)
from contactlab.studies.search.reference_error import ErrorEstimate, TaskReference
from contactlab.studies.search.report_text import (
    UNVERIFIED,
    error_text,
    finite_or_none,
    is_faster,
    time_ratio_text,
)
from contactlab.studies.search.search_space import SkippedParameter
from contactlab.studies.search.settings_search import (
    EQUAL_ERROR_RATIO,
    MIN_SPEEDUP_RATIO,
    Bound,
    ErrorEstimator,
    Evaluation,
    Search,
    error_of,
)
from contactlab.studies.search.time_limit import TimeLimit
from contactlab.studies.search.tune_request import TuneRequest
from contactlab.studies.search.tuning_problem import TuningProblem, first_seeds
from contactlab.studies.search.unused_pairs import pairs_within
from contactlab.studies.session import Session
from contactlab.studies.task_verdict import run_labels
from contactlab.studies.verification import (
    OriginalRuns,
    VerificationRequest,
    verify_change,
)

_SIMULATIONS_PER_VERDICT = (
    30  # simulations of the task per verdict: references, their check, RK4, and the run itself
)
_CURRENT_VERDICT_SHARE = 0.1  # share of the time limit for the verdict on the model as written
_TIMED_RUNS = 12  # timed whole runs, of two seeds: of a candidate, and of the model twice
_COMPILATIONS_PER_VERDICT = (
    5  # compilations of the model per verdict: to write, compare, open and run it
)
_LABEL_SECONDS = 0.8  # s of CPU time to label runs of the written model and of the original
_LATE_SHARE = 0.1  # share of the time limit by which the first verdict may be late
_MAX_VERDICTS, _MAX_ERROR_ESTIMATES = 8, 25
"""Largest number of verdicts and of error estimates on fresh seeds, per goal."""
_MIN_PROCESS_SECONDS = 0.3  # s per task; a shorter task ends before a process has started
_FALLBACK_STEP_FRACTION = 0.6
_CONSERVATIVE_SHARE = 0.5  # share of the remaining time for the most conservative candidate
_VERDICT_SHARE = (
    0.5  # share of the remaining time for verdicts, since other work may slow them down
)
_BUDGET_SETTINGS = Settings(places=False, excess=False)  # settings of the error budget of a verdict
ACCURATE = "ok"
"""The verdict of `contactlab MODEL` on accurate numerics."""
_RK4, _RK4_STAGES = int(mujoco.mjtIntegrator.mjINT_RK4), 4


@dataclass(frozen=True)
class Goal:
    """A goal of the search.

    Attributes:
        bound: of the error.
        folder: folder of the written model.
        must_be_sound: whether the verdict must be accurate; otherwise it may equal the verdict on
            the model as written.
    """

    bound: Bound
    folder: str
    must_be_sound: bool = True


@dataclass(frozen=True)
class VerifiedCandidate:
    """A candidate whose model was written, and that passed verification on fresh seeds."""

    evaluation: Evaluation
    written: WrittenModel
    verification: Verification


@dataclass(frozen=True)
class FailureBound:
    """Bound on candidates after others failed: a smaller error, or a shorter step.

    Attributes:
        error: a candidate with at most this error may have any step that did not fail.
        multiple: in fine steps; a candidate with at most this step may have any allowed error.
        failed: shortest failed step by integrator; only shorter ones are tried.
    """

    error: float = math.inf
    multiple: float = 0.0
    failed: Mapping[object, int] = field(default_factory=dict[object, int])

    def admits(self, tried: Evaluation) -> bool:
        """Return whether a candidate satisfies the bound."""
        if tried.configuration.multiple >= self.failed.get(_integrator_of(tried), math.inf):
            return False
        return error_of(tried) <= self.error or tried.configuration.multiple <= self.multiple

    def tightened_by(self, tried: Evaluation, part: float) -> "FailureBound":
        """Return the bound after another failure; `part` is the fraction of it that may hold."""
        step = tried.configuration.multiple
        name = _integrator_of(tried)
        failed = {**self.failed, name: min(step, self.failed.get(name, step))}
        return FailureBound(part * error_of(tried), part * step, failed)


def _integrator_of(tried: Evaluation) -> object:
    return tried.configuration.settings.get(INTEGRATOR)


@dataclass(frozen=True)
class _Judgement:
    """Verdict on numerics: word, largest error, its range over seeds, and the reason."""

    verdict: str
    error: float
    low: float
    high: float
    reason: str


class CandidateVerifier:
    """Writes and verifies candidates.

    Attributes:
        skipped: candidates that failed or were not verified, and why.
        rejected: keys of candidates that failed on fresh seeds.
    """

    def __init__(
        self,
        request: TuneRequest,
        session: Session,
        problem: TuningProblem,
        search: Search,
        aim: Target,
        allowed: TimeLimit,
    ) -> None:
        """Take the finished search."""
        self._request, self._session = request, session
        self._problem, self._search, self._target = problem, search, aim
        self._time_limit = allowed
        self.skipped = list[SkippedParameter]()
        self.rejected = set[Key]()
        self._current_verdicts = dict[tuple[int, ...], _Judgement]()
        self._seconds_per_seed = _SIMULATIONS_PER_VERDICT * problem.pass_seconds
        self._current_labels = dict[tuple[int, ...], set[str]]()
        self._original_runs = OriginalRuns()

    @property
    def _examined(self) -> CheckedModel:
        return self._problem.examined

    @property
    def current(self) -> Evaluation:
        """The model as written."""
        return self._search.evaluations[self._search.current.key]

    def verification_time(self, tried: Evaluation) -> float:
        """Estimate the time to write, verify and time a candidate on few seeds [s]."""
        own, timed = (
            2 * self._relative_work(tried) * self._seconds_per_seed,
            _TIMED_RUNS * self._problem.pass_seconds,
        )
        return self._time_limit.wall_time_of(
            self._writing_seconds + own + timed + self._first_verdict_seconds
        )

    @property
    def current_verification_time(self) -> float:
        """The same estimate for the model as written [s]."""
        return self.verification_time(self.current)

    @property
    def _writing_seconds(self) -> float:
        """Estimated CPU time to write, compare, open and label a model [s]."""
        return _COMPILATIONS_PER_VERDICT * self._problem.compile_seconds + _LABEL_SECONDS

    @property
    def _first_verdict_seconds(self) -> float:
        """Estimated CPU time of the reference on fresh seeds, and of the verdict as written [s].

        Only the first verdict needs them; both are cached.
        """
        if "_reference" in vars(self):
            return 0.0
        return (
            self._problem.reference.substeps * self._problem.pass_seconds + self._seconds_per_seed
        )

    def verify_best(self, goal: Goal, later: int = 0) -> VerifiedCandidate | None:
        """Verify candidates, best first; return the first that holds, or None.

        After the first failure, time is reserved for `later` other goals.
        """
        below, done = FailureBound(), {self.current.configuration.key}
        for number in range(_MAX_VERDICTS):
            late = (
                -later * self.current_verification_time
                if number
                else _LATE_SHARE * self._time_limit.seconds
            )
            if self._is_late(
                goal,
                self._time_limit.wall_time_of(self._writing_seconds + self._first_verdict_seconds)
                - late,
            ):
                break
            last = number > 0 and (
                number == _MAX_VERDICTS - 1
                or self._time_limit.remaining < 2 * self.current_verification_time
            )
            measured = self._next_within_limit(goal, done, below, late, last=last)
            if measured is None:
                break
            tried, error = measured
            try:
                written = self._write_model(tried, goal.folder)
            except SceneError as refused:
                self._reject(tried, str(refused).splitlines()[0])
                continue
            found = self._verify(tried, error, written, goal)
            if found.holds:
                return VerifiedCandidate(tried, written, found)
            self._reject(tried, f"on fresh seeds: {found.sentence}")
            # An inaccurate verdict or a label may be caused by the step, whatever the error.
            limits = [self._examined.task.tolerance]
            if not goal.must_be_sound:
                limits += [said.high for said in self._current_verdicts.values()]
            part = step_fraction(found.numerical_error, max(limits))
            below = below.tightened_by(tried, part)
        self.drop_candidate(goal)
        return None

    def _is_late(self, goal: Goal, takes: float) -> bool:
        """Return whether the remaining time is shorter than an estimate [s], and report it."""
        if late := self._time_limit.remaining < takes:
            self.skipped.append(SkippedParameter(goal.folder, UNVERIFIED))
        return late

    def _reject(self, tried: Evaluation, reason: str) -> None:
        self.rejected.add(tried.configuration.key)
        self.skipped.append(SkippedParameter(self._settings_text(tried), reason))

    def _relative_work(self, tried: Evaluation) -> float:
        """Estimate the cost of a verdict on a candidate over one on the model as written."""
        own, other = (
            evaluations_per_step(self._search.space.model_of(one.configuration))
            / one.configuration.multiple
            for one in (self.current, tried)
        )
        return other / own

    def drop_candidate(self, goal: Goal) -> None:
        """Remove the written model, and report a candidate that is faster only within noise."""
        rmtree(self._session.folder / goal.folder, ignore_errors=True)
        if self._search.max_time_ratio is not None or error_of(self.current) > goal.bound.limit:
            return
        for tried in self._search.rank_candidates(goal.bound):
            if (
                tried.time_ratio
                and tried.time_ratio.ratio < MIN_SPEEDUP_RATIO
                and not self._is_measurably_faster(tried)
            ):
                noise_floor = self.current.time_ratio
                assert noise_floor
                reason = (
                    f"{time_ratio_text(tried.time_ratio)} time is within the noise floor of "
                    f"{time_ratio_text(noise_floor)}"
                )
                entry = SkippedParameter(self._settings_text(tried), reason)
                self.skipped += [] if entry in self.skipped else [entry]
                break

    def _next_within_limit(
        self, goal: Goal, done: set[Key], below: FailureBound, late: float, *, last: bool
    ) -> tuple[Evaluation, ErrorEstimate] | None:
        """Return the best candidate within the bound whose error holds on fresh seeds.

        None if there is none, or if verification would end more than `late` seconds too late. An
        error estimate takes a small part of the time of a verdict. The last try is conservative.
        """
        first = True
        while len(done) < _MAX_ERROR_ESTIMATES:
            last = last or (
                not first and self._time_limit.remaining < 2 * self.current_verification_time
            )
            ways = [partial(self._next_candidate, below=below), self._most_conservative]
            found = (way(done, goal.bound) for way in (ways[::-1] if last else ways))
            tried = next(filter(None, found), None)
            if tried is None or self._is_late(goal, self.verification_time(tried) - late):
                return None
            done.add(tried.configuration.key)
            made = self._search.space.model_of(tried.configuration)
            error = self._fresh_estimator.estimate_error(made, tried.configuration.multiple)
            why = self._excess_reason(error, goal)
            if not why:
                return tried, error
            if first:
                self._reject(tried, f"on fresh seeds: {why}")
            self.rejected.add(tried.configuration.key)
            first = False
        return None

    def _settings_text(self, tried: Evaluation) -> str:
        return format_settings(self.settings(tried.configuration)) or "without unused parts"

    def is_better(self, tried: Evaluation, bound: Bound) -> bool:
        """Return whether a candidate serves a goal better than the model as written."""
        known = self.current
        assert tried.error
        assert tried.time_ratio
        assert known.error
        if self._search.max_time_ratio is not None:
            if self._search.max_time_ratio < 1:
                return True
            return tried.error.error < MIN_SPEEDUP_RATIO * known.error.error
        return known.error.error > bound.limit or self._is_measurably_faster(tried)

    def _is_measurably_faster(self, tried: Evaluation) -> bool:
        """Return whether a candidate takes less time than the model as written, beyond noise."""
        price, twin = tried.time_ratio, self.current.time_ratio
        assert price
        assert twin
        return price.ratio < MIN_SPEEDUP_RATIO and is_faster(price, twin)

    def _next_candidate(
        self, done: set[Key], bound: Bound, below: FailureBound
    ) -> Evaluation | None:
        """Return the best unverified candidate within the bound: known, or at a shorter step."""
        search = self._search

        def fits(one: Evaluation) -> bool:
            new = one.configuration.key not in done
            keeps = search.max_time_ratio is not None or error_of(one) <= bound.accepted
            return (
                new and keeps and (below.admits(one) or self._is_as_accurate_as_current(one, bound))
            )

        ranked = search.rank_candidates(bound)
        good = (one for one in ranked if fits(one) and self.is_better(one, bound))
        known = next(good, None)
        if search.max_time_ratio is not None or not ranked or known is ranked[0]:
            return known
        max_time_ratio = known.time_ratio.ratio if known and known.time_ratio else math.inf
        if error_of(self.current) <= bound.limit:
            max_time_ratio = min(max_time_ratio, 1.0)
        best = ranked[0]
        assert best.time_ratio
        once = best.time_ratio.ratio * best.configuration.multiple
        near = [(about, one.configuration) for about, one in search.estimate_times(bound)]
        near += [(once / choice.multiple, choice) for choice in search.shorter_steps(best)]
        for about, choice in sorted(near, key=lambda pair: pair[0]):
            if about >= max_time_ratio or self._time_limit.remaining < 0:
                break
            if fits(search.evaluate_error(choice)) and self.is_better(
                search.evaluate(choice), bound
            ):
                return search.evaluate(choice)
        return known

    def _is_as_accurate_as_current(self, tried: Evaluation, bound: Bound) -> bool:
        """Return whether a candidate is as accurate as the model as written, at no longer step.

        If that model satisfies the bound, failures at longer steps do not concern such a candidate.
        """
        now, short = (
            error_of(self.current),
            tried.configuration.multiple <= self.current.configuration.multiple,
        )
        return now <= bound.accepted and short and error_of(tried) <= EQUAL_ERROR_RATIO * now

    def _most_conservative(self, done: set[Key], bound: Bound) -> Evaluation | None:
        """Return the fastest candidate that is as accurate as the model as written, if allowed."""
        known = self.current
        assert known.error
        if self._search.max_time_ratio is not None or known.error.error > bound.limit:
            return None
        left = max(0.0, self._time_limit.remaining - self.current_verification_time)
        for tried in self._search.as_accurate_as_current(
            time.monotonic() + _CONSERVATIVE_SHARE * left
        ):
            new = tried.configuration.key not in done
            if new and error_of(tried) <= bound.accepted and self.is_better(tried, bound):
                return tried
        return None

    def settings(self, choice: Configuration) -> dict[str, object]:
        """Return the settings of a candidate, with its timestep."""
        finer, step = self._problem.reference.substeps, self._problem.reference.step
        found = changed_settings(choice.settings, self._problem.model)
        if choice.multiple == finer:
            return found
        return {"timestep": float(f"{choice.multiple * step:.12g}"), **found}

    def _write_model(self, tried: Evaluation, folder: str) -> WrittenModel:
        choice = tried.configuration
        edits = replace(self._problem.edits_of(choice.reductions), settings=self.settings(choice))
        return write_model(self._examined.scene, edits, self._session.folder / folder, MODEL)

    @cached_property
    def task(self) -> Task:
        """The task with as many fresh seeds as the search has seeds."""
        task = with_new_seeds(self._examined.task)
        if self._request.error_at is not None:
            task = task.model_copy(update={"observed": ()})
        return task.model_copy(update={"seeds": task.seeds[: self._problem.seeds]})

    @cached_property
    def motions(self) -> list[Motion]:
        """The motions of the task with fresh seeds."""
        return self._examined.motions_of(self.task)

    @cached_property
    def _judged_motions(self) -> list[Motion]:
        """Fresh motions of as many seeds as the time limit allows to judge."""
        seeds = self._affordable_seeds(1.0, self._problem.seeds, len(self._search.bounds))
        return [first_seeds(motion, seeds) for motion in self.motions]

    def _affordable_seeds(self, work: float, most: int, answers: int = 1) -> int:
        """Return the number of seeds, at most `most`, on which each goal can be verified."""
        left = max(
            0.0, self._time_limit.remaining - self._time_limit.wall_time_of(self._writing_seconds)
        )
        takes = self._time_limit.wall_time_of(
            2 * work * self._seconds_per_seed + self._first_verdict_seconds
        )
        return min(most, max(1, int(_VERDICT_SHARE * left / answers / takes)))

    @cached_property
    def _fresh_reference(self) -> TaskReference:
        return TaskReference.run_references(
            self._judged_motions, self._problem.reference.substeps, self._problem.threads
        )

    @cached_property
    def _fresh_estimator(self) -> ErrorEstimator:
        return self._problem.error_estimator(self._fresh_reference, self._judged_motions)

    @cached_property
    def _current_error(self) -> ErrorEstimate:
        """Error of the model as written on fresh seeds."""
        return self._fresh_estimator.estimate_error(
            self._problem.model, self._problem.reference.substeps
        )

    def _excess_reason(self, error: ErrorEstimate, goal: Goal) -> str:
        """Return why an error on fresh seeds is too large, or ""."""
        limit = self._limit_of(goal)
        if self._search.max_time_ratio is not None or error.error <= limit:
            return ""
        limit_text = error_text(limit, self._target.unit)
        return f"error {self._error_text(error)} in {error.body}, limit {limit_text}"

    def _verify(
        self, tried: Evaluation, error: ErrorEstimate, written: WrittenModel, goal: Goal
    ) -> Verification:
        """Judge a written model with a known error on fresh seeds."""
        self._session.notify(f"verifying {self._settings_text(tried)}")
        request = ExamineRequest(written.reference, task=self._request.task, sections=("budget",))
        examined = open_model(request, self._session)
        work = self._relative_work(tried)
        seeds = self.task.seeds[: self._affordable_seeds(work, self._judged_motions[0].seeds)]
        task = self.task.model_copy(update={"seeds": seeds})
        judged, said = self._worst_verdict(examined, task, work)
        timely = self._search.max_time_ratio is not None
        holds, why = True, "accurate, and within the limit"
        if said.verdict != ACCURATE:
            holds = not goal.must_be_sound and self._is_as_current(judged, said)
            why = (
                f"{said.verdict}, like the model as written: {said.reason}"
                if holds
                else said.reason
            )
        labels, unseen = self._new_labels(examined, task) if holds else ([], "")
        why += unseen
        if labels:
            holds, why = False, f"new label: {' and '.join(labels)}"
        if (
            holds
            and "apart" in tried.configuration.reductions
            and (touched := self._touching_pair())
        ):
            holds, why = False, f"{touched} touch, but stayed apart before"
        if holds and (harm := self._worse_measure(examined, goal)):
            holds, why = False, harm
        return Verification(
            seeds=seeds,
            holds=holds,
            meets_target=holds
            and (timely or error.error <= max(self._target.limit, self._accepted_current_error)),
            error=finite_or_none(error.error),
            current_error=finite_or_none(self._current_error.error),
            verdict=said.verdict,
            numerical_error=finite_or_none(said.error),
            labels=tuple(labels),
            sentence=why,
        )

    def _worse_measure(self, changed: CheckedModel, goal: Goal) -> str:
        is_share = self._target.unit == "1"
        found = verify_change(
            VerificationRequest(
                original=self._examined,
                changed=changed,
                allowed_error=self._limit_of(goal) if is_share else changed.task.tolerance,
                stop_early=True,
                with_labels=False,
                runs=self._original_runs,
            )
        )
        return "" if found.passed else f"worse than as written: {found.sentence}"

    def _limit_of(self, goal: Goal) -> float:
        """Return the largest allowed error of a goal on fresh seeds.

        If the model as written satisfies the goal in the search, its error here is allowed.
        """
        own = self.current.error
        if own is not None and own.error <= goal.bound.limit:
            return max(self._target.limit, EQUAL_ERROR_RATIO * self._current_error.error)
        return goal.bound.limit

    @property
    def _accepted_current_error(self) -> float:
        """Allowed error on fresh seeds if the model as written meets the target in the search."""
        own = self.current.error
        return (
            EQUAL_ERROR_RATIO * self._current_error.error
            if own and own.error <= self._target.limit
            else 0.0
        )

    def _error_text(self, error: ErrorEstimate) -> str:
        return error_text(error.error, self._target.unit)

    def _worst_verdict(
        self, examined: CheckedModel, task: Task, work: float
    ) -> tuple[Task, _Judgement]:
        """Return the verdict on fresh seeds, or, if that is accurate, on the seeds of the search.

        `contactlab FILE` judges by the latter.
        """
        found = self._judge_task(examined, task, work)
        if found.verdict != ACCURATE:
            return task, found
        own = self._own_task(len(task.seeds))
        return own, self._judge_task(examined, own, work)

    def _own_task(self, seeds: int) -> Task:
        """Return the task with the first seeds of the search."""
        task = self._examined.task
        return task.model_copy(update={"seeds": task.seeds[:seeds]})

    @cached_property
    def is_current_sound(self) -> bool:
        """Whether the verdict on the model as written is accurate on all judged seeds."""
        seeds = self._judged_motions[0].seeds
        unseen = self.task.model_copy(update={"seeds": self.task.seeds[:seeds]})
        return all(
            self._current_verdict_on(task).verdict == ACCURATE
            for task in (self._own_task(seeds), unseen)
        )

    def judge_current(self) -> None:
        """Judge the model as written, on as many seeds as a tenth of the time limit allows."""
        task = self._examined.task
        takes = self._time_limit.wall_time_of(self._seconds_per_seed)
        seeds = min(len(task.seeds), int(_CURRENT_VERDICT_SHARE * self._request.max_time / takes))
        if seeds:
            self._current_verdict_on(self._own_task(seeds))

    def current_verdict(self) -> CurrentVerdict | None:
        """Return the verdict on the model as written, on the most seeds that were judged."""
        task = self._examined.task
        known = [seeds for seeds in self._current_verdicts if seeds == task.seeds[: len(seeds)]]
        if not known:
            return None
        seeds = max(known, key=len)
        said = self._current_verdicts[seeds]
        return CurrentVerdict(
            seeds=seeds, verdict=said.verdict, numerical_error=finite_or_none(said.error)
        )

    def _is_as_current(self, task: Task, said: _Judgement) -> bool:
        """Return whether the verdict on a candidate equals that on the model as written.

        Its least error over seeds must be at most the largest error over seeds as written: free
        motions from the same starts differ, and have another mean.
        """
        now = self._current_verdict_on(task)
        return now.verdict == said.verdict and said.low <= now.high

    def _current_verdict_on(self, task: Task) -> _Judgement:
        """Return the verdict on the model as written, judged once per set of seeds."""
        if task.seeds not in self._current_verdicts:
            self._current_verdicts[task.seeds] = self._judge_task(self._examined, task)
        return self._current_verdicts[task.seeds]

    def _judge_task(self, examined: CheckedModel, task: Task, work: float = 1.0) -> _Judgement:
        motions, begin = examined.motions_of(task), time.process_time()
        budget = error_budget(
            motions, rows=(), settings=_BUDGET_SETTINGS, workers=self._problem.threads
        )
        if work >= 1:  # runs with long steps spend most time outside the steps
            self._seconds_per_seed = (time.process_time() - begin) / len(task.seeds) / work
        verdict = judge(budget, task.tolerance)
        reason = verdict.reasons[0].sentence if verdict.reasons else ACCURATE
        return _Judgement(verdict.word, budget.error, *_seed_range(budget), reason)

    def _new_labels(self, examined: CheckedModel, task: Task) -> tuple[list[str], str]:
        """Return the labels of a written model's runs that the model as written does not have.

        Fresh seeds are checked, and as many of the task's own seeds as the time limit allows, since
        `contactlab FILE` uses those. The second text says how many were not checked.
        """
        begin = time.monotonic()
        found = self._run_labels(examined, task)
        took = max(time.monotonic() - begin, 1e-6) / len(task.seeds)
        if new := found and found - self._current_labels_on(task):
            return sorted(new), ""
        own = self._examined.task.model_copy(update={"observed": task.observed})
        count = min(len(own.seeds), max(0, int(self._time_limit.remaining / took)))
        if count:
            own = own.model_copy(update={"seeds": own.seeds[:count]})
            found = self._run_labels(examined, own)
            if new := found and found - self._current_labels_on(own):
                return sorted(new), ""
        if unseen := len(self._examined.task.seeds) - count:
            return (
                [],
                f"; labels of {plural(unseen, 'seed')} of the task were not checked: time limit",
            )
        return [], ""

    def _current_labels_on(self, task: Task) -> set[str]:
        """Return the labels of the model as written, from one set of runs per set of seeds."""
        if task.seeds not in self._current_labels:
            self._current_labels[task.seeds] = self._run_labels(self._examined, task)
        return self._current_labels[task.seeds]

    def _run_labels(self, examined: CheckedModel, task: Task) -> set[str]:
        """Return the labels of the runs of a task."""
        with TemporaryDirectory(prefix="contactlab-") as folder:
            workers = (
                self._session.workers if self._problem.pass_seconds > _MIN_PROCESS_SECONDS else 0
            )
            session = replace(self._session, folder=Path(folder), workers=workers)
            alone = replace(examined, session=session)
            runs = alone.run("labels", "Judged on fresh seeds", seeds=task.seeds)
            return {each.label for each in run_labels(task, [run.record for run in runs])}

    def _touching_pair(self) -> str:
        """Return the first far pair that touches on fresh seeds, or ""."""
        model = self._problem.own_model
        runs = [part.positions for part in self._fresh_reference.phases]
        near, pairs = pairs_within(model, runs, 0.0), self._problem.far_geom_pairs
        pair = min(pairs if near is None else pairs & near, default=None)
        return " and ".join(printed_geom_name(model, geom) for geom in pair) if pair else ""


def step_fraction(share: float | None, limit: float) -> float:
    """Return the fraction of a step, or of an error, that may hold after a failure.

    The error is of first order in the step. If there is no error, or it is within the limit, a
    fixed fraction is tried.
    """
    return min(_FALLBACK_STEP_FRACTION, limit / share) if share else _FALLBACK_STEP_FRACTION


def evaluations_per_step(model: mujoco.MjModel) -> float:
    """Estimate the force evaluations of a verdict per step of the model."""
    stages = _RK4_STAGES if model.opt.integrator == _RK4 else 1
    return stages * evaluations(model, _BUDGET_SETTINGS)


def _seed_range(budget: ErrorBudget) -> tuple[float, float]:
    """Return the least and largest error over seeds, in the worst phase."""
    seeds = max(budget.phases, key=lambda phase: phase.run.error).run.seeds
    return float(seeds.min()), float(seeds.max())
