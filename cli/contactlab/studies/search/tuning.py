"""The tune study: target, search, written model, and verification on fresh seeds."""

import copy
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from shutil import rmtree

import mujoco

from contactlab.budget import Motion
from contactlab.errors import ExpectationError
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_edits import FLAG_NAMES, read_flag, read_option
from contactlab.scene.mujoco_versions import VERSION
from contactlab.schema.evidence import Setting
from contactlab.schema.time_ratio import TimeRatio
from contactlab.schema.tune_report import (
    EQUAL_ERROR_FOLDER,
    FOLDER,
    REPORT,
    TARGET_FOLDER,
    AlternativeCandidate,
    Candidate,
    ChangedSetting,
    FarPairs,
    PatchedLine,
    SimplifiedHulls,
    SkippedSetting,
    Target,
    TargetKind,
    TuneReport,
)
from contactlab.store.table_layout import axis_cell
from contactlab.studies.examine.examination import ExamineRequest, open_model
from contactlab.studies.examine.fixes import with_new_seeds
from contactlab.studies.search.clock import Clock
from contactlab.studies.search.configuration import changed_settings
from contactlab.studies.search.forward_error import Divergence, join_phases, measure_divergence
from contactlab.studies.search.report_text import finite_or_none, sentence_of
from contactlab.studies.search.search_space import find_integrators, find_parameters, may_sleep
from contactlab.studies.search.settings_search import (
    MIN_SPEEDUP_RATIO,
    Bound,
    Evaluation,
    Search,
    SearchSpace,
)
from contactlab.studies.search.stress_motions import join_seeds
from contactlab.studies.search.time_limit import TimeLimit
from contactlab.studies.search.tune_request import TuneRequest, refuse_contradictions
from contactlab.studies.search.tuning_problem import (
    OFFERED_DISTANCE,
    SEARCH_TIME_SHARE,
    TuningProblem,
)
from contactlab.studies.search.verification import CandidateVerifier, Goal, VerifiedCandidate
from contactlab.studies.session import Session

_MAX_STEP = 0.04  # s: the length of a window
_TIMING_SHARE = 0.3  # share of the remaining time for timing a verified candidate
_MIN_SEARCH_SHARE = (
    0.3  # least share of the remaining time for the search, if a verdict may take the rest
)
_LEAST_SEARCH_SHARE = 0.1  # share of it in any case
_COMPARISON_TURNS = 5
_TIMING_SEED_FACTOR = 6  # seeds of the clock, in multiples of the search's seeds, if seeds differ
_LARGE_SAVING_RATIO = 0.8  # ratio of times above which the unconstrained cost is reported


def tune_model(request: TuneRequest, session: Session, begin: float | None = None) -> TuneReport:
    """Search for settings that meet a target, write the model with them, and verify it.

    The folder receives `tune.json`, and the model if something is recommended. The time limit
    began at `begin` on the clock of `time.monotonic`, by default now.

    Raises:
        SceneError: there is no such model, it does not compile, or an observed name is unknown.
        SweepFileError: the tolerance is not a share, or options contradict each other.
        EngineError: nothing moves, or MuJoCo is not the engine.
        ExpectationError: a forward error is requested for a chaotic motion.
        OutputError: the folder cannot be written, or has another model's results.
    """
    allowed = TimeLimit(time.monotonic() if begin is None else begin, request.max_time)
    refuse_contradictions(request)
    session = replace(session, folder=session.folder.resolve())
    examined = open_model(
        ExamineRequest(request.model, task=request.task, sections=("budget",)), session
    )
    session.claim("tune", request.model)
    session.notify(f"tuning {request.model}: {examined.task.line}")
    problem = TuningProblem(request, examined, max(1, session.workers), allowed)
    report = TuningStudy(request, session, problem, allowed).run_study()
    session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


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
        self._time_limit = allowed
        self._divergence: Divergence | None = None
        self._target = self._find_target()
        self._clock = Clock(problem.reference, problem.model)
        motions = problem.motions
        levers, kept = find_parameters(problem.own_model, motions)
        self._skipped = [*problem.skipped, *kept]
        space = SearchSpace(
            problem.models,
            problem.start,
            problem.reference.substeps,
            max(problem.reference.substeps, round(_MAX_STEP / problem.reference.step)),
            levers,
            find_integrators(problem.own_model),
            problem.simplified,
            may_sleep=may_sleep(problem.own_model),
        )
        measure = problem.error_estimator(problem.reference, motions)
        search = Search(space, measure, self._clock, (), self._max_time_ratio(), math.inf)
        known = Evaluation(
            search.current, measure.estimate_error(problem.model, search.current.multiple)
        )
        self._goals = self._find_goals(known)
        search.evaluations[search.current.key] = known
        search.bounds = tuple(goal.bound for goal in self._goals)
        self._search = search
        self._verifier = CandidateVerifier(request, session, problem, search, self._target, allowed)

    def _find_target(self) -> Target:
        request, problem, unit = self._request, self._problem, "1"
        kind: TargetKind = "uncertainty" if request.error is None else "error"
        if request.real_time is not None:
            kind = "real time"
        if request.error_at is not None:
            kind = "forward error"
            self._divergence = measure_divergence(join_phases(problem.motions), problem.threads)
            if self._divergence.chaotic:
                raise ExpectationError(
                    f"{request.model}: a forward error is not available, since the motion is "
                    f"{self._divergence.sentence}. Remove --error-at to use the error budget"
                )
            unit = problem.observed[0].unit
        uncertain = problem.model_uncertainty
        by = "" if uncertain is None else f"{uncertain.body}, {uncertain.phase}"
        return Target(
            kind=kind,
            limit=problem.limit,
            unit=unit,
            tolerance=problem.examined.task.tolerance,
            model_uncertainty=uncertain.error if uncertain else None,
            uncertainty_source=by,
            real_time=request.real_time,
            observed=tuple(request.observed) if request.error_at else (),
            error_at=request.error_at,
            divergence=self._divergence.sentence if self._divergence else "",
        )

    def _max_time_ratio(self) -> float | None:
        if self._request.real_time is None:
            return None
        return 1 / (self._request.real_time * self._clock.base_seconds)

    def _find_goals(self, known: Evaluation) -> list[Goal]:
        """Return the goals in the order of the search.

        If the model as written meets the target: the fastest that meets it. Otherwise also the
        fastest with no larger error, which costs no more than the model as written; and if that is
        above the tolerance, the fastest within the tolerance.
        """
        assert known.error
        aim, now = Bound.of(self._target.limit), known.error.error
        if now <= aim.limit or self._request.real_time is not None:
            return [Goal(aim.or_as_current(now), FOLDER)]
        as_current = Bound.as_current(now)
        if self._target.kind != "uncertainty":
            return [Goal(as_current, EQUAL_ERROR_FOLDER, must_be_sound=False), Goal(aim, FOLDER)]
        within = Bound.of(self._target.tolerance)
        if now <= within.limit:
            return [Goal(as_current, FOLDER), Goal(aim, TARGET_FOLDER)]
        found = [Goal(as_current, EQUAL_ERROR_FOLDER, must_be_sound=False), Goal(within, FOLDER)]
        return [*found, Goal(aim, TARGET_FOLDER)] if aim.limit < within.limit else found

    def run_study(self) -> TuneReport:
        """Search, write and verify candidates, and return the report."""
        search, verifier = self._search, self._verifier
        verifier.judge_current()
        search.deadline = self._end_of_search()
        search.run_search()
        known = verifier.current
        if known.error is None or known.time_ratio is None:
            raise ExpectationError(
                f"{self._request.model}: {self._request.max_time:g} s are too short to measure the "
                "model as written; allow more with --max-time"
            )
        for folder in (FOLDER, EQUAL_ERROR_FOLDER, TARGET_FOLDER):
            rmtree(self._session.folder / folder, ignore_errors=True)
        best, as_current, to_aim = self._verify_goals()
        keeps = best is not None and best.verification.meets_target
        met = keeps or to_aim is not None or self._meets_target(known)
        nearest = None if met else search.closest_to(self._target.limit, verifier.rejected)
        made = [answer for answer in (best, to_aim, as_current) if answer]
        used = any("unused" in answer.evaluation.configuration.reductions for answer in made)
        edits = self._problem.unused if used else ModelEdits()
        report = TuneReport(
            model=self._request.model,
            scene_hash=self._problem.examined.scene.hash,
            mujoco=VERSION,
            task=self._problem.examined.task,
            target=self._target,
            sentence="",
            target_met=met,
            current=self._candidate(known),
            current_verdict=verifier.current_verdict(),
            recommended=self._candidate(best.evaluation) if best else None,
            meets_target=self._alternative(to_aim),
            far_pairs=self._report_far_pairs([answer.evaluation for answer in made]),
            simplified_hulls=self._report_hulls(made),
            closest=self._candidate(nearest) if nearest else None,
            limiting_factor=self._limiting_factor(nearest) if nearest else "",
            unconstrained_cost=self._unconstrained_cost(
                best.evaluation if best else None, as_current.evaluation if as_current else None
            ),
            equal_error=self._alternative(as_current),
            real_time=1 / self._clock.base_seconds,
            reference_step=self._problem.reference.step,
            candidates=tuple(
                self._candidate(one) for one in search.evaluations.values() if one.error
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
            lines=tuple(PatchedLine(**vars(change)) for change in best.written.changes)
            if best
            else (),
            timed_out=search.timed_out,
            seconds=time.monotonic() - self._time_limit.begin,
        )
        return report.model_copy(update={"sentence": sentence_of(report)})

    def _end_of_search(self) -> float:
        """Return when the search ends, on the clock of `time.monotonic`; verdicts follow."""
        allowed, one = self._time_limit, self._verifier.current_verification_time
        left, own = allowed.remaining, allowed.begin + SEARCH_TIME_SHARE * allowed.seconds
        least = max(min(_MIN_SEARCH_SHARE * left, left - one), _LEAST_SEARCH_SHARE * left)
        return min(own, time.monotonic() + max(least, left - len(self._goals) * one))

    def _verify_goals(
        self,
    ) -> tuple[VerifiedCandidate | None, VerifiedCandidate | None, VerifiedCandidate | None]:
        """Return the candidates: recommended, of equal error, and meeting the target."""
        by_folder = {goal.folder: goal for goal in self._goals}
        best = self._verify_goal(by_folder[FOLDER], len(self._goals) - 1)
        as_current = to_aim = None
        own = by_folder.get(EQUAL_ERROR_FOLDER)
        late = self._time_limit.remaining < self._verifier.current_verification_time
        if own is None and best is None and not late and not self._verifier.is_current_sound:
            own = Goal(by_folder[FOLDER].bound, EQUAL_ERROR_FOLDER, must_be_sound=False)
        aim = None if best and best.verification.meets_target else by_folder.get(TARGET_FOLDER)
        if own and not (best and self._is_as_good(best.evaluation, own.bound)):
            as_current = self._verify_goal(own, later=1 if aim else 0)
        if aim:
            to_aim = self._verify_goal(aim)
        return best, as_current, to_aim

    def _verify_goal(self, goal: Goal, later: int = 0) -> VerifiedCandidate | None:
        """Return the best verified and timed candidate, or None if it is not better.

        `later` other goals follow.
        """
        found = self._verifier.verify_best(goal, later)
        if found:
            self._time_closely(found.evaluation)
            if not self._verifier.is_better(found.evaluation, goal.bound):
                self._verifier.drop_candidate(goal)
                return None
        return found

    def _is_as_good(self, tried: Evaluation, bound: Bound) -> bool:
        """Return whether an evaluation takes no longer than the best candidate of another bound."""
        other = next(iter(self._search.rank_candidates(bound)), None)
        assert tried.time_ratio
        return other is None or (
            other.time_ratio is not None
            and tried.time_ratio.ratio <= other.time_ratio.ratio / MIN_SPEEDUP_RATIO
        )

    def _meets_target(self, known: Evaluation) -> bool:
        assert known.error
        if self._search.max_time_ratio is not None:
            return self._search.max_time_ratio >= 1
        return known.error.error <= self._target.limit

    def _time_closely(self, tried: Evaluation) -> None:
        """Time a candidate and the model as written on whole runs."""
        both = [self._verifier.current, tried]
        models = [
            (self._search.space.model_of(one.configuration), one.configuration.multiple)
            for one in both
        ]
        until = time.monotonic() + _TIMING_SHARE * self._time_limit.remaining
        prices = self._clock.time_whole_runs(models, self._timed_tasks(), until)
        for one, price in zip(both, prices, strict=True):
            one.time_ratio = price

    def _timed_tasks(self) -> Iterator[Sequence[Motion]]:
        """Yield the task with seeds of the search and fresh ones, then repeatedly with others."""
        own, unseen = self._problem.motions, self._verifier.motions
        yield [join_seeds(*pair) for pair in zip(own, unseen, strict=True)]
        task = self._verifier.task
        for _ in range(_TIMING_SEED_FACTOR):
            task = with_new_seeds(task)
            yield self._problem.examined.motions_of(task)

    def _file_of(self, answer: VerifiedCandidate) -> str:
        return str(answer.written.path.relative_to(self._session.folder))

    def _alternative(self, answer: VerifiedCandidate | None) -> AlternativeCandidate | None:
        return answer and AlternativeCandidate(
            candidate=self._candidate(answer.evaluation),
            changed_settings=tuple(self._changed_settings(answer.evaluation)),
            verified=answer.verification,
            file=self._file_of(answer),
        )

    def _report_far_pairs(self, made: Sequence[Evaluation]) -> FarPairs | None:
        """Return the far pairs, and the time without them, for the first verified candidate."""
        asked, price = self._request.skip_pairs_beyond is not None, None
        problem = self._problem
        if not asked and self._time_limit.remaining < 0:
            return None
        sparser = problem.model_without_far_pairs()
        if sparser is None or (
            asked and not any("apart" in one.configuration.reductions for one in made)
        ):
            return None
        if not asked:
            choice = made[0].configuration if made else self._search.current
            before = self._search.space.model_of(choice)
            own, without = self._clock.time_ratios(
                [(each, choice.multiple) for each in (before, choice.apply_to(sparser))],
                _COMPARISON_TURNS,
            )
            price = without.scaled(1 / own.ratio)
        return FarPairs(
            distance=self._request.skip_pairs_beyond or OFFERED_DISTANCE,
            geoms=problem.far_pairs.masked,
            bodies=problem.far_pairs.excluded,
            removed=asked,
            time_ratio=price,
        )

    def _report_hulls(self, made: Sequence[VerifiedCandidate]) -> SimplifiedHulls | None:
        if not any("hulls" in answer.evaluation.configuration.reductions for answer in made):
            return None
        assert self._request.simplify_hulls is not None
        return SimplifiedHulls(
            max_distance=self._request.simplify_hulls, meshes=dict(self._problem.hull_vertices)
        )

    def _limiting_factor(self, nearest: Evaluation) -> str:
        """Return the body, time and row that keep the target from being met."""
        error = nearest.error
        assert error
        if self._search.max_time_ratio is not None:
            return "no tested setting is fast enough"
        where = f"{error.body} at {error.time:.2f} s of {error.phase}"
        if self._time_limit.remaining < 0:
            return where
        row = "timestep"
        made = self._search.space.model_of(nearest.configuration)
        made.opt.iterations, made.opt.tolerance = max(100, made.opt.iterations), 1e-12
        made.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
        done = self._search.estimator.estimate_error(made, nearest.configuration.multiple)
        if done.error < 0.5 * error.error:
            row = "solver"
        return f"{row} error of {where}"

    def _unconstrained_cost(self, *made: Evaluation | None) -> TimeRatio | None:
        """Time the model without constraints, unless a verified candidate saves 20 %."""
        saving = [
            one.time_ratio and one.time_ratio.ratio < _LARGE_SAVING_RATIO for one in made if one
        ]
        if any(saving) or self._search.max_time_ratio is not None or self._time_limit.remaining < 0:
            return None
        now = self._search.current
        own = self._search.space.model_of(now)
        bare = copy.copy(own)
        bare.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        return self._clock.compare_segments(
            (bare, now.multiple), (own, now.multiple), _COMPARISON_TURNS
        )

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

    def _candidate(self, tried: Evaluation) -> Candidate:
        error, price, choice = tried.error, tried.time_ratio, tried.configuration
        assert error
        own = changed_settings(choice.settings, self._problem.model)
        settings: dict[str, Setting] = {name: axis_cell(value) for name, value in own.items()}
        return Candidate(
            settings=settings,
            timestep=float(f"{choice.multiple * self._problem.reference.step:.12g}"),
            removes_unused="unused" in choice.reductions,
            removes_far_pairs="apart" in choice.reductions,
            simplifies_hulls="hulls" in choice.reductions,
            error=finite_or_none(error.error),
            low=finite_or_none(error.low),
            high=finite_or_none(error.high),
            body=error.body,
            phase=error.phase,
            time=finite_or_none(error.time),
            time_ratio=price,
        )
