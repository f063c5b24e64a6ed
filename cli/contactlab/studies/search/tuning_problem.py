"""The model to tune: its motions, its reference, and the parts that can be removed."""

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np

from contactlab.budget import ErrorBudget, Motion, Verdict, error_budget, judge
from contactlab.budget.counted_time import count_pace
from contactlab.budget.measuring import WINDOW, count_evaluations
from contactlab.budget.restarts import build_reference_model
from contactlab.errors import EngineError, SceneError
from contactlab.modifications.catalogue import list_reductions
from contactlab.modifications.unused_pairs import (
    exclusion_edits,
    own_sensors,
    pairs_within,
    unreachable_edits,
    unused_flags,
    with_flags,
)
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_edits import read_option, set_timestep
from contactlab.scene.scene import Scene
from contactlab.scene.unreachable import GeomPair, filtered_pairs
from contactlab.schema.task import Task
from contactlab.studies.examine.judged_model import judge_as_examined
from contactlab.studies.search.configuration import (
    AS_WRITTEN,
    INTEGRATOR,
    Configuration,
    Reductions,
)
from contactlab.studies.search.forward_error import ForwardError, ObservedOutput
from contactlab.studies.search.search_space import SkippedParameter, find_integrators
from contactlab.studies.search.settings_search import ErrorEstimator, find_usable_steps
from contactlab.studies.search.simplified_hulls import (
    colliding_meshes,
    fewest_vertices,
    hull_vertices,
)
from contactlab.studies.search.sleep_error import SleepAwareError
from contactlab.studies.search.tune_request import TuneRequest
from contactlab.studies.verification.grip_measures import needs_masks
from contactlab.studies.verification.panel import ERROR_FLOOR, OriginalRuns
from contactlab.studies.verification.panel_cost import (
    PanelCost,
    estimate_panel,
    fewest_windows_share,
    fit_panel,
)
from contactlab.tasks.checked_model import CheckedModel
from contactlab.tasks.compiled_changes import compile_changed
from contactlab.tasks.counted_cost import CountedCost
from contactlab.tasks.reference_error import ErrorEstimate, TaskReference
from contactlab.tasks.stress_motions import KnownStates, double_inputs, tilt_gravity
from contactlab.tasks.task_motions import shorten_task, with_new_seeds
from contactlab.tasks.time_limit import TimeLimit

LIMITED = ("reference", "seeds", "windows", "length", "verification")
"""Names of report entries on the effects of the time limit."""
_RK4 = "RK4"
_UNUSED: Reductions = frozenset({"unused"})
_SPARSER: Reductions = frozenset({"unused", "far-pairs"})


@dataclass(frozen=True)
class WorkPlan:
    """The division of the counted work of a study, which never looks at a clock.

    Attributes:
        whole: share of the time limit, in counted time of one core. The rest is for Python, and
            for machines that are slower than the one that the counts were fitted on.
        search: share of that for the search for a target.
        front: for the ladders of steps of the front.
        points: for errors of its points on fresh seeds.
        timing: for times of its points.
    """

    whole: float = 0.5
    search: float = 0.2
    front: float = 0.16
    points: float = 0.3
    timing: float = 0.06

    @property
    def verification(self) -> float:
        """Share for verification: the rest."""
        return 1 - self.search - self.front - self.points - self.timing

    @property
    def searched(self) -> float:
        """Share of the time limit until the search ends, if time ends it."""
        return self.search + self.front


PLAN = WorkPlan()


@dataclass(frozen=True)
class ScaledError:
    """Scales the errors of an estimator.

    Attributes:
        estimator: of errors from the states of one reference, which rank candidates.
        scale: numerical error of the model as written, over its error there.
    """

    estimator: ErrorEstimator
    scale: float

    def estimate_error(self, model: mujoco.MjModel, multiple: int) -> ErrorEstimate:
        """Return the scaled error."""
        return self.estimator.estimate_error(model, multiple).times_factor(self.scale)


@dataclass(frozen=True)
class SearchRules:
    """Shares of the work of a search, and sizes of its references and runs.

    Attributes:
        first_verification_share: of the work of verification, for the first candidate; the rest is
            for those that follow if it fails.
        rejected_share: of a verification's time until the first worse measure rejects a candidate.
        reference_share, most_seed_share: of the search's work, for references of all seeds, and of
            one.
        count_share: of the search's work, for counting costs.
        substeps: of references.
        front_substeps: that show steps down to a quarter of the own one, if work allows.
        smooth_substeps: most substeps of an RK4 reference.
        smooth_gain: of RK4 in accuracy at the own step at least, since it makes four times the
            work.
        reference_error_share: of the limit that the reference's own error may have.
        search_passes: approximate simulations of the task per search.
        fewest_passes: below, runs are shortened: exact savings, the solver, and a few steps.
        fresh_passes: simulations of the task per seed, for references and errors on fresh seeds.
        fresh_share: of the work of verification, for errors on fresh seeds, estimated and measured.
        most_fresh_seeds: a mean over them is known to a third of the spread of seeds.
        window_stride: at least one in this many windows is used if there are several seeds.
        most_window_stride: at least one in this many windows is used of one seed.
    """

    first_verification_share: float = 0.8
    rejected_share: float = 0.5
    reference_share: float = 0.3
    most_seed_share: float = 0.4
    count_share: float = 0.3
    substeps: tuple[int, ...] = (2, 4, 5, 8, 10, 16, 20)
    front_substeps: int = 8
    smooth_substeps: int = 10
    smooth_gain: int = 4
    reference_error_share: float = 0.2
    search_passes: int = 80
    fewest_passes: int = 30
    fresh_passes: int = 16
    fresh_share: float = 0.1
    most_fresh_seeds: int = 12
    window_stride: int = 4
    most_window_stride: int = 8


_RULES = SearchRules()


class TuningProblem:
    """The model to tune.

    Attributes:
        motions: phases of the task, with as many seeds as the work allows.
        model: the model compiled from its files, without recording.
        cost: counts the work of models.
        original_runs: runs of the model as written that verifications compare with.
        work: counted time that the search may take [s].
        judged: the model with the task, seeds and settings of its examination.
        current_error: the numerical error of the model as written, as its examination prints it.
        task: the model's task, shortened if the model is very slow.
        length_share: share of the length of the runs of the search.
        verified_task: the model's task in verifications, shortened if the model is slow.
        verified_share: share of the length of the runs of verifications.
        verified_seeds: seeds of the comparison with the model as written.
        max_verdicts: candidates that may be verified.
        reference: the reference that errors are measured from.
        reference_integrator: integrator of the reference; None for that of the model.
        steps: usable timesteps, in fine steps.
        models: compiled models by reductions.
        skipped: settings that are not tried, and why.
        hull_vertices: largest numbers of hull vertices within the requested distance, by mesh.
    """

    def __init__(
        self, request: TuneRequest, examined: CheckedModel, threads: int, allowed: TimeLimit
    ) -> None:
        """Count the work, and run the reference; find the unused parts."""
        self._request, self.examined, self.threads = request, examined, threads
        self._time_limit = allowed
        self.original_runs = OriginalRuns()
        self.task = examined.task
        if request.error_at is not None:
            self.task = self.task.model_copy(update={"observed": ()})
        self.motions = examined.motions_of(self.task)
        self.model = compile_changed(self.examined, ModelEdits())
        self.skipped = list[SkippedParameter]()
        self.judged = judge_as_examined(examined)
        self.current_error = ErrorEstimate.of_budget(self.judged.budget)
        self.work = PLAN.search * PLAN.whole * self._searched_seconds
        one = [first_seeds(motion, 1) for motion in self.motions]
        self.cost = CountedCost(one, self.model, threads)
        self._window_stride = self._plan_windows()
        self.verified_seeds, self.verified_share = self._plan_verification()
        self.verified_task = shorten_task(self.task, self.verified_share)
        self.max_verdicts = self._plan_verdicts()
        self.length_share = self._plan_length()
        self._shorten_motions()
        self.reference_integrator: str | None = None
        self.reference = self._converged_reference()
        self.verified_seeds = min(self.seeds, self.verified_seeds)
        self._note_verification()
        self.cost.fine_step = self.reference.step
        self.steps = self._usable_steps(self.reference.substeps)
        self.models: dict[Reductions, mujoco.MjModel] = {}
        self.unused = self._find_unused()
        self.models[AS_WRITTEN] = self.model
        self.start: Reductions = _UNUSED if _UNUSED in self.models else AS_WRITTEN
        if "far-pairs" in request.apply and self.model_without_far_pairs() is not None:
            self.start = _SPARSER
        self.hull_vertices: Mapping[str, int] = {}
        self.simplified = self._simplify_hulls()

    @property
    def own_model(self) -> mujoco.MjModel:
        """The model as it moves in the task."""
        return self.motions[0].model

    @property
    def seeds(self) -> int:
        """Number of seeds of the search."""
        return self.motions[0].seeds

    @property
    def observed_outputs(self) -> list[ObservedOutput]:
        """Outputs of the forward error."""
        return [ObservedOutput.find(self.model, name) for name in self._request.observed]

    def timestep_of(self, choice: Configuration) -> float:
        """Return the timestep of a configuration [s], in as few digits as a person would write."""
        exact = choice.multiple * self.reference.step
        most_digits, equal_ratio = 6, 1e-7  # fewer digits that differ by less are the same
        for digits in range(1, most_digits):
            rounded = float(f"{exact:.{digits}g}")
            if math.isclose(rounded, exact, rel_tol=equal_ratio):
                return rounded
        return float(f"{exact:.{most_digits}g}")

    def error_estimator(
        self, reference: TaskReference, motions: Sequence[Motion]
    ) -> ErrorEstimator:
        """Return the estimator of errors against the model as written, for motions."""
        if self._request.error_at is None:
            scaled = ScaledError(reference, self._scale)
            return SleepAwareError(scaled, motions, self.reference.substeps, self.threads)
        finer, at = self.reference.substeps, self._request.error_at
        return ForwardError(motions, finer, self.observed_outputs, at, self.threads)

    @cached_property
    def _scale(self) -> float:
        # It gives the model as written its numerical error.
        found = self.reference.estimate_error(self.model, self.reference.substeps).error
        own = self.current_error.error
        usable = math.isfinite(own) and math.isfinite(found)
        return max(own, ERROR_FLOOR) / max(found, ERROR_FLOOR) if usable else 1.0

    @property
    def _searched_seconds(self) -> float:
        # The numerical errors of the model as written and of the recommended one come first.
        seconds, least_share = self._request.max_cpu, 0.5
        errors = 2 * len(self.judged.task.seeds) * self._count_error_seconds(energy=True)
        return max(least_share * seconds, seconds - errors)

    @cached_property
    def measuring_seconds(self) -> float:
        """Counted time of an error with the work of the model as written, on one seed [s]."""
        return self._count_error_seconds(energy=False)

    def _count_error_seconds(self, *, energy: bool) -> float:
        motions, settings = self.judged.motions, self.judged.budget_settings
        settings = replace(settings, energy=energy and settings.energy)
        steps = sum(motion.steps for motion in motions)
        return count_evaluations(motions[0].model, settings) * steps * count_pace(motions)

    def measure_error(
        self, model: mujoco.MjModel, timestep: float, seeds: Sequence[int] | None = None
    ) -> ErrorEstimate:
        """Return the numerical error of a candidate, on the seeds of its task or on others.

        It is that of `contactlab MODEL`, with references of the model as written.
        """
        judged = self.judged

        def replace_model(own: mujoco.MjModel) -> mujoco.MjModel:
            changed = self.as_run(model, own)
            set_timestep(changed, timestep)
            return changed

        task = judged.task.model_copy(update={"seeds": tuple(seeds or judged.task.seeds)})
        motions = judged.motions_of(task, {**judged.values, "timestep": timestep}, replace_model)
        return ErrorEstimate.of_budget(self._measure_budget(motions, from_original=True))

    def judge_written(self, written: CheckedModel) -> tuple[ErrorEstimate, Verdict]:
        """Return the numerical error of a written candidate, and its verdict on numerics.

        If it changes a modeling choice, the effect of that is a part of the error. The range over
        seeds includes fresh ones if the work allows.
        """
        task = self.judged.task
        motions = written.motions_of(task)
        is_same = _has_same_reference(motions[0].model, self.judged.motions[0].model)
        budget = self._measure_budget(motions)
        error = ErrorEstimate.of_budget(budget)
        if not is_same:
            changed = self._measure_budget(motions, from_original=True)
            error = max(error, ErrorEstimate.of_budget(changed), key=lambda one: one.error)
        seconds = len(task.seeds) * self.measuring_seconds
        if seconds <= _RULES.fresh_share * self._verification_work:
            fresh_motions = written.motions_of(with_new_seeds(task))
            fresh = self._measure_budget(fresh_motions, from_original=not is_same)
            error = error.widened_by(ErrorEstimate.of_budget(fresh))
        return error, judge(budget, task.tolerance)

    def _measure_budget(
        self, motions: Sequence[Motion], *, from_original: bool = False
    ) -> ErrorBudget:
        settings = self.judged.budget_settings
        if from_original:
            settings = replace(settings, energy=False)
        original = self.judged.motions[0].model if from_original else None
        return error_budget(
            motions,
            rows=(),
            settings=replace(settings, places=False, excess=False),
            workers=self.threads,
            original=original,
        )

    @cached_property
    def fresh_task(self) -> Task:
        """The verified task with fresh seeds: more than the search has, if the work allows.

        The best of many candidates has a small error partly by chance, which few seeds repeat.
        """
        task = with_new_seeds(self.verified_task)
        first, count = task.seeds[0], self.seeds
        if self._request.error_at is None:  # the largest of all seeds grows with their number
            work = _RULES.fresh_share * self._verification_work
            each = _RULES.fresh_passes * self.verified_share * self.cost.pass_seconds
            count = max(count, min(_RULES.most_fresh_seeds, int(work / each)))
        return task.model_copy(update={"seeds": tuple(range(first, first + count))})

    @cached_property
    def fresh_motions(self) -> list[Motion]:
        """The motions of the task with fresh seeds."""
        return self.examined.motions_of(self.fresh_task)

    @cached_property
    def fresh_reference(self) -> TaskReference:
        """The reference of the motions with fresh seeds."""
        own = self.reference
        return self.run_reference(self.fresh_motions, own.substeps, self.reference_integrator)

    @cached_property
    def fresh_estimator(self) -> ErrorEstimator:
        """The estimator of errors on fresh seeds."""
        return self.error_estimator(self.fresh_reference, self.fresh_motions)

    @cached_property
    def fresh_error(self) -> ErrorEstimate:
        """Error of the model as written on fresh seeds."""
        return self.fresh_estimator.estimate_error(self.model, self.reference.substeps)

    def _plan_windows(self) -> int:
        takes, allowed = self.cost.pass_seconds, self._trial_work / _RULES.search_passes
        seeds = min(self.seeds, max(1, int(_RULES.window_stride * allowed / takes)))
        self.motions = [first_seeds(motion, seeds) for motion in self.motions]
        return min(_RULES.most_window_stride, max(1, math.ceil(seeds * takes / allowed)))

    def _plan_verification(self) -> tuple[int, float]:
        """Return the seeds of the verification, and the share of the length of its runs.

        Both fit into the counted work. Seeds are reduced first.
        """
        if self._request.error_at is not None:
            return self.seeds, 1.0
        allowed = _RULES.first_verification_share * self._verification_work

        def estimate_seconds(seeds: int, share: float) -> float:
            return self._estimate_panel(seeds, share).first

        seeds, share = fit_panel(estimate_seconds, self.seeds, allowed)
        return seeds, max(fewest_windows_share(self.task), min(1.0, share))

    def _plan_length(self) -> float:
        if self._request.error_at is not None:
            return 1.0
        passes = self.search_passes / _RULES.fewest_passes
        return max(fewest_windows_share(self.task), min(1.0, passes))

    def _plan_verdicts(self) -> int:
        """Return how many candidates may be verified within the counted work."""
        cost = self._estimate_panel(self.verified_seeds, self.verified_share)
        work_left = self._verification_work - cost.first
        return 2 + max(0, int(work_left / (_RULES.rejected_share * cost.next)))

    @property
    def _verification_work(self) -> float:
        return self.work * PLAN.verification / PLAN.search

    def _estimate_panel(self, seeds: int, share: float) -> PanelCost:
        panel_cost = estimate_panel(self.own_model, self.task, seeds, share, self.cost.step_seconds)
        fresh = _RULES.fresh_passes * share * self.seeds * self.cost.pass_seconds
        return replace(panel_cost, first=panel_cost.first + fresh)

    def _shorten_motions(self) -> None:
        # Only slow models have shorter runs. The work is counted from the remaining runs.
        seeds, share = self.seeds, self.length_share
        if share < 1:
            whole, self.task = self.task.duration, shorten_task(self.task, share)
            self.motions = [
                first_seeds(motion, seeds) for motion in self.examined.motions_of(self.task)
            ]
            reason = f"runs of {share * whole:.2g} of {whole:g} s; --max-cpu allows no more"
            self._skip_part("length", reason)
        allowed = _RULES.count_share * self.work / _RULES.search_passes
        samples = int(allowed / (self.cost.sample_seconds * len(self.motions)))
        self.cost = CountedCost(self.motions, self.model, self.threads, samples)

    def _note_verification(self) -> None:
        whole, reasons = self.examined.task, list[str]()
        if self.verified_seeds < len(whole.seeds):
            reasons.append(f"{self.verified_seeds} of {len(whole.seeds)} seeds")
        length, full_length = f"{self.verified_task.duration:.2g}", f"{whole.duration:.2g}"
        if length != full_length:
            reasons.append(f"{length} of {full_length} s")
        if reasons:
            reason = f"it compared {' and '.join(reasons)}; --max-cpu allows no more"
            self._skip_part("verification", reason)

    @property
    def search_passes(self) -> float:
        """Error estimates of the model as written that the work allows."""
        return self._trial_work / self.trial_seconds

    @property
    def trial_seconds(self) -> float:
        """Counted time of one such estimate [s]."""
        return self.cost.pass_seconds * self.seeds / self._window_stride

    @property
    def sleep_work(self) -> float:
        """Work of an error with sleep, of whole runs with their references, over that without."""
        return float(self.reference.substeps * self._window_stride)

    @property
    def _trial_work(self) -> float:
        return (1 - _RULES.reference_share - _RULES.count_share) * self.work

    def _usable_steps(self, substeps: int) -> tuple[int, ...]:
        own = float(self.own_model.opt.timestep)
        period = control_period(self.examined.scene)
        longest = max(own, WINDOW)  # a step of a window at most
        usable = find_usable_steps(own, own / substeps, longest, period)
        # Errors of the step of the reference itself cannot be measured.
        return tuple(step for step in usable if step >= min(substeps, 2))

    def _converged_reference(self) -> TaskReference:
        coarse = self.run_reference(self.motions, 1)
        if not coarse.is_complete:
            finest = self.run_reference(self.motions, 8)
            if not finest.is_complete:
                raise EngineError(
                    f"{self._request.model}: MuJoCo gives up even at an eighth of the timestep; "
                    f"see contactlab {self._request.model}"
                )
            return finest
        # In first order, one step differs from two as much as from the exact motion.
        own = coarse.uncorrected_error(self.own_model, 2).error
        finer = self._needed_substeps(own)
        if (smooth := self._smooth_reference(own, finer)) is not None:
            return smooth
        fine = self.run_reference(self.motions, finer)
        return fine if fine.is_complete else coarse

    def run_reference(
        self, motions: Sequence[Motion], substeps: int, integrator: str | None = None
    ) -> TaskReference:
        """Run references of motions, in as many windows as the work allows.

        Shorter motions have as many windows, at least one in as many as those of the search.
        """
        shorter = motions[0].steps / self.motions[0].steps
        stride = max(1, round(min(1.0, shorter) * self._window_stride))
        return TaskReference.run_references(motions, substeps, self.threads, stride, integrator)

    def _smooth_reference(self, own: float, finer: int) -> TaskReference | None:
        """Return a reference of RK4 if its motion is nearer to that of fine steps, or None.

        Its error is at most the difference to twice its step. `own` is the same difference of the
        model's own integrator at its own step, and `finer` the substeps that it needs.
        """
        model = Configuration({INTEGRATOR: _RK4}).apply_to(self.own_model)
        own_integrator = read_option(self.own_model, INTEGRATOR)
        if self._request.error_at is not None or own_integrator == _RK4:
            return None
        if _RK4 not in find_integrators(self.own_model):
            return None
        # RK4 makes four times the work, and half as much for the comparison with twice the step.
        passes = self.work / self.cost.pass_seconds / self.seeds
        allowed = _RULES.reference_share * passes / 6
        rates = [rate for rate in _RULES.substeps if rate <= min(allowed, _RULES.smooth_substeps)]
        if not rates:
            return None
        rate = max(rates, key=lambda rate: (len(self._usable_steps(rate)), -rate))
        for substeps, largest in ((2, own / _RULES.smooth_gain), (rate, own / finer)):
            fine = self.run_reference(self.motions, substeps, _RK4)
            if not fine.is_complete or fine.uncorrected_error(model, 2).error > largest:
                return None
        self.reference_integrator = _RK4
        return fine

    def _needed_substeps(self, own: float) -> int:
        """Return the substeps that the error needs; use fewer seeds if the work allows no more.

        Substeps are reduced only if even one seed would take too long. Of those that are fine
        enough, the ones with the most usable timesteps are chosen.
        """
        limit = min(self.examined.task.tolerance, max(ERROR_FLOOR, own))
        if self._request.error is not None and self._request.error_at is None:
            limit = min(limit, self._request.error)
        passes = self.work / self.cost.pass_seconds
        needed = min(own / (_RULES.reference_error_share * limit), _RULES.substeps[-1])
        needed = max(
            needed, min(_RULES.front_substeps, _RULES.reference_share * passes / self.seeds)
        )
        enough = [
            rate
            for rate in _RULES.substeps
            if needed <= rate <= max(2 * needed, _RULES.substeps[1])
        ]
        finer = max(
            enough or _RULES.substeps[-1:], key=lambda rate: (len(self._usable_steps(rate)), -rate)
        )
        seeds = min(self.seeds, max(1, int(_RULES.reference_share * passes / finer)))
        self.motions = [first_seeds(motion, seeds) for motion in self.motions]
        allowed = max(
            rate
            for rate in _RULES.substeps
            if rate <= max(_RULES.substeps[0], _RULES.most_seed_share * passes)
        )
        if allowed < finer:
            reason = f"the reference uses {allowed} substeps, the error needs {finer}"
            self._skip_part("reference", f"{reason}; --max-cpu allows no more")
        if seeds < (all_seeds := len(self.examined.task.seeds)):
            self._skip_part("seeds", f"{seeds} of {all_seeds} were used; --max-cpu allows no more")
        if self._window_stride > 1:
            reason = f"one in {self._window_stride} was used; --max-cpu allows no more"
            self._skip_part("windows", reason)
        return min(finer, allowed)

    @staticmethod
    def as_run(model: mujoco.MjModel, own: mujoco.MjModel) -> mujoco.MjModel:
        """Return a model with the flag of another one that stops a run instead of resetting it."""
        run_model, bit = copy.copy(model), int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        run_model.opt.disableflags = (
            int(model.opt.disableflags) & ~bit | int(own.opt.disableflags) & bit
        )
        return run_model

    def moves_alike(self, model: mujoco.MjModel) -> bool:
        """Return whether each bit of the task's motion is that of the model as written."""
        return self._own_states.match_models(
            [self.as_run(model, motion.model) for motion in self.motions]
        )

    @cached_property
    def _own_states(self) -> KnownStates:
        return KnownStates(self.motions, self.threads)

    def _find_unused(self) -> ModelEdits:
        """Find parts that change no state: without them the motion is the same, bit for bit."""
        model = self.model
        runs = [part.positions for part in self.reference.phases]
        edits = unreachable_edits(model, runs)
        if edits.masked and self._needs_masks_kept:
            edits = unreachable_edits(model, runs, with_masks=False)
        flags = unused_flags(self.examined.scene.source.model)
        self.model = with_flags(model, flags)
        edits = replace(edits, unflagged=flags)
        if "sensors" in self._request.apply:
            edits = replace(edits, sensors=own_sensors(model))
        elif own_sensors(model):
            self._skip_part("sensors", "your program may read them; --apply sensors removes them")
        if edits == ModelEdits():
            return edits
        try:
            lighter = compile_changed(self.examined, edits)
        except SceneError as error:
            self._skip_part("impossible collisions", str(error).splitlines()[0])
            return ModelEdits()
        if not self.moves_alike(lighter):
            self._skip_part("impossible collisions", "the motion differs")
            return ModelEdits()
        self.models[_UNUSED] = lighter
        return edits

    @cached_property
    def _needs_masks_kept(self) -> bool:
        return needs_masks(self.examined, self.original_runs.grips)

    def _skip_part(self, name: str, reason: str) -> None:
        self.skipped.append(SkippedParameter(name, reason))

    @property
    def far_distance(self) -> float:
        """Distance of far pairs [m]: the requested one, or the one that is offered."""
        offered = next(one.distance for one in list_reductions() if one.name == "far-pairs")
        distance = self._request.apply.get("far-pairs", offered)
        assert distance is not None
        return distance

    @cached_property
    def far_geom_pairs(self) -> frozenset[GeomPair]:
        """Pairs of geoms that never came nearer than the requested, or offered, distance."""
        model, distance = self.own_model, self.far_distance
        moved = [*map(tilt_gravity, self.motions), *map(double_inputs, self.motions)]
        runs = [part.positions for part in self.reference.phases]
        visited = KnownStates(moved, self.threads).list_positions()
        near = pairs_within(model, [*runs, *visited], distance)
        if near is None:
            return frozenset()
        return frozenset(pair for pair in filtered_pairs(model) if pair not in near)

    @cached_property
    def far_pairs(self) -> ModelEdits:
        """Edits that remove collisions of far pairs, without those that are provably unused."""
        model, pairs, apart = self.own_model, filtered_pairs(self.own_model), self.far_geom_pairs
        edits = exclusion_edits(model, pairs, apart)
        if edits.masked and self._needs_masks_kept:
            edits = exclusion_edits(model, pairs, apart, with_masks=False)
        # Provable edits come first, and are reported separately.
        proved = {*self.unused.masked}, {*self.unused.excluded}
        return ModelEdits(
            masked=tuple(geom for geom in edits.masked if geom not in proved[0]),
            excluded=tuple(pair for pair in edits.excluded if pair not in proved[1]),
        )

    def model_without_far_pairs(self) -> mujoco.MjModel | None:
        """Return the model without collisions of far pairs, or None."""
        reductions = _SPARSER
        if not (self.far_pairs.masked or self.far_pairs.excluded):
            return None
        if reductions not in self.models:
            try:
                self.models[reductions] = compile_changed(self.examined, self.edits_of(reductions))
            except SceneError as error:
                self._skip_part("far pairs", str(error).splitlines()[0])
                self.far_pairs = ModelEdits()
                return None
        return self.models[reductions]

    def _simplify_hulls(self) -> Reductions | None:
        """Compile the model with simplified hulls, if requested."""
        model, within = self.model, self._request.apply.get("hulls")
        if within is None:
            sizes = [len(hull_vertices(model, mesh)) for mesh in colliding_meshes(model)]
            many_vertices = 32
            if large := [size for size in sizes if size > many_vertices]:
                most = f"{min(large)} to {max(large)}" if len(large) > 1 else f"{large[0]}"
                reason = f"{len(large)} of {len(sizes)}: {most} vertices"
                self._skip_part("hulls", f"{reason}; --apply hulls tries fewer")
            return None
        base = self.edits_of(self.start)
        reductions = Reductions({*self.start, "hulls"})
        try:
            self.hull_vertices = fewest_vertices(
                model,
                lambda hulls: compile_changed(self.examined, replace(base, hulls=hulls)),
                within,
            )
            if not self.hull_vertices:
                self._skip_part(
                    "hulls", f"no hull with fewer vertices is within {1e3 * within:g} mm"
                )
                return None
            self.models[reductions] = compile_changed(self.examined, self.edits_of(reductions))
        except SceneError as error:
            self._skip_part("hulls", str(error).splitlines()[0])
            return None
        return reductions

    def edits_of(self, reductions: Reductions) -> ModelEdits:
        """Return the edits of reductions."""
        edits = self.unused if "unused" in reductions else ModelEdits()
        if "far-pairs" in reductions:
            edits = replace(
                edits,
                masked=(*edits.masked, *self.far_pairs.masked),
                excluded=(*edits.excluded, *self.far_pairs.excluded),
            )
        return replace(edits, hulls=self.hull_vertices) if "hulls" in reductions else edits


def _has_same_reference(model: mujoco.MjModel, other: mujoco.MjModel) -> bool:
    # Whether two models differ in numerics only, which references replace.
    references = [build_reference_model(each, 1) for each in (model, other)]
    for reference in references:
        reference.opt.timestep = other.opt.timestep
        reference.opt.integrator = other.opt.integrator
    buffers = [np.empty(mujoco.mj_sizeModel(each), np.uint8) for each in references]
    for reference, buffer in zip(references, buffers, strict=True):
        mujoco.mj_saveModel(reference, None, buffer)
    return bytes(buffers[0]) == bytes(buffers[1])


def control_period(scene: Scene) -> float | None:
    """Return the period of the controller that drives a scene [s], or None without one."""
    drive = scene.drive
    rate = getattr(drive, "rate", None) if getattr(drive, "policy", None) else None
    return None if rate is None else 1.0 / float(rate)


def first_seeds(motion: Motion, seeds: int) -> Motion:
    """Return the first seeds of a motion."""
    return replace(motion, starts=motion.starts[:seeds], inputs=motion.inputs[:seeds])
