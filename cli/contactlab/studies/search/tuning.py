"""The tune study: target, search, written model, and verification on fresh seeds."""

import copy
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from shutil import rmtree
from statistics import stdev
from typing import TypedDict

import mujoco

from contactlab.budget import Motion
from contactlab.budget.restarts import build_reference_model
from contactlab.errors import ExpectationError, SweepFileError
from contactlab.modifications.catalogue import list_rows
from contactlab.modifications.model_predicates import may_sleep
from contactlab.modifications.modification import ModelChange, ReductionName
from contactlab.rendering.amounts import format_amount
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_edits import FLAG_NAMES, read_flag, read_option
from contactlab.scene.mujoco_versions import VERSION
from contactlab.schema.evidence import Setting
from contactlab.schema.tune_report import (
    EQUAL_ERROR_FOLDER,
    FOLDER,
    POINT_FOLDER,
    REPORT,
    AlternativeCandidate,
    Candidate,
    ChangedSetting,
    CurrentVerdict,
    FarPairs,
    FrontPoint,
    ParameterUncertainty,
    PatchedLine,
    PointState,
    SimplifiedHulls,
    SkippedSetting,
    Target,
    TargetKind,
    TuneReport,
)
from contactlab.step_progress import step_names
from contactlab.store.table_layout import axis_cell
from contactlab.studies.examine.standing_starts import list_falls
from contactlab.studies.search.configuration import (
    INTEGRATOR,
    Configuration,
    Key,
    changed_settings,
    format_settings,
)
from contactlab.studies.search.forward_error import Divergence, join_phases, measure_divergence
from contactlab.studies.search.front import (
    FrontRules,
    choose_contenders,
    choose_front,
    drop_slower,
)
from contactlab.studies.search.report_text import sentence_of
from contactlab.studies.search.search_space import find_integrators, find_parameters
from contactlab.studies.search.seed_errors import SeededPoint, narrow_errors
from contactlab.studies.search.settings_search import (
    SAVING,
    Bound,
    Ending,
    Evaluation,
    OutOfTimeError,
    Search,
    SearchSpace,
    error_of,
)
from contactlab.studies.search.tune_request import TuneRequest, refuse_contradictions
from contactlab.studies.search.tuning_problem import PLAN, TuningProblem
from contactlab.studies.search.verification import CandidateVerifier, Goal, VerifiedCandidate
from contactlab.studies.verification.panel import ERROR_FLOOR
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.reference_error import ErrorEstimate, TaskReference
from contactlab.tasks.session import Session
from contactlab.tasks.stress_motions import join_seeds
from contactlab.tasks.task_clock import Clock
from contactlab.tasks.task_motions import with_new_seeds
from contactlab.tasks.time_limit import TimeLimit


def tune_model(
    request: TuneRequest,
    session: Session,
    spent: float = 0.0,
    cached_report: TuneReport | None = None,
) -> TuneReport:
    """Search for settings that meet a target, write the model with them, and verify it.

    The folder receives `tune.json`, and the model if something is recommended, or a point of the
    front is picked. The time limit includes `spent` seconds of CPU time before. A known report of
    the same question is not searched again.

    Raises:
        SceneError: there is no such model, it does not compile, or an observed name is unknown.
        SweepFileError: the tolerance is not a share, options contradict each other, or the front
            has no such point.
        EngineError: nothing moves, or MuJoCo is not the engine.
        ExpectationError: a forward error is requested for a chaotic motion.
        OutputError: the folder cannot be written, or has another model's results.
    """
    allowed = TimeLimit(request.max_cpu, spent)
    refuse_contradictions(request)
    session = replace(session, folder=session.folder.resolve())
    examined = open_model(request.model, session, request.task)
    session.claim("tune", request.model)
    session.notify(f"tuning {request.model}")
    problem = TuningProblem(request, examined, max(1, session.workers), allowed)
    study = TuningStudy(request, session, problem, allowed)
    report = study.run_study() if cached_report is None else cached_report
    if request.pick is not None:
        report = study.pick_point(report, request.pick)
    session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


class _ErrorFields(TypedDict):
    error: float
    error_low: float | None
    error_high: float | None
    error_seeds: int


class TuningStudy:
    """The study of one model."""

    def __init__(
        self,
        request: TuneRequest,
        session: Session,
        problem: TuningProblem,
        allowed: TimeLimit,
    ) -> None:
        """Set up the search."""
        self._request, self._session, self._problem = request, session, problem
        self._time_limit, self._begin = allowed, time.monotonic()
        self._clock = Clock(problem.reference, problem.model)
        motions = problem.motions
        parameters, unchanged = find_parameters(problem.own_model, motions)
        self._skipped = [*problem.skipped, *unchanged]
        space = SearchSpace(
            problem.models,
            problem.start,
            problem.reference.substeps,
            problem.steps,
            parameters,
            find_integrators(problem.own_model),
            problem.simplified,
            may_sleep=may_sleep(problem.own_model),
        )
        estimator = problem.error_estimator(problem.reference, motions)
        self._search = Search(
            space,
            estimator,
            problem.cost,
            (),
            self._max_cost(),
            problem.search_passes,
            lambda: allowed.elapsed > PLAN.searched * allowed.seconds,
            problem.moves_alike,
            front_work=PLAN.front / PLAN.search * problem.search_passes,
            sleep_work=problem.sleep_work,
        )
        self._errors = dict[Key, ErrorEstimate]()
        self._points_seconds = 0.0  # counted time of the errors of points so far
        self._divergence: Divergence | None = None
        self._target = self._find_target()
        self._goals = self._find_goals()
        self._search.bounds = tuple(goal.bound for goal in self._goals)
        is_share = self._target.unit == "1"
        limit = self._target.tolerance if is_share else self._target.limit
        now = self._current_error
        self._search.front_limit = max(limit, now) if math.isfinite(now) else limit
        self._verifier = CandidateVerifier(
            request, session, problem, self._search, self._target, allowed, self._time_candidate
        )

    @property
    def _current_error(self) -> float:
        """Error of the model as written, as the search estimates it."""
        return error_of(self._search.evaluate_current())

    def _find_target(self) -> Target:
        request, problem, unit = self._request, self._problem, "1"
        tolerance = problem.examined.task.tolerance
        kind: TargetKind = "as written"
        if request.error_at is not None:
            kind = "forward error"
            self._divergence = measure_divergence(join_phases(problem.motions), problem.threads)
            if self._divergence.chaotic:
                raise ExpectationError(
                    f"{request.model}: a forward error is not available, since the motion is "
                    f"{self._divergence.sentence}. Remove --error-at to use the error budget"
                )
            unit = problem.observed_outputs[0].unit
        now = self._find_error(self._search.evaluate_current()).error
        limit = max(now, ERROR_FLOOR)
        if request.error is not None:
            kind = "error" if request.error_at is None else kind
            limit = request.error if request.error_at else min(request.error, tolerance)
        elif request.real_time is not None:
            kind = "real time"
        elif now > tolerance:
            kind, limit = "tolerance", tolerance
        return Target(
            kind=kind,
            limit=limit if math.isfinite(limit) else tolerance,
            unit=unit,
            tolerance=tolerance,
            real_time=request.real_time,
            observed=tuple(request.observed) if request.error_at else (),
            error_at=request.error_at,
            divergence=self._divergence.sentence if self._divergence else "",
            chance=self._chance_of_error() if kind == "as written" else 0.0,
        )

    def _find_error(self, evaluation: Evaluation) -> ErrorEstimate:
        # The numerical error if it is known, which is printed; otherwise that of the search.
        key, current = evaluation.configuration.key, self._search.current.key
        if self._request.error_at is None and key == current:
            return self._problem.current_error
        assert evaluation.error
        return self._errors.get(key, evaluation.error)

    def _chance_of_error(self) -> float:
        # By how much the error of an equal chaotic motion may be larger: its spread over seeds.
        problem, now = self._problem, self._search.evaluate_current().error
        if now is None or not (
            measure_divergence(join_phases(problem.motions), problem.threads).chaotic
        ):
            return 0.0
        shares = [*now.shares, *problem.fresh_error.shares]
        return stdev(shares) if len(shares) > 1 and math.isfinite(sum(shares)) else 0.0

    def _max_cost(self) -> float | None:
        if self._request.real_time is None:
            return None
        return 1 / (self._request.real_time * self._clock.base_seconds)

    def _find_goals(self) -> list[Goal]:
        """Return the goals in the order of the search.

        By default: the fastest candidate that is no less accurate than the model as written. If
        that is less accurate than the target: also the fastest that meets the target.
        """
        now, limit = self._current_error, self._target.limit
        own = self._find_error(self._search.evaluate_current()).error
        if self._target.kind in ("as written", "real time"):
            chance = max(0.0, min(self._target.chance, self._target.tolerance - own))
            bound = Bound.as_current(now, ERROR_FLOOR, chance)
            return [Goal(bound, FOLDER, must_be_sound=False)]
        if own <= limit:
            bound = Bound.of(limit).or_as_current(now)
            return [Goal(bound, FOLDER, allows_error=self._target.kind == "error")]
        as_current = Goal(Bound.as_current(now), EQUAL_ERROR_FOLDER, must_be_sound=False)
        requested_goal = Goal(Bound.of(limit), FOLDER, allows_error=self._target.kind == "error")
        return [as_current, requested_goal]

    def run_study(self) -> TuneReport:
        """Search, write and verify candidates, and return the report."""
        with step_names(2) as begin_step:
            begin_step("searching")
            self._search.run_search()
            begin_step("verifying candidates")
            return self._verify_and_report()

    def _verify_and_report(self) -> TuneReport:
        search, verifier = self._search, self._verifier
        current = verifier.current
        points = self._session.folder.glob(POINT_FOLDER.format(number="*"))
        for folder in (FOLDER, EQUAL_ERROR_FOLDER, *points):
            rmtree(self._session.folder / folder, ignore_errors=True)
        best, as_current = self._verify_goals()
        is_met = best is not None or self._meets_target(current)
        nearest = None if is_met else search.closest_to(self._target.limit, verifier.rejected)
        if nearest and self._target.unit == "1" and self._time_limit.remaining > 0:
            self._measure_point(nearest)
        answers_found = [answer for answer in (best, as_current) if answer]
        front = self._describe_front(best, as_current)
        removes_unused = any(point.candidate.removes_unused for point in front)
        edits = self._problem.unused if removes_unused else ModelEdits()
        report = TuneReport(
            model=self._request.model,
            scene_hash=self._problem.examined.scene.hash,
            mujoco=VERSION,
            task=self._problem.judged.task,
            fall="".join(fact.sentence for fact in list_falls(self._problem.motions[0], ())),
            target=self._target,
            sentence="",
            target_met=is_met,
            current=self._describe_candidate(current),
            current_verdict=CurrentVerdict(
                seeds=self._problem.judged.task.seeds,
                verdict=self._problem.judged.budget_verdict.word,
                numerical_error=self._problem.current_error.error,
            ),
            recommended=self._describe_candidate(best.evaluation) if best else None,
            far_pairs=self._report_far_pairs([answer.evaluation for answer in answers_found]),
            simplified_hulls=self._report_hulls(answers_found),
            closest=self._describe_candidate(nearest) if nearest else None,
            limiting_factor=self._limiting_factor(nearest) if nearest else "",
            unconstrained_cost=self._unconstrained_cost(
                best.evaluation if best else None, as_current.evaluation if as_current else None
            ),
            equal_error=self._describe_alternative(as_current),
            front=front,
            picked=None,
            uncertainty=tuple(self._measure_uncertainty()),
            real_time=1 / self._clock.base_seconds,
            integrator=self._own_integrator,
            reference_integrator=self._problem.reference_integrator or self._own_integrator,
            reference_step=self._problem.reference.step,
            candidates=tuple(
                self._describe_candidate(one) for one in search.evaluations.values() if one.error
            ),
            changed_settings=tuple(self._changed_settings(best.evaluation)) if best else (),
            masked=edits.masked,
            excluded=edits.excluded,
            removed_sensors=edits.sensors,
            disabled_flags=edits.unflagged,
            not_changed=tuple(
                SkippedSetting(name=one.name, reason=one.reason)
                for one in (*self._skipped, *verifier.skipped)
            ),
            verified=best.verification if best else None,
            file=self._file_of(best) if best else None,
            lines=tuple(PatchedLine(**vars(change)) for change in best.model.changes)
            if best
            else (),
            trials=len(search.evaluations),
            planned_trials=max(len(search.evaluations), search.trials * len(self._goals)),
            ended=_join_endings(search.ending, verifier.ending),
            max_cpu=self._request.max_cpu,
            seconds=time.monotonic() - self._begin,
        )
        return report.model_copy(update={"sentence": sentence_of(report)})

    def pick_point(self, report: TuneReport, number: int) -> TuneReport:
        """Write and verify a point of a front, and return the report with it.

        Raises:
            SweepFileError: the front has no such point.
        """
        points_by_number = {point.number: point for point in report.front}
        if number not in points_by_number:
            raise SweepFileError(
                f"--pick {number}: the front has {len(points_by_number)} points. Write a number "
                f"from 1 to {len(points_by_number)}"
            )
        point = points_by_number[number]
        if point.state == "not verified":
            point = self._verify_point(point)
        front = tuple(point if one.number == number else one for one in report.front)
        return report.model_copy(update={"front": front, "picked": number})

    def _verify_point(self, point: FrontPoint) -> FrontPoint:
        evaluation = self._search.evaluate(self._configuration_of(point.candidate))
        folder = POINT_FOLDER.format(number=point.number)
        answer = self._verifier.verify_point(evaluation, folder)
        if answer is None:
            reason = self._verifier.skipped[-1].reason
            return point.model_copy(update={"verification": reason})
        verification = answer.verification
        own = self._verifier.errors.get(evaluation.configuration.key)
        errors = self._narrow_errors([evaluation], [own], [evaluation]) if own else []
        return point.model_copy(
            update={
                **(_describe_error(errors[0]) if errors else {}),
                "state": "verified" if verification.holds else "failed",
                "verification": verification.sentence,
                "verified": verification,
                "file": self._file_of(answer),
            }
        )

    def _configuration_of(self, candidate: Candidate) -> Configuration:
        removed: dict[ReductionName, bool] = {
            "unused": candidate.removes_unused,
            "far-pairs": candidate.removes_far_pairs,
            "hulls": candidate.simplifies_hulls,
        }
        reductions = frozenset[ReductionName](name for name in removed if removed[name])
        multiple = round(candidate.timestep / self._problem.reference.step)
        return Configuration(candidate.settings, multiple, reductions)

    def _describe_front(
        self, best: VerifiedCandidate | None, as_current: VerifiedCandidate | None
    ) -> tuple[FrontPoint, ...]:
        verifier = self._verifier
        answers = {
            name: answer
            for name, answer in (("recommended", best), ("equal error", as_current))
            if answer is not None
        }
        verified_ones = [answer.evaluation for answer in answers.values()]
        points, errors = self._choose_points([verifier.current, *verified_ones])
        errors = self._narrow_errors(points, errors, [verifier.current, *verified_ones])
        self._time_points(points)
        rows = zip(self._name_points(points), points, errors, strict=True)
        by_error = drop_slower(
            sorted(rows, key=lambda row: row[2].error),
            lambda row: self._time_share(row[1]),
            {one.configuration.key for one in (verifier.current, *verified_ones)},
        )
        return tuple(
            self._describe_point(number, name, one, error, answers)
            for number, (name, one, error) in enumerate(by_error, 1)
        )

    def _choose_points(
        self, marked: Sequence[Evaluation]
    ) -> tuple[list[Evaluation], list[ErrorEstimate]]:
        # Return the points of the front, and their numerical errors. The search estimates errors
        # from other states, so its best candidates are measured, as far as the work allows.
        search = self._search
        candidates = [one for one in search.evaluations.values() if one.error]
        candidates = [one for one in candidates if search.keeps_margin(one, search.front_limit)]
        if self._target.unit != "1":
            return self._choose_forward(candidates, marked)
        contenders, seeds = self._choose_contenders(candidates, marked)
        for one in marked:
            self._measure_point(one)
        for one in contenders:
            if self._time_limit.remaining < 0:
                self._verifier.ending = "time"
                contenders = [each for each in contenders if each.configuration.key in self._errors]
                break
            self._measure_point(one, seeds)
        errors = [self._find_error(one) for one in contenders]
        return self._choose_measured(contenders, errors, marked)

    def _measure_point(self, evaluation: Evaluation, seeds: int | None = None) -> None:
        key, known = evaluation.configuration.key, self._verifier.errors
        if key in known:
            self._errors[key] = known[key]
        elif key not in self._errors:
            own = self._problem.judged.task.seeds[:seeds]
            self._errors[key] = self._measure_on(evaluation, own)
            self._points_seconds += len(own) * self._seconds_of(evaluation)

    def _measure_on(self, evaluation: Evaluation, seeds: Sequence[int]) -> ErrorEstimate:
        model = self._search.space.model_of(evaluation.configuration)
        step = self._problem.timestep_of(evaluation.configuration)
        return self._problem.measure_error(model, step, seeds)

    def _seconds_of(self, evaluation: Evaluation) -> float:
        # Counted time of the error on one seed.
        return self._problem.measuring_seconds * evaluation.cost

    def _narrow_errors(
        self,
        points: Sequence[Evaluation],
        errors: Sequence[ErrorEstimate],
        marked: Sequence[Evaluation],
    ) -> list[ErrorEstimate]:
        # Return errors on more seeds, as far as the work allows: first of the marked points, then
        # of those that cost little. A point that moves
        # as written has the error as written.
        if self._target.unit != "1":
            return list(errors)
        marked_keys = [one.configuration.key for one in marked]
        pairs = list(zip(points, errors, strict=True))
        seeded = dict[Key, SeededPoint]()
        for one, error in sorted(
            pairs, key=lambda pair: (pair[0].configuration.key not in marked_keys, pair[0].cost)
        ):
            if math.isfinite(error.error) and error.by_phase:
                seeded.setdefault(self._motion_key(one), self._seed_point(one, error))
        problem = self._problem
        allowed = PLAN.points / PLAN.search * problem.work - self._points_seconds
        allowed += self._search.work_left * problem.trial_seconds
        try:
            narrow_errors(list(seeded.values()), len(problem.judged.task.seeds), allowed)
        except OutOfTimeError:
            self._verifier.ending = "time"
        known = {key: point.error for key, point in seeded.items()}
        return [known.get(self._motion_key(one), error) for one, error in pairs]

    def _motion_key(self, evaluation: Evaluation) -> Key:
        return (self._search.current if evaluation.exact else evaluation.configuration).key

    def _seed_point(self, evaluation: Evaluation, error: ErrorEstimate) -> SeededPoint:
        fresh = max(self._problem.judged.task.seeds) + 1

        def measure_fresh(used: int, count: int) -> ErrorEstimate:
            if self._time_limit.remaining < 0:
                raise OutOfTimeError
            seeds = range(fresh + used, fresh + used + count)
            return self._measure_on(evaluation, seeds)

        return SeededPoint(error, self._seconds_of(evaluation), measure_fresh)

    def _choose_forward(
        self, candidates: Sequence[Evaluation], marked: Sequence[Evaluation]
    ) -> tuple[list[Evaluation], list[ErrorEstimate]]:
        # The largest error of all seeds grows with their number, so that fresh seeds are as many.
        rules, seeds = FrontRules(), self._problem.seeds
        contenders = choose_contenders(candidates, marked, self._search.front_limit, rules)
        if not self._has_time(contenders, seeds):
            points = choose_front(candidates, marked, self._search.front_limit)
            return points, [one.error for one in points if one.error]
        first = max(self._problem.task.seeds) + 1
        errors = self._measure_forward(contenders, first, seeds)
        return self._choose_measured(contenders, errors, marked)

    def _limit_front(self, evaluations: Sequence[Evaluation]) -> float:
        own = (error_of(one) for one in evaluations if one.configuration == self._search.current)
        return max([self._search.front_limit, *filter(math.isfinite, own)])

    @staticmethod
    def _with_errors(
        candidates: Sequence[Evaluation], errors: Sequence[ErrorEstimate]
    ) -> list[Evaluation]:
        pairs = zip(candidates, errors, strict=True)
        return [replace(one, error=error) for one, error in pairs]

    def _choose_contenders(
        self, candidates: Sequence[Evaluation], marked: Sequence[Evaluation]
    ) -> tuple[list[Evaluation], int]:
        # Return candidates to measure, and the number of seeds. If the work does not allow all
        # seeds, there are fewer candidates, then fewer that cost much, then fewer seeds.
        rules, limit = FrontRules(), self._search.front_limit
        all_seeds = len(self._problem.judged.task.seeds)
        keys = {one.configuration.key for one in marked}
        others = list[Evaluation]()
        for count in range(rules.contenders, rules.most - 1, -2):
            contenders = choose_contenders(
                candidates, marked, limit, replace(rules, contenders=count)
            )
            others = [one for one in contenders if one.configuration.key not in keys]
            if self._affordable_seeds(others) >= all_seeds:
                break
        others.sort(key=lambda one: one.cost)
        costly = 2.0  # work over that of the model as written; such a point is of little use
        while others and (
            (seeds := self._affordable_seeds(others)) < 1
            or (seeds < all_seeds and others[-1].cost > costly)
        ):
            others.pop()
            self._verifier.ending = "work"
        return [*marked, *others], min(all_seeds, self._affordable_seeds(others))

    def _affordable_seeds(self, candidates: Sequence[Evaluation]) -> int:
        problem = self._problem
        allowed = PLAN.points / PLAN.search * problem.work
        each = problem.measuring_seconds * sum(one.cost for one in candidates)
        return int(allowed / each) if each else len(problem.judged.task.seeds)

    def _choose_measured(
        self,
        candidates: Sequence[Evaluation],
        errors: Sequence[ErrorEstimate],
        marked: Sequence[Evaluation],
    ) -> tuple[list[Evaluation], list[ErrorEstimate]]:
        own = {one.configuration.key: one for one in candidates}
        measured_candidates = self._with_errors(candidates, errors)
        keys = {one.configuration.key for one in marked}
        fixed = [one for one in measured_candidates if one.configuration.key in keys]
        points = choose_front(measured_candidates, fixed, self._limit_front(measured_candidates))
        return [own[one.configuration.key] for one in points], [
            one.error for one in points if one.error
        ]

    def _count_seconds(self, candidates: Sequence[Evaluation]) -> float:
        # CPU time for the errors of candidates on one seed.
        problem = self._problem
        reference = problem.reference.substeps * (4 if problem.reference_integrator else 1)
        return problem.cost.pass_seconds * (reference + sum(one.cost for one in candidates))

    def _has_time(self, candidates: Sequence[Evaluation], seeds: int) -> bool:
        if seeds * self._count_seconds(candidates) <= self._time_limit.remaining:
            return True
        self._verifier.ending = "time"
        return False

    def _measure_forward(
        self, candidates: Sequence[Evaluation], first: int, count: int
    ) -> list[ErrorEstimate]:
        problem, search = self._problem, self._search
        seeds = tuple(range(first, first + count))
        motions = problem.examined.motions_of(problem.task.model_copy(update={"seeds": seeds}))
        fine = TaskReference.run_references(
            motions,
            problem.reference.substeps,
            problem.threads,
            integrator=problem.reference_integrator,
        )
        estimator = problem.error_estimator(fine, motions)
        return [
            estimator.estimate_error(
                search.space.model_of(one.configuration), one.configuration.multiple
            )
            for one in candidates
        ]

    def _time_share(self, evaluation: Evaluation) -> float:
        if evaluation.configuration.key == self._search.current.key:
            return 1.0
        return evaluation.time_ratio.ratio if evaluation.time_ratio else evaluation.cost

    def _describe_point(
        self,
        number: int,
        name: str,
        evaluation: Evaluation,
        error: ErrorEstimate,
        answers: Mapping[str, VerifiedCandidate],
    ) -> FrontPoint:
        key = evaluation.configuration.key
        own = {
            mark: answer
            for mark, answer in answers.items()
            if answer.evaluation.configuration.key == key
        }
        answer = next(iter(own.values()), None)
        is_current = key == self._search.current.key
        failed = self._verifier.worse.get(key, "")
        state: PointState = "as written" if is_current else "verified" if answer else "not verified"
        return FrontPoint(
            number=number,
            name=name,
            marks=("as written",) * is_current + tuple(own),
            candidate=self._describe_candidate(evaluation),
            **_describe_error(error),
            real_time=1 / self._clock.base_seconds / self._time_share(evaluation),
            state=state,
            verification=answer.verification.sentence if answer else failed,
            changed_settings=tuple(self._changed_settings(evaluation)),
            verified=answer.verification if answer else None,
            file=self._file_of(answer) if answer else None,
        )

    def _name_points(self, points: Sequence[Evaluation]) -> list[str]:
        model = self._problem.model

        def short_name(evaluation: Evaluation) -> str:
            model_of_point = self._search.space.model_of(evaluation.configuration)
            step = format_amount(self._problem.timestep_of(evaluation.configuration), "ms")
            return f"{read_option(model_of_point, INTEGRATOR)} {step}"

        short = [short_name(one) for one in points]
        names = list[str]()
        for name, one in zip(short, points, strict=True):
            own = changed_settings(one.configuration.settings, model)
            own.pop(INTEGRATOR, None)
            first = format_settings(dict(list(own.items())[:1]))
            names.append(f"{name}, {first}" if short.count(name) > 1 and first else name)
        return names

    def _time_points(self, points: Sequence[Evaluation]) -> None:
        fewest_runs = 8  # per point: two seeds, each twice there and twice back
        seconds = fewest_runs * self._problem.cost.pass_seconds
        seconds_left = PLAN.timing / PLAN.search * self._problem.work - seconds
        chosen = list[Evaluation]()
        current = self._verifier.current
        for one in sorted(points, key=lambda one: one.cost):
            if one.time_ratio is not None or one is current:
                continue
            seconds_left -= one.cost * seconds
            if seconds_left < 0:
                break
            chosen.append(one)
        if chosen and current.time_ratio is None:
            chosen.append(current)
        if chosen and self._time_limit.remaining > 0:
            self._time_closely(chosen)

    def _measure_uncertainty(self) -> Iterator[ParameterUncertainty]:
        reference, own = self._problem.reference, self._problem.own_model
        if self._target.unit != "1" or self._time_limit.remaining < 0:
            return
        same = reference.velocities_around(build_reference_model)
        rows = [row for row in list_rows() if row.kind == "unknown" and row.applies(own)]
        for row in rows:
            worst = max(
                (
                    reference.error_against(partial(_change_reference, change=change), same)
                    for change in row.changes
                ),
                key=lambda candidate_error: candidate_error.error,
            )
            yield ParameterUncertainty(name=row.name, error=worst.error, body=worst.body)

    @property
    def _own_integrator(self) -> str:
        return str(read_option(self._problem.own_model, INTEGRATOR))

    def _verify_goals(self) -> tuple[VerifiedCandidate | None, VerifiedCandidate | None]:
        """Return the recommended candidate, and the one of equal error if it is faster."""
        by_folder = {goal.folder: goal for goal in self._goals}
        verdicts = max(1, self._problem.max_verdicts // len(self._goals))
        best = self._verifier.verify_best(by_folder[FOLDER], verdicts)
        own = by_folder.get(EQUAL_ERROR_FOLDER)
        if own is None or (best and self._is_as_good(best.evaluation, own.bound)):
            return best, None
        return best, self._verifier.verify_best(own, verdicts)

    def _is_as_good(self, evaluation: Evaluation, bound: Bound) -> bool:
        """Return whether an evaluation costs no more than the best candidate of another bound."""
        other = next(iter(self._search.rank_candidates(bound)), None)
        return other is None or evaluation.cost <= other.cost / SAVING

    def _meets_target(self, evaluation: Evaluation) -> bool:
        if self._search.max_cost is not None:
            return self._search.max_cost >= 1
        return self._find_error(evaluation).error <= self._target.limit

    def _time_candidate(self, evaluation: Evaluation) -> None:
        self._time_closely([self._verifier.current, evaluation], fewest_seeds=4)

    def _time_closely(self, candidates: Sequence[Evaluation], fewest_seeds: int = 2) -> None:
        models = [
            (self._search.space.model_of(one.configuration), one.configuration.multiple)
            for one in candidates
        ]
        limit = self._time_limit
        timing_share = 0.3  # of the remaining time for timing a verified candidate
        least = (1 - timing_share) * limit.remaining
        prices = self._clock.time_whole_runs(
            models, self._timed_tasks(), lambda: limit.remaining > least, fewest_seeds
        )
        for one, price in zip(candidates, prices, strict=True):
            one.time_ratio = price

    def _timed_tasks(self) -> Iterator[Sequence[Motion]]:
        """Yield the task with seeds of the search and fresh ones, then repeatedly with others."""
        problem = self._problem
        task = with_new_seeds(problem.task)
        task = task.model_copy(update={"seeds": task.seeds[: problem.seeds]})
        pairs = zip(problem.motions, problem.examined.motions_of(task), strict=True)
        yield [join_seeds(*pair) for pair in pairs]
        seed_factor = 6  # seeds of the clock, in multiples of the search's seeds, if seeds differ
        for _ in range(seed_factor):
            task = with_new_seeds(task)
            yield problem.examined.motions_of(task)

    def _file_of(self, answer: VerifiedCandidate) -> str:
        return str(answer.model.path.relative_to(self._session.folder))

    def _describe_alternative(
        self, answer: VerifiedCandidate | None
    ) -> AlternativeCandidate | None:
        return answer and AlternativeCandidate(
            candidate=self._describe_candidate(answer.evaluation),
            changed_settings=tuple(self._changed_settings(answer.evaluation)),
            verified=answer.verification,
            file=self._file_of(answer),
        )

    def _report_far_pairs(self, answers: Sequence[Evaluation]) -> FarPairs | None:
        """Return the far pairs, and the time without them, for the first verified candidate."""
        is_requested, cost = "far-pairs" in self._request.apply, None
        problem = self._problem
        if not is_requested and self._time_limit.remaining < 0:
            return None
        sparser = problem.model_without_far_pairs()
        if sparser is None or (
            is_requested and not any("far-pairs" in one.configuration.reductions for one in answers)
        ):
            return None
        if not is_requested:
            choice = answers[0].configuration if answers else self._search.current
            before = self._search.space.model_of(choice)
            own, without = (
                problem.cost.count_cost(each, choice.multiple)
                for each in (before, choice.apply_to(sparser))
            )
            cost = without / own
        return FarPairs(
            distance=problem.far_distance,
            geoms=problem.far_pairs.masked,
            bodies=problem.far_pairs.excluded,
            removed=is_requested,
            cost=cost,
        )

    def _report_hulls(self, answers: Sequence[VerifiedCandidate]) -> SimplifiedHulls | None:
        if not any("hulls" in answer.evaluation.configuration.reductions for answer in answers):
            return None
        distance = self._request.apply["hulls"]
        assert distance is not None
        return SimplifiedHulls(max_distance=distance, meshes=dict(self._problem.hull_vertices))

    def _limiting_factor(self, nearest: Evaluation) -> str:
        """Return the body, time and row that keep the target from being met."""
        error = nearest.error
        assert error
        if self._search.max_cost is not None:
            return "no tested setting is fast enough"
        where = f"{error.body} at {error.time:.2f} s of {error.phase}"
        if self._time_limit.remaining < 0:
            return where
        row = "timestep"
        exact_model = self._search.space.model_of(nearest.configuration)
        exact_model.opt.iterations, exact_model.opt.tolerance = (
            max(100, exact_model.opt.iterations),
            1e-12,
        )
        exact_model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
        converged_error = self._search.estimator.estimate_error(
            exact_model, nearest.configuration.multiple
        )
        if converged_error.error < 0.5 * error.error:
            row = "solver"
        return f"{row} error of {where}"

    def _unconstrained_cost(self, *evaluations: Evaluation | None) -> float | None:
        """Count the model without constraints, unless a verified candidate saves 20 %."""
        large_saving = 0.8  # cost above which the unconstrained cost is reported
        saving = [one.cost < large_saving for one in evaluations if one]
        if any(saving) or self._search.max_cost is not None:
            return None
        bare = copy.copy(self._problem.model)
        bare.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        return self._problem.cost.count_cost(bare, self._search.current.multiple)

    def _changed_settings(self, chosen: Evaluation) -> Iterator[ChangedSetting]:
        model = self._problem.model
        for name, after in self._verifier.settings(chosen.configuration).items():
            before: object
            if name in FLAG_NAMES:
                before = read_flag(model, name)
            elif "[" in name:
                geom = name.partition("[")[2].removesuffix("]")
                before = int(model.geom(geom).condim[0])
            else:
                before = read_option(model, name)
            yield ChangedSetting(name=name, before=axis_cell(before), after=axis_cell(after))

    def _describe_candidate(self, evaluation: Evaluation) -> Candidate:
        price, choice = evaluation.time_ratio, evaluation.configuration
        error = self._find_error(evaluation)
        own = changed_settings(choice.settings, self._problem.model)
        settings: dict[str, Setting] = {name: axis_cell(value) for name, value in own.items()}
        return Candidate(
            settings=settings,
            timestep=self._problem.timestep_of(choice),
            exact=evaluation.exact,
            cost=evaluation.cost,
            removes_unused="unused" in choice.reductions,
            removes_far_pairs="far-pairs" in choice.reductions,
            simplifies_hulls="hulls" in choice.reductions,
            error=error.error,
            low=error.low,
            high=error.high,
            body=error.body,
            phase=error.phase,
            time=error.time,
            time_ratio=price,
        )


def _describe_error(error: ErrorEstimate) -> _ErrorFields:
    seeds = len(error.shares)
    ends = (error.low, error.high) if seeds != 1 else (math.inf, math.inf)  # one has no range
    low, high = (end if math.isfinite(end) else None for end in ends)
    return {"error": error.error, "error_low": low, "error_high": high, "error_seeds": seeds}


def _change_reference(model: mujoco.MjModel, change: ModelChange) -> mujoco.MjModel:
    reference_model = build_reference_model(model, 1)
    change(reference_model, model)
    return reference_model


def _join_endings(*endings: Ending) -> Ending:
    # Time comes first: it is the only end that another machine does not repeat.
    order: tuple[Ending, ...] = ("time", "work", "complete")
    return min(endings, key=order.index)
