"""References of runs, and the distinction between settings that discretize a model and parts of it.

Runs that differ only in discretization settings converge to one limit as the timestep goes to 0,
and so share a reference. All other settings change the limit: contact parameters (solref, solimp,
friction, condim, margin, gap), cone and impratio, gravity and the like, and settings of the
manifest. These settings look numerical, but are part of the model:
- noslip_iterations, noslip_tolerance: the noslip pass removes slip that the contact model has; the
  remaining slip depends on its iterations, at any timestep.
- refsafe: without it solref is used as written at any timestep; with it only if the timestep is
  small enough, which is an error of the run, marked as `solref_clamped`.
- multiccd, nativeccd, speculative, diagexact: these change the contacts or their impedances.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.rotations import angles_between
from contactlab.contact.trace_arrays import Floats, Invariants
from contactlab.contact.trace_setup import Joints
from contactlab.engines import engine_of
from contactlab.engines.engine import SampledStates, SolvesReferences, Watch
from contactlab.measure.context import NEGLIGIBLE_SHARE
from contactlab.scene.compiled_scene import PreparedModel
from contactlab.scene.initial_states import InitialStates, perturbed_copy
from contactlab.scene.model_edits import read_flag
from contactlab.scene.run_setup import joints_of
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.schema.setting_values import Settings


class Discrepancy(NamedTuple):
    """Summary of distances over time: at the last time, the mean, and the largest."""

    final: float
    mean: float
    peak: float

    @classmethod
    def of_distances(cls, distances: Floats) -> "Discrepancy":
        """Summarize (T,) distances."""
        return cls(float(distances[-1]), float(distances.mean()), float(distances.max()))


def trajectory_distances(joints: Joints, first: Floats, second: Floats) -> Floats:
    """Return (T,) distances [m] between configurations (T, nq): the largest of any joint.

    Slides and free positions count in meters. A hinge counts its angle times the length of its
    degree of freedom. A rotation counts the angle from the first to the second rotation, the norm
    of the quaternion's logarithm, times that length.
    """
    scalars = list(joints.scalars)
    parts = [np.abs(first[:, scalars] - second[:, scalars]) * joints.lengths]
    for place in joints.points:
        apart = first[:, place : place + 3] - second[:, place : place + 3]
        parts.append(np.linalg.norm(apart, axis=1)[:, None])
    for place, reach in zip(joints.rotations, joints.reaches, strict=True):
        turn = angles_between(first[:, place : place + 4], second[:, place : place + 4])
        parts.append((turn * reach)[:, None])
    return np.concatenate(parts, axis=1).max(axis=1, initial=0.0)


def invariant_drifts(run: Invariants, reference: Invariants) -> Floats:
    """Return (T,) largest relative deviation of a run's energy and momenta from the reference's.

    Energy is relative to the reference's peak kinetic energy K, which counts as at least the energy
    to lift everything by 1 % of a body; momentum is relative to sqrt(2 m K); angular momentum is
    relative to its largest magnitude, which counts as at least 1 % of a body times sqrt(2 m K).
    """
    scale = max(float(reference.kinetic.max()), reference.lift, float(np.finfo(float).tiny))
    parts = [np.abs(run.energy - reference.energy) / scale]
    push = np.sqrt(2 * reference.mass * scale)
    if run.momentum is not None and reference.momentum is not None:
        parts.append(np.linalg.norm(run.momentum - reference.momentum, axis=1) / push)
    if run.angular_momentum is not None and reference.angular_momentum is not None:
        most = float(np.linalg.norm(reference.angular_momentum, axis=1).max())
        parts.append(
            np.linalg.norm(run.angular_momentum - reference.angular_momentum, axis=1)
            / max(most, reference.arm * push)
        )
    return np.maximum.reduce(parts)


NUMERICS: Mapping[str, object] = {
    "timestep": None,  # goes to zero in the limit
    "integrator": None,  # all are consistent: they differ by powers of the timestep
    # The constraint problem is convex: every converged solver gives the same answer.
    "solver": "Newton",
    "iterations": 200,
    "tolerance": 1e-12,
    "ls_iterations": 50,
    "ls_tolerance": 0.01,
    "warmstart": True,  # the start of the solver
    "island": True,  # bodies that do not touch are solved separately
    "jacobian": "auto",  # the storage of the same matrix
    # Accuracy of the distance of convex shapes.
    "ccd_iterations": 200,
    "ccd_tolerance": 1e-9,
    "midphase": True,  # the method of skipping distant pairs
    "eulerdamp": True,  # damping evaluated at the end of a step or at its start
    "sleep": False,  # skips bodies at rest, which should not move anyway
}
"""Settings and flags that only discretize, and why the limit does not depend on them.

The values are those of a reference; None if each reference chooses.
"""


def with_reference_numerics(run: RunSpec, integrator: str, timestep: float) -> RunSpec:
    """Return a run with the numerics of a reference at a timestep [s].

    Runs that differ only in numerics give equal references.
    """
    chosen = {**NUMERICS, "integrator": integrator, "timestep": timestep}
    settings = Settings({name: chosen.get(name, value) for name, value in run.settings.items()})
    flags = {name: bool(chosen.get(name, state)) for name, state in run.flags.items()}
    changed_names = {name for name in chosen if name in settings or name in flags}
    return replace(
        run, settings=settings, flags=flags, changed_settings=run.changed_settings | changed_names
    )


# At equal timesteps RK4 is closest to the limit, by many orders of magnitude for smooth motion. As
# an explicit method it may be unstable, and then the other one is used. It need not fail: a
# solution that differs by more than the model's size at half the step counts as unstable.
_INTEGRATORS = ("RK4", "implicitfast")

Rows = NDArray[np.intp] | slice


@dataclass(frozen=True)
class PlannedModel:
    """A run before it starts: its model, and its start (n is 1)."""

    run: RunSpec
    prepared: PreparedModel
    start: InitialStates


class Solution(NamedTuple):
    """A model, and its states at T times."""

    prepared: PreparedModel
    sampled: SampledStates


@dataclass(frozen=True)
class Family:
    """Runs that share a reference, with an engine that solves references."""

    scene: Scene
    run: PlannedModel  # one of them
    # The common part of the reference and all of them; its numerics do not matter.
    model: RunSpec
    watch: Watch  # called before steps, to start their time limit

    def integrate_model(
        self,
        prepared: PreparedModel,
        times: Floats,
        start: InitialStates | None = None,
        *,
        begin: float = 0.0,
        state: Floats | None = None,
    ) -> SampledStates | None:
        """Return a model's states at some times [s], or None; see `SolvesReferences`."""
        engine = engine_of(self.run.run)
        assert isinstance(engine, SolvesReferences)
        start = start or self.run.start
        return engine.integrate_to(
            prepared.model, start, times, begin=begin, state=state, watch=self.watch
        )

    def solve_at(
        self, integrator: str, timestep: float, times: Floats, start: InitialStates | None = None
    ) -> Solution | None:
        """Return the solution at a timestep [s], or None."""
        resolved = with_reference_numerics(self.model, integrator, timestep)
        prepared = self.scene.prepare(resolved, self.run.start)
        sampled = self.integrate_model(prepared, times, start)
        return sampled and Solution(prepared, sampled)

    def find_reference(self, times: Floats, timestep: float) -> "ReferenceSolution | None":
        """Return the reference with a coarse timestep [s], or None if it has no solution."""
        solutions: list[ReferenceSolution] = []
        for integrator in _INTEGRATORS:
            fine = self.solve_at(integrator, timestep / 2, times)
            coarse = fine and self.solve_at(integrator, timestep, times)
            if fine and coarse:
                solutions.append(
                    ReferenceSolution(self, integrator, timestep / 2, times, fine, coarse)
                )
                if solutions[-1].estimate <= fine.prepared.model.stat.extent:
                    break
        return min(solutions, key=lambda reference: reference.estimate, default=None)


@dataclass(frozen=True)
class ReferenceSolution:
    """Two solutions of one model, at timesteps that differ by a factor of 2."""

    family: Family
    integrator: str
    timestep: float  # timestep of the fine solution [s]
    times: Floats  # (T,) times of the states [s]
    fine: Solution  # the reference itself
    coarse: Solution  # its distance from the fine solution estimates the reference's own error

    @cached_property
    def joints(self) -> Joints:
        """The joints of the model."""
        return joints_of(self.fine.prepared.model)

    @cached_property
    def estimate(self) -> float:
        """Largest distance of its two solutions [m]."""
        return self.state_distance(self.coarse.sampled).peak

    def rows_at(self, times: Floats) -> NDArray[np.intp]:
        """Return the rows of the reference at some of its times."""
        return np.searchsorted(self.times, times)

    def state_distance(self, sampled: SampledStates, rows: Rows = slice(None)) -> Discrepancy:
        """Return the distance of sampled states from the reference's at these rows [m]."""
        return Discrepancy.of_distances(
            trajectory_distances(self.joints, sampled.qpos, self.fine.sampled.qpos[rows])
        )

    def velocity_distance(self, sampled: SampledStates, rows: Rows) -> float:
        """Return the mean over time of the distance of velocities from the reference's [m/s].

        At each time it is the largest difference of a degree of freedom, times its length.
        """
        difference = np.abs(sampled.qvel - self.fine.sampled.qvel[rows])
        return float(
            (difference * self.fine.prepared.model.dof_length).max(axis=1, initial=0.0).mean()
        )

    def invariant_drift(self, sampled: SampledStates, rows: Rows = slice(None)) -> Discrepancy:
        """Return the relative deviation of energy and momenta from the reference at these rows."""
        expected, model = self.fine.sampled, self.fine.prepared.model
        free = self.family.scene.base_of(self.family.model).free
        both = (sampled.qpos, sampled.qvel), (expected.qpos[rows], expected.qvel[rows])
        return Discrepancy.of_distances(
            invariant_drifts(*(state_invariants(model, *side, free=free) for side in both))
        )

    def local_error(
        self, prepared: PreparedModel, begins: Floats, ends: Floats
    ) -> Discrepancy | None:
        """Return the distance of a model from the reference when restarted from its states [m].

        It begins at K times [s], and is compared at K ends [s]; None if a restart fails.
        """
        states = self.fine.sampled.states[self.rows_at(begins)]
        restarts = [
            self.family.integrate_model(prepared, end, begin=begin, state=state)
            for begin, end, state in zip(begins.tolist(), ends[:, None], states, strict=True)
        ]
        qpos = [restart.qpos for restart in restarts if restart is not None]
        if len(qpos) < len(restarts):
            return None
        expected = self.fine.sampled.qpos[self.rows_at(ends)]
        return Discrepancy.of_distances(
            trajectory_distances(self.joints, np.concatenate(qpos), expected)
        )

    def chaos_divergence(self) -> float | None:
        """Return the distance of a start perturbed by 1e-8 from the coarse solution [m].

        It is solved at the timestep of the coarse solution, not at those of the runs: there any
        perturbation may move an impact to another step, which changes the motion after it, though
        by less than the runs' own errors.
        """
        run = self.family.run
        start = perturbed_copy(run.start, self.joints, run.run.seed)
        perturbed = self.family.solve_at(self.integrator, 2 * self.timestep, self.times, start)
        if perturbed is None:
            return None
        qpos = self.coarse.sampled.qpos
        return Discrepancy.of_distances(
            trajectory_distances(self.joints, perturbed.sampled.qpos, qpos)
        ).peak


def state_invariants(
    model: mujoco.MjModel, qpos: Floats, qvel: Floats, *, free: bool
) -> Invariants:
    """Return energy and momenta of a passive model at T states (T, nq) and (T, nv).

    If no external force acts on it, it is free, so momenta are conserved as well.
    """
    data = mujoco.MjData(model)
    rows = np.array(
        [_state_invariants(model, data, *state) for state in zip(qpos, qvel, strict=True)]
    )
    mass = float(model.body_subtreemass[0])
    weight = mass * float(np.linalg.norm(model.opt.gravity)) * read_flag(model, "gravity")
    conserved, arm = free and not weight, NEGLIGIBLE_SHARE * float(model.stat.meansize)
    return Invariants(
        energy=rows[:, 0] + rows[:, 1],
        kinetic=rows[:, 1],
        momentum=mass * rows[:, 2:5] if conserved else None,
        angular_momentum=rows[:, 5:8] if conserved else None,
        mass=mass,
        lift=weight * arm,
        arm=arm,
    )


def _state_invariants(
    model: mujoco.MjModel, data: mujoco.MjData, qpos: Floats, qvel: Floats
) -> Floats:
    """Return (8,) potential and kinetic energy, velocity of the center of mass, ang. momentum."""
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    mujoco.mj_energyPos(model, data)
    mujoco.mj_energyVel(model, data)
    mujoco.mj_subtreeVel(model, data)
    return np.concatenate([data.energy, data.subtree_linvel[0], data.subtree_angmom[0]])
