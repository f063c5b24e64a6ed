"""The reference of a family of runs: the same model and start at much finer timesteps."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats, Invariants, Joints
from contactlab.engines import SampledStates, integrate_to, invariants
from contactlab.measure import Discrepancy, distances, drifts
from contactlab.run.preparing import Preparer
from contactlab.run.record import RunPlan
from contactlab.scene import (
    CompiledScene,
    InitialStates,
    PreparedModel,
    joints_of,
    perturbed_copy,
    with_reference_numerics,
)

# At equal timesteps RK4 is nearest to the limit, by many orders where the motion is smooth; where
# it is unstable, since it is explicit, the other takes over.
_INTEGRATORS = ("RK4", "implicitfast")

Rows = NDArray[np.intp] | slice
Watch = Callable[[], None]


@dataclass(frozen=True)
class Marched:
    """A model, and what it did at T times."""

    prepared: PreparedModel
    march: SampledStates


@dataclass(frozen=True)
class Reference:
    """Two marches of one model at timesteps that differ by 2; the finer one is the reference.

    Attributes:
        start: where the family starts.
        integrator: of both.
        timestep: of the finer one [s].
        times: (T,) at which states are known [s].
        fine: the finer march.
        coarse: the other, for what the finer one may be off by.
        joints: the model's joints.
        free: whether nothing from outside acts on the model.
    """

    start: InitialStates
    integrator: str
    timestep: float
    times: Floats
    fine: Marched
    coarse: Marched
    joints: Joints
    free: bool

    def rows(self, times: Floats) -> NDArray[np.intp]:
        """Return where these times, all of them among the reference's, lie among its rows."""
        return np.searchsorted(self.times, times)

    def apart(self, found: SampledStates, rows: Rows = slice(None)) -> Discrepancy:
        """Return how far a march is from the reference at some of its rows [m]."""
        return Discrepancy.of(distances(self.joints, found.qpos, self.fine.march.qpos[rows]))

    def drift(self, found: SampledStates, rows: Rows = slice(None)) -> Discrepancy:
        """Return how far a march's energy and momenta are from the reference's, as shares."""
        mine = self._conserved(found.qpos, found.qvel)
        other = self._conserved(self.fine.march.qpos[rows], self.fine.march.qvel[rows])
        return Discrepancy.of(drifts(mine, other))

    def restarted(
        self, prepared: PreparedModel, begins: Floats, ends: Floats, watch: Watch
    ) -> Discrepancy | None:
        """Return how far a model gets from the reference between times, starting on it [m].

        Args:
            prepared: the model.
            begins: (K,) when to start from the reference's state [s].
            ends: (K,) when to compare [s].
            watch: called before steps, to start their time limit.
        """
        states = self.fine.march.states[self.rows(begins)]
        found = [
            integrate_to(prepared.model, self.start, end, begin=begin, state=state, watch=watch)
            for begin, end, state in zip(begins.tolist(), ends[:, None], states, strict=True)
        ]
        qpos = [each.qpos for each in found if each is not None]
        if len(qpos) < len(found):
            return None
        there = self.fine.march.qpos[self.rows(ends)]
        return Discrepancy.of(distances(self.joints, np.concatenate(qpos), there))

    def _conserved(self, qpos: Floats, qvel: Floats) -> Invariants:
        return invariants(self.fine.prepared.model, qpos, qvel, free=self.free)


class Referee:
    """Marches models of one family.

    Attributes:
        refine: the family's least timestep over that of the coarser march of a reference.
    """

    def __init__(self, preparer: Preparer, plan: RunPlan, refine: int, watch: Watch) -> None:
        self.refine = refine
        self._preparer = preparer
        self._plan = plan
        self._watch = watch
        self._base: CompiledScene = preparer.scene.base_of(plan.resolved)

    def reference(self, least: float, times: Floats) -> Reference | None:
        """Return the family's reference, or None if no integrator gets through.

        Args:
            least: least timestep of the family [s].
            times: (T,) at which its states are needed [s], increasing.
        """
        for integrator in _INTEGRATORS:
            timestep = least / self.refine
            fine = self._march(integrator, timestep / 2, times, self._plan.start)
            coarse = fine and self._march(integrator, timestep, times, self._plan.start)
            if fine and coarse:
                return Reference(
                    start=self._plan.start,
                    integrator=integrator,
                    timestep=timestep / 2,
                    times=times,
                    fine=fine,
                    coarse=coarse,
                    joints=joints_of(fine.prepared.model),
                    free=self._base.free,
                )
        return None

    def parting(self, reference: Reference) -> float | None:
        """Return how far a start that is hardly another gets from the coarser march [m].

        At its timestep, and not at those of the runs: which step an impact falls into may change
        with any nudge, and by then moves what follows by less than the runs' own errors.
        """
        twin = perturbed_copy(reference.start, reference.joints, self._plan.run.seed)
        timestep = 2 * reference.timestep
        found = self._march(reference.integrator, timestep, reference.times, twin)
        if found is None:
            return None
        qpos = reference.coarse.march.qpos
        return Discrepancy.of(distances(reference.joints, found.march.qpos, qpos)).peak

    def _march(
        self, integrator: str, timestep: float, times: Floats, start: InitialStates
    ) -> Marched | None:
        resolved = with_reference_numerics(self._plan.resolved, integrator, timestep)
        prepared = self._preparer.scene.prepare(resolved, self._plan.start)
        found = integrate_to(prepared.model, start, times, watch=self._watch)
        return found and Marched(prepared, found)
