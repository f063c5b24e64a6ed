"""The model to tune: its motions, its reference, and the parts that can be removed."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from operator import eq

import mujoco

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.windows import replay
from contactlab.errors import EngineError, SceneError
from contactlab.scene.model_draft import CompiledFiles, ModelEdits, drop_textures, edit_spec
from contactlab.scene.unreachable import GeomPair, filtered_pairs
from contactlab.studies.check.checked_model import CheckedModel
from contactlab.studies.search.configuration import AS_WRITTEN, Reductions
from contactlab.studies.search.forward_error import ForwardError, ObservedOutput
from contactlab.studies.search.reference_error import ErrorEstimate, TaskReference
from contactlab.studies.search.search_space import SkippedParameter
from contactlab.studies.search.settings_search import ErrorEstimator
from contactlab.studies.search.simplified_hulls import (
    colliding_meshes,
    fewest_vertices,
    hull_vertices,
)
from contactlab.studies.search.sleep_error import SleepAwareError
from contactlab.studies.search.stress_motions import (
    double_inputs,
    state_bytes,
    tilt_gravity,
    visited_positions,
)
from contactlab.studies.search.time_limit import TimeLimit
from contactlab.studies.search.tune_request import TuneRequest
from contactlab.studies.search.unused_pairs import (
    exclusion_edits,
    own_sensors,
    pairs_within,
    unreachable_edits,
    unused_flags,
    with_flags,
)

MIN_TARGET = 0.01
"""An error that is small enough for any model, as a share."""
OFFERED_DISTANCE = 0.05
"""m: distance for which the saving without collisions is reported."""
SEARCH_TIME_SHARE = 0.6
"""Share of the time limit for the search; the rest is for files, fresh seeds and the clock."""
LIMITED = ("reference", "seeds", "windows")
"""Names of report entries on the effects of the time limit."""
_SUBSTEPS = (2, 4, 8, 16)
_REFERENCE_ERROR_SHARE = 0.2  # share of the limit that the reference's own error may have
_REFERENCE_TIME_SHARE, _MAX_SEED_TIME_SHARE = 0.15, 0.4
"""Shares of the time limit for references: of all seeds, and of one."""
_SEARCH_PASSES = 80  # approximate simulations of the task per search
_MAX_WINDOW_STRIDE = 4  # at least one in this many windows is used
_MANY_VERTICES = 32
_UNUSED: Reductions = frozenset({"unused"})


class TuningProblem:
    """The model to tune.

    Attributes:
        motions: phases of the task, with as many seeds as the time limit allows.
        pass_seconds: CPU time of the task for one seed [s].
        compile_seconds: CPU time of compiling the files [s].
        model: the model compiled from its files, without recording.
        reference: the reference that errors are measured from.
        model_uncertainty: effect of friction +-10 % and masses +-5 %.
        models: compiled models by reductions.
        skipped: settings that are not tried, and why.
        hull_vertices: largest numbers of hull vertices within the requested distance, by mesh.
    """

    def __init__(
        self, request: TuneRequest, examined: CheckedModel, threads: int, allowed: TimeLimit
    ) -> None:
        """Measure the cost, the reference, the model uncertainty, and the unused parts."""
        self._request, self.examined, self.threads = request, examined, threads
        self._time_limit = allowed
        task = examined.task
        if request.error_at is not None:
            task = task.model_copy(update={"observed": ()})
        self.motions = self._affordable_motions(examined.motions_of(task))
        begin = time.process_time()
        self.model = self._compile_edited(ModelEdits())
        self.compile_seconds = time.process_time() - begin
        self.skipped = list[SkippedParameter]()
        self.reference, self.model_uncertainty = self._converged_reference()
        self.models: dict[Reductions, mujoco.MjModel] = {}
        self.unused = self._find_unused()
        self.models[AS_WRITTEN] = self.model
        self.start: Reductions = _UNUSED if _UNUSED in self.models else AS_WRITTEN
        if request.skip_pairs_beyond is not None and self.model_without_far_pairs() is not None:
            self.start = frozenset({"unused", "apart"})
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
    def limit(self) -> float:
        """The target error."""
        return self._limit_of(self.model_uncertainty)

    @property
    def observed(self) -> list[ObservedOutput]:
        """Outputs of the forward error."""
        return [ObservedOutput.find(self.model, name) for name in self._request.observed]

    def error_estimator(
        self, reference: TaskReference, motions: Sequence[Motion]
    ) -> ErrorEstimator:
        """Return the estimator of errors against the model as written, for motions."""
        if self._request.error_at is None:
            return SleepAwareError(reference, motions, self.reference.substeps, self.threads)
        finer, at = self.reference.substeps, self._request.error_at
        return ForwardError(motions, finer, self.observed, at, self.threads)

    def _affordable_motions(self, motions: Sequence[Motion]) -> list[Motion]:
        """Return motions of as many seeds as the time limit allows, with all windows or fewer."""
        begin = time.process_time()
        for motion in motions:
            replay(motion, 1.0, self.threads)
        self.pass_seconds = (time.process_time() - begin) / motions[0].seeds
        takes = self._time_limit.wall_time_of(self.pass_seconds)
        allowed = SEARCH_TIME_SHARE * self._request.max_time / _SEARCH_PASSES
        seeds = min(motions[0].seeds, max(1, int(_MAX_WINDOW_STRIDE * allowed / takes)))
        self._window_stride = min(_MAX_WINDOW_STRIDE, max(1, math.ceil(seeds * takes / allowed)))
        return [first_seeds(motion, seeds) for motion in motions]

    def _compile_edited(self, edits: ModelEdits) -> mujoco.MjModel:
        """Return the model of the scene's files with edits, without recording and textures."""
        scene = self.examined.scene.with_effects("all")

        def edit(spec: mujoco.MjSpec) -> None:
            edit_spec(spec, edits)
            drop_textures(spec)

        files = CompiledFiles.of(scene, scene.source, self.examined.values, edit)
        size = mujoco.mj_stateSize(files.model, INTEGRATION)
        own = self.own_model
        if size != mujoco.mj_stateSize(own, INTEGRATION):
            return own
        return files.model

    def _converged_reference(self) -> tuple[TaskReference, ErrorEstimate | None]:
        """Return a reference that is fine enough, and the model uncertainty."""
        coarse = TaskReference.run_references(self.motions, 1, self.threads, self._window_stride)
        if not coarse.is_complete:
            finest = TaskReference.run_references(
                self.motions, 8, self.threads, self._window_stride
            )
            if not finest.is_complete:
                raise EngineError(
                    f"{self._request.model}: MuJoCo gives up even at an eighth of the timestep; "
                    f"see contactlab {self._request.model}"
                )
            return finest, finest.model_uncertainty()
        uncertain = coarse.model_uncertainty()
        finer = self._needed_substeps(coarse, uncertain)
        fine = TaskReference.run_references(self.motions, finer, self.threads, self._window_stride)
        return (fine, uncertain) if fine.is_complete else (coarse, uncertain)

    def _needed_substeps(self, coarse: TaskReference, uncertain: ErrorEstimate | None) -> int:
        """Return the substeps that the error needs; use fewer seeds if time is short.

        Substeps are reduced only if even one seed would take too long.
        """
        limit = self._limit_of(uncertain)
        if self._request.error_at is not None or self._request.real_time is not None:
            limit = MIN_TARGET
        # In first order, one step differs from two as much as from the limit.
        needed = coarse.uncorrected_error(self.own_model, 2).error / (
            _REFERENCE_ERROR_SHARE * limit
        )
        finer = next((rate for rate in _SUBSTEPS if rate >= needed), _SUBSTEPS[-1])
        passes = self._request.max_time / max(
            self._time_limit.wall_time_of(self.pass_seconds), 1e-6
        )
        seeds = min(self.seeds, max(1, int(_REFERENCE_TIME_SHARE * passes / finer)))
        self.motions = [first_seeds(motion, seeds) for motion in self.motions]
        allowed = max(
            rate for rate in _SUBSTEPS if rate <= max(_SUBSTEPS[0], _MAX_SEED_TIME_SHARE * passes)
        )
        if allowed < finer:
            reason = f"the reference uses {allowed} substeps, the error needs {finer}"
            self._skip("reference", f"{reason}; --max-time allows no more")
        if seeds < (all_seeds := len(self.examined.task.seeds)):
            self._skip("seeds", f"{seeds} of {all_seeds} were used; --max-time allows no more")
        if self._window_stride > 1:
            reason = f"one in {self._window_stride} was used; --max-time allows no more"
            self._skip("windows", reason)
        return min(finer, allowed)

    def _limit_of(self, uncertain: ErrorEstimate | None) -> float:
        within = self.examined.task.tolerance
        if self._request.error is not None:
            return (
                self._request.error if self._request.error_at else min(self._request.error, within)
            )
        return min(within, max(MIN_TARGET, uncertain.error if uncertain else 0.0))

    def _find_unused(self) -> ModelEdits:
        """Find parts that change no state: without them the motion is the same, bit for bit."""
        model = self.model
        edits = unreachable_edits(model, [part.positions for part in self.reference.phases])
        flags = unused_flags(self.examined.scene.source.model)
        self.model = with_flags(model, flags)
        edits = replace(edits, unflagged=flags)
        if self._request.drop_sensors:
            edits = replace(edits, sensors=own_sensors(model))
        elif own_sensors(model):
            self._skip("sensors", "your program may read them; --drop-sensors removes them")
        if edits == ModelEdits():
            return edits
        try:
            lighter = self._compile_edited(edits)
        except SceneError as error:
            self._skip("impossible collisions", str(error).splitlines()[0])
            return ModelEdits()
        others = [replace(motion, model=lighter) for motion in self.motions]
        own, without = (state_bytes(motions, self.threads) for motions in (self.motions, others))
        if not all(map(eq, own, without)):
            self._skip("impossible collisions", "the motion differs")
            return ModelEdits()
        self.models[_UNUSED] = lighter
        return edits

    def _skip(self, name: str, reason: str) -> None:
        self.skipped.append(SkippedParameter(name, reason))

    @cached_property
    def far_geom_pairs(self) -> frozenset[GeomPair]:
        """Pairs of geoms that never came nearer than the requested, or offered, distance."""
        model, distance = self.own_model, self._request.skip_pairs_beyond or OFFERED_DISTANCE
        moved = [*map(tilt_gravity, self.motions), *map(double_inputs, self.motions)]
        runs = [part.positions for part in self.reference.phases]
        near = pairs_within(model, [*runs, *visited_positions(moved, self.threads)], distance)
        if near is None:
            return frozenset()
        return frozenset(pair for pair in filtered_pairs(model) if pair not in near)

    @cached_property
    def far_pairs(self) -> ModelEdits:
        """Edits that remove collisions of far pairs, without those that are provably unused."""
        edits = exclusion_edits(self.own_model, filtered_pairs(self.own_model), self.far_geom_pairs)
        # Provable edits come first, and are reported separately.
        proved = {*self.unused.masked}, {*self.unused.excluded}
        return ModelEdits(
            masked=tuple(geom for geom in edits.masked if geom not in proved[0]),
            excluded=tuple(pair for pair in edits.excluded if pair not in proved[1]),
        )

    def model_without_far_pairs(self) -> mujoco.MjModel | None:
        """Return the model without collisions of far pairs, or None."""
        reductions: Reductions = frozenset({"unused", "apart"})
        if not (self.far_pairs.masked or self.far_pairs.excluded):
            return None
        if reductions not in self.models:
            try:
                self.models[reductions] = self._compile_edited(self.edits_of(reductions))
            except SceneError as error:
                self._skip("far pairs", str(error).splitlines()[0])
                self.far_pairs = ModelEdits()
                return None
        return self.models[reductions]

    def _simplify_hulls(self) -> Reductions | None:
        """Compile the model with simplified hulls, if requested."""
        model, within = self.model, self._request.simplify_hulls
        if within is None:
            sizes = [len(hull_vertices(model, mesh)) for mesh in colliding_meshes(model)]
            if large := [size for size in sizes if size > _MANY_VERTICES]:
                most = f"{min(large)} to {max(large)}" if len(large) > 1 else f"{large[0]}"
                reason = f"{len(large)} of {len(sizes)}: {most} vertices"
                self._skip("hulls", f"{reason}; --simplify-hulls 1mm tries fewer")
            return None
        base = self.edits_of(self.start)
        reductions = Reductions({*self.start, "hulls"})
        try:
            self.hull_vertices = fewest_vertices(
                model, lambda hulls: self._compile_edited(replace(base, hulls=hulls)), within
            )
            if not self.hull_vertices:
                self._skip("hulls", f"no hull with fewer vertices is within {1e3 * within:g} mm")
                return None
            self.models[reductions] = self._compile_edited(self.edits_of(reductions))
        except SceneError as error:
            self._skip("hulls", str(error).splitlines()[0])
            return None
        return reductions

    def edits_of(self, reductions: Reductions) -> ModelEdits:
        """Return the edits of reductions."""
        edits = self.unused if "unused" in reductions else ModelEdits()
        if "apart" in reductions:
            edits = replace(
                edits,
                masked=(*edits.masked, *self.far_pairs.masked),
                excluded=(*edits.excluded, *self.far_pairs.excluded),
            )
        return replace(edits, hulls=self.hull_vertices) if "hulls" in reductions else edits


def first_seeds(motion: Motion, seeds: int) -> Motion:
    """Return the first seeds of a motion."""
    return replace(motion, starts=motion.starts[:seeds], inputs=motion.inputs[:seeds])
