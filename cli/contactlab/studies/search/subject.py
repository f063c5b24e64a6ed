"""A model that is tuned: its motions, the fine ones that tell errors, and what may go from it."""

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
from contactlab.studies.search.allowed_time import AllowedTime
from contactlab.studies.search.choice import AS_WRITTEN, Cuts
from contactlab.studies.search.exercise import bits_of, doubled, positions_of, tilted
from contactlab.studies.search.forward import ForwardError, Watched
from contactlab.studies.search.hulls import colliding, fewer_vertices, hull
from contactlab.studies.search.levers import Unsearched
from contactlab.studies.search.searching import Measure
from contactlab.studies.search.sleeping import OrAsleep
from contactlab.studies.search.tune_request import TuneRequest
from contactlab.studies.search.unused_pairs import (
    left_out,
    pairs_within,
    sensors_of,
    unread_flags,
    untouched_geoms,
    with_flags,
)
from contactlab.studies.search.yardstick import Apart, Yardsticks

LEAST_AIM = 0.01
"""The error that is small enough for any model, as a share."""
OFFERED_APART = 0.05
"""m: a distance of which is told what leaving out collisions would save."""
SEARCHING = 0.6
"""Share of the time allowed; the rest is for files, fresh seeds and the clock."""
LIMITED = ("errors of steps", "seeds", "windows")
"""Names by which a report keeps what the time did not allow to look at."""
_FINER = (2, 4, 8, 16)
_RESOLVED = 0.2  # share of the limit that the fine motion's own error may have
_RESOLVING, _AT_MOST = 0.15, 0.4
"""Shares of the time allowed that fine motions may take: of all seeds, of one."""
_PASSES = 80  # times that a search simulates the task, about
_SPARSEST = 4  # at least one in so many windows is looked at
_MANY_VERTICES = 32
_UNUSED: Cuts = frozenset({"unused"})


class Subject:
    """One model that is tuned.

    Attributes:
        motions: phases of the task, of as many seeds as the time allows.
        one_pass: CPU time that the task takes, of one seed [s].
        compiling: CPU time that its files take to be compiled [s].
        model: as its files make it, without what records runs.
        yards: what tells how far candidates are from the model as written.
        uncertain: what friction 10 % and masses 5 % are worth.
        models: as written, and without what may go.
        kept: what is not tried, and why.
        hull_vertices: most vertices of hulls within the distance that is asked for, by mesh.
    """

    def __init__(
        self, request: TuneRequest, examined: CheckedModel, threads: int, allowed: AllowedTime
    ) -> None:
        """Measure how long the model takes, what it is uncertain by, and what changes no state."""
        self._request, self.examined, self.threads = request, examined, threads
        self._allowed = allowed
        task = examined.task
        if request.at is not None:
            task = task.model_copy(update={"watched": ()})
        self.motions = self._affordable(examined.motions_of(task))
        begin = time.process_time()
        self.model = self._compiled(ModelEdits())
        self.compiling = time.process_time() - begin
        self.kept = list[Unsearched]()
        self.yards, self.uncertain = self._resolved()
        self.models: dict[Cuts, mujoco.MjModel] = {}
        self.exact = self._exact()
        self.models[AS_WRITTEN] = self.model
        self.start: Cuts = _UNUSED if _UNUSED in self.models else AS_WRITTEN
        if request.apart is not None and self.sparser() is not None:
            self.start = frozenset({"unused", "apart"})
        self.hull_vertices: Mapping[str, int] = {}
        self.hulled = self._hulled()

    @property
    def own_model(self) -> mujoco.MjModel:
        """As it moves in the task."""
        return self.motions[0].model

    @property
    def seeds(self) -> int:
        """How many the search looks at."""
        return self.motions[0].seeds

    @property
    def limit(self) -> float:
        """The largest error that is asked for."""
        return self._limit(self.uncertain)

    @property
    def watched(self) -> list[Watched]:
        """What a forward error is asked of."""
        return [Watched.of(self.model, name) for name in self._request.watched]

    def measure(self, yards: Yardsticks, motions: Sequence[Motion]) -> Measure:
        """Return what tells how far candidates are from the model as written, in motions."""
        if self._request.at is None:
            return OrAsleep(yards, motions, self.yards.finer, self.threads)
        finer, at = self.yards.finer, self._request.at
        return ForwardError(motions, finer, self.watched, at, self.threads)

    def _affordable(self, motions: Sequence[Motion]) -> list[Motion]:
        """Return motions of as many seeds as the time allows to simulate, all windows or fewer."""
        begin = time.process_time()
        for motion in motions:
            replay(motion, 1.0, self.threads)
        self.one_pass = (time.process_time() - begin) / motions[0].seeds
        takes = self._allowed.takes(self.one_pass)
        allowed = SEARCHING * self._request.max_time / _PASSES
        seeds = min(motions[0].seeds, max(1, int(_SPARSEST * allowed / takes)))
        self._every = min(_SPARSEST, max(1, math.ceil(seeds * takes / allowed)))
        return [first_seeds(motion, seeds) for motion in motions]

    def _compiled(self, edits: ModelEdits) -> mujoco.MjModel:
        """Return the model of the scene's files, without what records runs, and pictures."""
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

    def _resolved(self) -> tuple[Yardsticks, Apart | None]:
        """Return yardsticks that are fine enough, and what the model is uncertain by."""
        coarse = Yardsticks.of(self.motions, 1, self.threads, self._every)
        if not coarse.known:
            finest = Yardsticks.of(self.motions, 8, self.threads, self._every)
            if not finest.known:
                raise EngineError(
                    f"{self._request.model}: MuJoCo gives up even at an eighth of the timestep; "
                    f"contactlab {self._request.model} says why"
                )
            return finest, finest.uncertain()
        uncertain = coarse.uncertain()
        finer = self._finer(coarse, uncertain)
        fine = Yardsticks.of(self.motions, finer, self.threads, self._every)
        return (fine, uncertain) if fine.known else (coarse, uncertain)

    def _finer(self, coarse: Yardsticks, uncertain: Apart | None) -> int:
        """Return how many fine steps one is to have, by the error; of fewer seeds if time is short.

        Only where even one seed would take too long are they fewer than the error asks for.
        """
        limit = self._limit(uncertain)
        if self._request.at is not None or self._request.real_time is not None:
            limit = LEAST_AIM
        # Between one and two steps lies what one step is from the limit, in first order.
        needed = coarse.seen_apart(self.own_model, 2).share / (_RESOLVED * limit)
        finer = next((rate for rate in _FINER if rate >= needed), _FINER[-1])
        passes = self._request.max_time / max(self._allowed.takes(self.one_pass), 1e-6)
        seeds = min(self.seeds, max(1, int(_RESOLVING * passes / finer)))
        self.motions = [first_seeds(motion, seeds) for motion in self.motions]
        allowed = max(rate for rate in _FINER if rate <= max(_FINER[0], _AT_MOST * passes))
        if allowed < finer:
            reason = f"a fine one is 1/{allowed} of the own, the error asks for 1/{finer}"
            self._keep("errors of steps", f"{reason}: --max-time allows no more")
        if seeds < (all_seeds := len(self.examined.task.seeds)):
            self._keep("seeds", f"{seeds} of {all_seeds} were looked at: --max-time allows no more")
        if self._every > 1:
            reason = f"one in {self._every} was looked at: --max-time allows no more"
            self._keep("windows", reason)
        return min(finer, allowed)

    def _limit(self, uncertain: Apart | None) -> float:
        within = self.examined.task.within
        if self._request.error is not None:
            return self._request.error if self._request.at else min(self._request.error, within)
        return min(within, max(LEAST_AIM, uncertain.share if uncertain else 0.0))

    def _exact(self) -> ModelEdits:
        """Find what changes no state: the model without it moves bit for bit the same."""
        model = self.model
        edits = untouched_geoms(model, [part.positions for part in self.yards.parts])
        flags = unread_flags(self.examined.scene.source.model)
        self.model = with_flags(model, flags)
        edits = replace(edits, unflagged=flags)
        if self._request.drop_sensors:
            edits = replace(edits, sensors=sensors_of(model))
        elif sensors_of(model):
            self._keep("sensors", "your code may read them; --drop-sensors leaves them out")
        if edits == ModelEdits():
            return edits
        try:
            lighter = self._compiled(edits)
        except SceneError as error:
            self._keep("collisions that cannot be", str(error).splitlines()[0])
            return ModelEdits()
        others = [replace(motion, model=lighter) for motion in self.motions]
        own, without = (bits_of(motions, self.threads) for motions in (self.motions, others))
        if not all(map(eq, own, without)):
            self._keep("collisions that cannot be", "the motion differs")
            return ModelEdits()
        self.models[_UNUSED] = lighter
        return edits

    def _keep(self, name: str, reason: str) -> None:
        self.kept.append(Unsearched(name, reason))

    @cached_property
    def pairs_apart(self) -> frozenset[GeomPair]:
        """Pairs of geoms that never came as near as the distance that is asked for, or offered."""
        model, distance = self.own_model, self._request.apart or OFFERED_APART
        moved = [*map(tilted, self.motions), *map(doubled, self.motions)]
        runs = [part.positions for part in self.yards.parts]
        near = pairs_within(model, [*runs, *positions_of(moved, self.threads)], distance)
        if near is None:
            return frozenset()
        return frozenset(pair for pair in filtered_pairs(model) if pair not in near)

    @cached_property
    def apart(self) -> ModelEdits:
        """What leaves out collisions of what stayed apart, beside what is exact."""
        edits = left_out(self.own_model, filtered_pairs(self.own_model), self.pairs_apart)
        # What is proved stands first, and is told apart from this.
        proved = {*self.exact.masked}, {*self.exact.excluded}
        return ModelEdits(
            masked=tuple(geom for geom in edits.masked if geom not in proved[0]),
            excluded=tuple(pair for pair in edits.excluded if pair not in proved[1]),
        )

    def sparser(self) -> mujoco.MjModel | None:
        """Return the model without collisions of what stayed apart, or None."""
        cuts: Cuts = frozenset({"unused", "apart"})
        if not (self.apart.masked or self.apart.excluded):
            return None
        if cuts not in self.models:
            try:
                self.models[cuts] = self._compiled(self.edits_of(cuts))
            except SceneError as error:
                self._keep("what stayed apart", str(error).splitlines()[0])
                self.apart = ModelEdits()
                return None
        return self.models[cuts]

    def _hulled(self) -> Cuts | None:
        """Compile the model with fewer vertices of hulls, if that is asked for, beside the rest."""
        model, within = self.model, self._request.hulls
        if within is None:
            sizes = [len(hull(model, mesh)) for mesh in colliding(model)]
            if large := [size for size in sizes if size > _MANY_VERTICES]:
                most = f"{min(large)} to {max(large)}" if len(large) > 1 else f"{large[0]}"
                reason = f"{len(large)} of {len(sizes)}: {most} vertices"
                self._keep("hulls", f"{reason}; --hulls 1mm tries fewer, within that distance")
            return None
        base = self.edits_of(self.start)
        cuts = Cuts({*self.start, "hulls"})
        try:
            self.hull_vertices = fewer_vertices(
                model, lambda hulls: self._compiled(replace(base, hulls=hulls)), within
            )
            if not self.hull_vertices:
                self._keep("hulls", f"none is within {1e3 * within:g} mm of one of fewer vertices")
                return None
            self.models[cuts] = self._compiled(self.edits_of(cuts))
        except SceneError as error:
            self._keep("hulls", str(error).splitlines()[0])
            return None
        return cuts

    def edits_of(self, cuts: Cuts) -> ModelEdits:
        """Return what makes the model without something."""
        edits = self.exact if "unused" in cuts else ModelEdits()
        if "apart" in cuts:
            edits = replace(
                edits,
                masked=(*edits.masked, *self.apart.masked),
                excluded=(*edits.excluded, *self.apart.excluded),
            )
        return replace(edits, hulls=self.hull_vertices) if "hulls" in cuts else edits


def first_seeds(motion: Motion, seeds: int) -> Motion:
    """Return the first seeds of a motion."""
    return replace(motion, starts=motion.starts[:seeds], inputs=motion.inputs[:seeds])
