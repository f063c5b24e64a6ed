"""Writes and verifies the recommended settings on fresh seeds.

A candidate that fails verification is skipped, and the next best one is tried. If the time limit
ends that, the candidate with exact savings remains: its motion is that of the model as written.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from shutil import rmtree

import mujoco

from contactlab.errors import SceneError
from contactlab.modifications.unused_pairs import pairs_within
from contactlab.rendering.amounts import format_percent
from contactlab.reporting.verified_measures import describe_measure
from contactlab.scene.model_names import printed_geom_name
from contactlab.scene.model_writer import WrittenModel, write_model
from contactlab.schema.tune_report import MODEL, Target, Verification
from contactlab.schema.verification import VerifiedChange, VerifiedMeasure
from contactlab.studies.search.configuration import (
    INTEGRATOR,
    Configuration,
    Key,
    changed_settings,
    format_settings,
)
from contactlab.studies.search.report_text import (
    UNVERIFIED,
    error_text,
)
from contactlab.studies.search.search_space import SkippedParameter
from contactlab.studies.search.settings_search import (
    EQUAL_ERROR_RATIO,
    SAVING,
    STEP_MARGIN,
    SURE_COST,
    Bound,
    Ending,
    Evaluation,
    OutOfTimeError,
    Search,
    error_of,
)
from contactlab.studies.search.tune_request import TuneRequest
from contactlab.studies.search.tuning_problem import PLAN, TuningProblem
from contactlab.studies.verification import (
    VerificationRequest,
    verify_change,
)
from contactlab.studies.verification.grip_measures import compare_grips
from contactlab.studies.verification.panel import ERROR_FLOOR
from contactlab.tasks.checked_model import CheckedModel, open_changed_model
from contactlab.tasks.reference_error import ErrorEstimate
from contactlab.tasks.session import Session
from contactlab.tasks.stress_motions import KnownStates, double_inputs, tilt_gravity
from contactlab.tasks.time_limit import TimeLimit

ACCURATE = "ok"
"""The verdict of `contactlab MODEL` on accurate numerics."""


@dataclass(frozen=True)
class Goal:
    """A goal of the search.

    Attributes:
        bound: of the error.
        folder: folder of the written model.
        must_be_sound: whether the verdict must be accurate; otherwise it may equal the verdict on
            the model as written.
        allows_error: whether the error of the bound is requested, so that errors may grow up to it.
        checks_error: whether the numerical error decides; that of a requested point does not.
    """

    bound: Bound
    folder: str
    must_be_sound: bool = True
    allows_error: bool = False
    checks_error: bool = True


@dataclass(frozen=True)
class VerifiedCandidate:
    """A candidate whose model was written, and judged on fresh seeds."""

    evaluation: Evaluation
    model: WrittenModel
    verification: Verification


@dataclass(frozen=True)
class FailureBound:
    """Bound on candidates after others failed: a smaller error, or a shorter step.

    Attributes:
        error: a candidate with at most this error may have any step that did not fail.
        multiple: in fine steps; a candidate with at most this step may have any allowed error.
        failed: shortest failed step by integrator; only steps that keep a margin to it are tried.
    """

    error: float = math.inf
    multiple: float = 0.0
    failed: Mapping[object, int] = field(default_factory=dict[object, int])

    def admits(self, evaluation: Evaluation) -> bool:
        """Return whether a candidate satisfies the bound."""
        failed = self.failed.get(_integrator_of(evaluation), math.inf)
        if evaluation.configuration.multiple > STEP_MARGIN * failed:
            return False
        return (
            error_of(evaluation) <= self.error or evaluation.configuration.multiple <= self.multiple
        )

    def tightened_by(self, evaluation: Evaluation, part: float) -> "FailureBound":
        """Return the bound after another failure; `part` is the fraction of it that may hold."""
        step = evaluation.configuration.multiple
        name = _integrator_of(evaluation)
        failed = {**self.failed, name: min(step, self.failed.get(name, step))}
        return FailureBound(part * error_of(evaluation), part * step, failed)


def _integrator_of(evaluation: Evaluation) -> object:
    return evaluation.configuration.settings.get(INTEGRATOR)


class CandidateVerifier:
    """Writes and verifies candidates.

    Attributes:
        skipped: candidates that failed or were not verified, and why.
        rejected: keys of candidates that failed on fresh seeds.
        worse: of those, the written ones, and the measure that was worse.
        errors: numerical errors of written candidates, by key, on all seeds of the task.
        ending: whether work or time ended verification early.
    """

    def __init__(
        self,
        request: TuneRequest,
        session: Session,
        problem: TuningProblem,
        search: Search,
        aim: Target,
        allowed: TimeLimit,
        time_candidate: Callable[[Evaluation], None],
    ) -> None:
        """Take the finished search, and the function that times a candidate on whole runs."""
        self._request, self._session = request, session
        self._problem, self._search, self._target = problem, search, aim
        self._time_limit, self._time_candidate = allowed, time_candidate
        self.skipped = list[SkippedParameter]()
        self.rejected, self.worse = set[Key](), dict[Key, str]()
        self.ending: Ending = "complete"
        self._reserve = 0.0  # s: what the longest verification has taken
        self.errors = {search.current.key: problem.current_error}

    @property
    def _examined(self) -> CheckedModel:
        return self._problem.examined

    @property
    def current(self) -> Evaluation:
        """The model as written."""
        return self._search.evaluations[self._search.current.key]

    def verify_best(self, goal: Goal, verdicts: int) -> VerifiedCandidate | None:
        """Verify candidates, best first; return the first that holds, or None.

        At most `verdicts` candidates are judged. The time of one verification is kept in reserve.
        If either is over, the exact savings are returned.
        """
        below, done_keys = FailureBound(), {self.current.configuration.key}
        simpler: Evaluation | None = None
        try:
            most_verdicts = 8  # per goal
            for place in range(min(verdicts, most_verdicts)):
                # After the first candidate, the points of the front have their share of the time.
                front_time = PLAN.points * PLAN.whole * self._time_limit.seconds if place else 0.0
                self._check_time(self._reserve + front_time)
                next_candidate = self._next_within_limit(goal, done_keys, below, simpler)
                simpler = None
                if next_candidate is None:
                    break
                evaluation, error = next_candidate
                result = self._write_and_verify(evaluation, error, goal)
                if result is None:
                    continue
                written_model, verified = result
                if verified.holds and not self._saves_no_time(evaluation):
                    return VerifiedCandidate(evaluation, written_model, verified)
                if not verified.holds:
                    measured = verified.numerical_error is not None
                    reason = (
                        verified.sentence if measured else f"on fresh seeds: {verified.sentence}"
                    )
                    self._reject_candidate(evaluation, reason)
                    self.worse[evaluation.configuration.key] = verified.sentence
                    # A label or another measure may be caused by the step, whatever the error.
                    limit = self._examined.task.tolerance
                    if not goal.must_be_sound:
                        limit = max(limit, self._problem.current_error.high)
                    part = step_fraction(verified.numerical_error, limit)
                    simpler = self._simpler_variant(evaluation, goal, done_keys)
                    if simpler is None:
                        below = below.tightened_by(evaluation, part)
            else:
                self._end_early(goal, "work")
        except OutOfTimeError:
            self._end_early(goal, "time")
        rmtree(self._session.folder / goal.folder, ignore_errors=True)
        return self._verify_exact(goal)

    def verify_point(self, evaluation: Evaluation, folder: str) -> VerifiedCandidate | None:
        """Write a point of the front and judge it; its error may be that of the point.

        None if it cannot be written, which `skipped` explains, or if the time limit ends it.
        """
        model = self._search.space.model_of(evaluation.configuration)
        error = self._problem.fresh_estimator.estimate_error(
            model, evaluation.configuration.multiple
        )
        allowed = max(error_of(evaluation), error.error)
        is_share = self._target.unit == "1"
        goal = Goal(
            Bound.of(allowed),
            folder,
            must_be_sound=False,
            allows_error=is_share,
            checks_error=False,
        )
        try:
            result = self._write_and_verify(evaluation, error, goal)
        except OutOfTimeError:
            self._end_early(goal, "time")
            result = None
        return VerifiedCandidate(evaluation, *result) if result else None

    def _end_early(self, goal: Goal, ending: Ending) -> None:
        self.ending = ending
        self.skipped.append(SkippedParameter(goal.folder, UNVERIFIED))

    def _simpler_variant(
        self, evaluation: Evaluation, goal: Goal, done_keys: set[Key]
    ) -> Evaluation | None:
        """Return a candidate without the settings that add error, if that serves the goal."""
        if self._search.max_cost is not None:
            return None
        choice = self._search.without_lossy(evaluation.configuration)
        if choice.key in done_keys:
            return None
        variant = self._search.evaluate(choice)
        fits = error_of(variant) <= goal.bound.accepted and self.is_better(variant, goal.bound)
        return variant if fits else None

    def _check_time(self, takes: float = 0.0) -> None:
        if self._time_limit.remaining < takes:
            raise OutOfTimeError

    def _write_and_verify(
        self, evaluation: Evaluation, error: ErrorEstimate, goal: Goal
    ) -> tuple[WrittenModel, Verification] | None:
        begin = self._time_limit.elapsed
        try:
            written_model = self._write_model(evaluation, goal.folder)
        except SceneError as refused:
            self._reject_candidate(evaluation, str(refused).splitlines()[0])
            return None
        verification = self._verify_model(evaluation, error, written_model, goal)
        self._reserve = max(self._reserve, self._time_limit.elapsed - begin)
        return written_model, verification

    def _saves_no_time(self, evaluation: Evaluation) -> bool:
        """Time a candidate on whole runs; reject it if it proves to save none although it should.

        Its counted work decides while the interval of its time leaves a saving open, so that the
        same candidate is recommended on a busy machine.
        """
        self._time_candidate(evaluation)
        price = evaluation.time_ratio
        if self._search.max_cost is not None or error_of(self.current) > self._target.limit:
            return False
        if price is None or price.low <= SAVING:
            return False
        self._reject_candidate(
            evaluation, f"{price.text} time: no saving, although it does less work"
        )
        return True

    def _verify_exact(self, goal: Goal) -> VerifiedCandidate | None:
        """Return the exact savings if they serve a goal, and stay exact on other runs."""
        exact = (
            one
            for one in self._search.rank_candidates(goal.bound)
            if one.exact and one.configuration.key not in self.rejected
        )
        evaluation = next((one for one in exact if self.is_better(one, goal.bound)), None)
        if evaluation is None or self._search.max_cost is not None:
            return None
        if self._time_limit.remaining < 0 or not self._stays_exact(evaluation):
            return None
        try:
            written_model = self._write_model(evaluation, goal.folder)
        except SceneError as refused:
            self._reject_candidate(evaluation, str(refused).splitlines()[0])
            return None
        if lost := self._find_lost_grip(written_model):
            self._reject_candidate(evaluation, f"worse than as written: {describe_measure(lost)}")
        if lost or self._saves_no_time(evaluation):
            rmtree(self._session.folder / goal.folder, ignore_errors=True)
            return None
        current = self._problem.current_error
        if self._target.unit == "1":
            self.errors[evaluation.configuration.key] = current
        return VerifiedCandidate(
            evaluation,
            written_model,
            Verification(
                seeds=self._problem.fresh_task.seeds,
                holds=True,
                meets_target=error_of(evaluation) <= max(self._target.limit, goal.bound.accepted),
                error=None,
                current_error=None,
                verdict=self._problem.judged.budget_verdict.word,
                numerical_error=current.error,
                labels=(),
                sentence="the motion is that of the model as written, bit for bit, in the task, on "
                "fresh seeds, tilted, and with twice the inputs",
                panel=None,
            ),
        )

    def _find_lost_grip(self, written_model: WrittenModel) -> VerifiedMeasure | None:
        # The task of a gripper without an object loads no pad: equal bits prove nothing of grips.
        changed = open_changed_model(written_model.reference, self._session, self._request.task)
        measures = compare_grips(self._examined, changed, self._problem.original_runs.grips)
        return next((measure for measure in measures if measure.worse), None)

    def _stays_exact(self, evaluation: Evaluation) -> bool:
        """Return whether a candidate moves as the model as written on runs of no search."""
        candidate_model = self._search.space.model_of(evaluation.configuration)
        own = [
            *self._problem.fresh_motions,
            *(
                change(motion)
                for motion in self._problem.fresh_motions
                for change in (tilt_gravity, double_inputs)
            ),
        ]
        changed = list[mujoco.MjModel]()
        for motion in own:
            other = self._problem.as_run(candidate_model, motion.model)
            other.opt.gravity[:] = motion.model.opt.gravity
            changed.append(other)
        return KnownStates(own, self._problem.threads).match_models(changed)

    def _reject_candidate(self, evaluation: Evaluation, reason: str) -> None:
        self.rejected.add(evaluation.configuration.key)
        self.skipped.append(SkippedParameter(self._settings_text(evaluation), reason))

    def _next_within_limit(
        self,
        goal: Goal,
        done_keys: set[Key],
        below: FailureBound,
        simpler: Evaluation | None = None,
    ) -> tuple[Evaluation, ErrorEstimate] | None:
        """Return the best candidate within the bound whose error holds on fresh seeds.

        An error estimate takes a small part of the time of a verdict. A simpler variant of the
        candidate that failed last is tried first.
        """
        first = True
        most_estimates = 25  # of errors on fresh seeds, per goal
        while len(done_keys) < most_estimates:
            self._check_time(self._reserve)
            evaluation = simpler or self._next_candidate(done_keys, goal.bound, below)
            simpler = None
            if evaluation is None:
                return None
            done_keys.add(evaluation.configuration.key)
            candidate_model = self._search.space.model_of(evaluation.configuration)
            error = self._problem.fresh_estimator.estimate_error(
                candidate_model, evaluation.configuration.multiple
            )
            why = self._excess_reason(error, goal)
            if not why:
                return evaluation, error
            if first:
                self._reject_candidate(evaluation, f"on fresh seeds: {why}")
            self.rejected.add(evaluation.configuration.key)
            below = below.tightened_by(evaluation, self._limit_of(goal) / max(error.error, 1e-300))
            first = False
        return None

    def _settings_text(self, evaluation: Evaluation) -> str:
        return format_settings(self.settings(evaluation.configuration)) or "without unused parts"

    def is_better(self, evaluation: Evaluation, bound: Bound) -> bool:
        """Return whether a candidate serves a goal better than the model as written."""
        now = error_of(self.current)
        if self._search.max_cost is not None:
            return self._search.max_cost < 1 or error_of(evaluation) < SAVING * now
        return now > bound.limit or evaluation.cost <= SURE_COST

    def _next_candidate(
        self, done_keys: set[Key], bound: Bound, below: FailureBound
    ) -> Evaluation | None:
        """Return the best unverified candidate within the bound: known, or at a shorter step."""
        search = self._search
        ranked = search.rank_candidates(bound)

        def fits(one: Evaluation) -> bool:
            new = one.configuration.key not in done_keys
            keeps = search.max_cost is not None or error_of(one) <= bound.accepted
            allowed = below.admits(one) or self._is_as_accurate_as_current(one, bound)
            return new and keeps and allowed and self.is_better(one, bound)

        ranked_choice = next((one for one in ranked if fits(one)), None)
        if search.max_cost is not None or not ranked or ranked_choice is ranked[0]:
            return ranked_choice
        shorter = (search.evaluate(choice) for choice in search.shorter_steps(ranked[0]))
        for candidate in shorter:
            if ranked_choice is not None and candidate.cost >= ranked_choice.cost:
                break
            if fits(candidate):
                return candidate
            if candidate.cost > SURE_COST and error_of(self.current) <= bound.limit:
                break
        return ranked_choice

    def _is_as_accurate_as_current(self, evaluation: Evaluation, bound: Bound) -> bool:
        """Return whether a candidate is as accurate as the model as written, at no longer step.

        If that model satisfies the bound, failures at longer steps do not concern such a candidate.
        """
        now, short = (
            error_of(self.current),
            evaluation.configuration.multiple <= self.current.configuration.multiple,
        )
        floor = ERROR_FLOOR if self._target.unit == "1" else 0.0
        equal = Bound.as_current(now, floor).accepted
        return now <= bound.accepted and short and error_of(evaluation) <= equal

    def settings(self, choice: Configuration) -> dict[str, object]:
        """Return the settings of a candidate, with its timestep."""
        changed_values = changed_settings(choice.settings, self._problem.model)
        if choice.multiple == self._problem.reference.substeps:
            return changed_values
        return {"timestep": self._problem.timestep_of(choice), **changed_values}

    def _write_model(self, evaluation: Evaluation, folder: str) -> WrittenModel:
        choice = evaluation.configuration
        edits = replace(self._problem.edits_of(choice.reductions), settings=self.settings(choice))
        return write_model(self._examined.scene, edits, self._session.folder / folder, MODEL)

    def _excess_reason(self, error: ErrorEstimate, goal: Goal) -> str:
        """Return why an error on fresh seeds is too large, or ""."""
        limit = self._limit_of(goal)
        if self._search.max_cost is not None or error.error <= limit:
            return ""
        if self._target.unit == "1":
            return f"its error in {error.body} is too large there"
        own, most = (error_text(each, self._target.unit) for each in (error.error, limit))
        return f"error {own} in {error.body}, at most {most}"

    def _verify_model(
        self, evaluation: Evaluation, error: ErrorEstimate, written_model: WrittenModel, goal: Goal
    ) -> Verification:
        """Judge a written model with a known error on fresh seeds."""
        self._session.notify(f"verifying {self._settings_text(evaluation)}")
        examined = open_changed_model(written_model.reference, self._session, self._request.task)
        problem, why = self._problem, ""
        if "far-pairs" in evaluation.configuration.reductions and (pair := self._touching_pair()):
            why = f"{pair} touch, but stayed apart before"
        panel = None if why else self._compare_measures(examined, goal)
        if panel is not None and panel.ended_early and panel.passed:
            raise OutOfTimeError
        if panel is not None and not panel.passed:
            why = f"worse than as written: {panel.sentence}"
        own, word = None, ""
        if panel is not None and panel.passed:
            own, word, why = self._judge_error(examined, goal)
            if self._target.unit == "1":
                self.errors[evaluation.configuration.key] = own
        holds = not why
        timely = self._search.max_cost is not None
        is_within = (error if own is None else own).error <= self._largest_met_error
        return Verification(
            seeds=problem.fresh_task.seeds,
            holds=holds,
            meets_target=holds and (timely or is_within),
            error=error.error if self._target.unit != "1" else None,
            current_error=problem.fresh_error.error if self._target.unit != "1" else None,
            verdict=word,
            numerical_error=own.error if own else None,
            labels=(),
            sentence=why or self._join_result(panel, word),
            panel=panel,
        )

    @staticmethod
    def _join_result(panel: VerifiedChange | None, word: str) -> str:
        sentence = panel.sentence if panel else ""
        return sentence if word == ACCURATE else f"{sentence}; {word}, like the model as written"

    def _judge_error(self, examined: CheckedModel, goal: Goal) -> tuple[ErrorEstimate, str, str]:
        # Return the numerical error of a written candidate, its verdict, and why it fails.
        problem, tolerance = self._problem, self._examined.task.tolerance
        error, verdict = problem.judge_written(examined)
        now, now_word = problem.current_error, problem.judged.budget_verdict.word
        text, unit = format_percent(error.error), "1"
        why = ""
        if verdict.word != ACCURATE and (goal.must_be_sound or verdict.word != now_word):
            why = verdict.reasons[0].sentence
        elif not goal.checks_error:
            pass
        elif goal.must_be_sound and error.error > tolerance:
            why = f"numerical error {text}, above the tolerance"
        elif goal.allows_error and self._target.unit == unit:
            limit = goal.bound.limit
            if error.error > limit:
                why = f"numerical error {text}, above {format_percent(limit)}"
        elif not goal.must_be_sound and error.low > max(EQUAL_ERROR_RATIO * now.high, ERROR_FLOOR):
            # Motions from the same starts differ, and have another mean.
            why = f"numerical error {text}, {format_percent(now.error)} as written"
        return error, verdict.word, why

    def _compare_measures(self, changed: CheckedModel, goal: Goal) -> VerifiedChange:
        """Run the original and the changed model next to each other; the time limit ends it."""
        return verify_change(
            VerificationRequest(
                original=self._examined,
                changed=changed,
                allowed_error=self._limit_of(goal) if goal.allows_error else 0.0,
                stop_early=True,
                most_seeds=self._problem.verified_seeds,
                length_share=self._problem.verified_share,
                runs=self._problem.original_runs,
                find_time_left=lambda: self._time_limit.remaining,
            )
        )

    def _limit_of(self, goal: Goal) -> float:
        """Return the largest allowed error of a goal on fresh seeds.

        If the model as written satisfies the goal in the search, its error here is allowed.
        """
        has_limit = self._target.kind in ("error", "forward error", "tolerance")
        floor = ERROR_FLOOR if self._target.unit == "1" else 0.0
        is_given = goal.allows_error or (has_limit and goal.must_be_sound)
        limit = goal.bound.limit if is_given else floor
        if error_of(self.current) <= goal.bound.limit:
            return max(limit, self._equal_fresh_error)
        return limit

    @property
    def _largest_met_error(self) -> float:
        """Largest error that meets the target."""
        limit = self._target.limit
        if error_of(self.current) > limit:
            return limit
        if self._target.unit == "1":
            return max(limit, self._problem.current_error.high)
        return max(limit, self._equal_fresh_error)

    @property
    def _equal_fresh_error(self) -> float:
        """Largest error on fresh seeds that equals that of the model as written there."""
        fresh = self._problem.fresh_error.error
        by_chance = min(fresh + self._target.chance, self._target.tolerance)
        return max(EQUAL_ERROR_RATIO * fresh, by_chance if self._target.chance else 0.0)

    def _touching_pair(self) -> str:
        """Return the first far pair that touches on fresh seeds, or ""."""
        model = self._problem.own_model
        runs = [part.positions for part in self._problem.fresh_reference.phases]
        near, pairs = pairs_within(model, runs, 0.0), self._problem.far_geom_pairs
        pair = min(pairs if near is None else pairs & near, default=None)
        return " and ".join(printed_geom_name(model, geom) for geom in pair) if pair else ""


def step_fraction(share: float | None, limit: float) -> float:
    """Return the fraction of a step, or of an error, that may hold after a failure.

    The error is of first order in the step. If there is no error, or it is within the limit, a
    fixed fraction is tried.
    """
    fallback_fraction = 0.6
    return min(fallback_fraction, limit / share) if share else fallback_fraction
