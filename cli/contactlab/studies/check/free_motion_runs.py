"""Runs in free motion, where nothing acts but gravity, springs and inertia, and their energy."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.contact.rotations import rotation_matrices
from contactlab.contact.trace_arrays import Floats
from contactlab.scene.setting_values import as_number
from contactlab.store.mcap.stored_trace import StoredTrace
from contactlab.studies.check.checked_model import CheckedModel, CheckRun, CheckRunner
from contactlab.studies.session import Values

_FREE_DOFS = 6


def single_free_bodies(model: mujoco.MjModel) -> tuple[int, ...]:
    """Return the bodies on a free joint that carry no other moving body."""
    joints = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    trees = model.dof_treeid[model.jnt_dofadr[joints]]
    alone = model.tree_dofnum[trees] == _FREE_DOFS
    return tuple(model.jnt_bodyid[joints[alone]].tolist())


def free_body_energy(
    model: mujoco.MjModel, bodies: Sequence[int], qpos: Floats, qvel: Floats
) -> tuple[Floats, Floats]:
    """Return the kinetic and the potential energy of some single free bodies [J], (N,) each.

    Kinetic energy is v' M v / 2 with the body's 6 x 6 inertia M and its velocity v along its own
    axes, where M does not change with the pose.

    Args:
        model: the run's model.
        bodies: single free bodies.
        qpos: (N, nq) configurations.
        qvel: (N, nv) velocities.
    """
    kinetic, potential = np.zeros(len(qpos)), np.zeros(len(qpos))
    for body in bodies:
        joint = int(model.body_jntadr[body])
        place, dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        inertia = _inertia(model, place, dof)
        turn = rotation_matrices(qpos[:, place + 3 : place + 7])
        velocity = qvel[:, dof : dof + 6].copy()
        velocity[:, :3] = np.einsum("nji,nj->ni", turn, velocity[:, :3])
        kinetic += 0.5 * np.einsum("ni,ij,nj->n", velocity, inertia, velocity)
        mass = float(model.body_subtreemass[body])
        centre = qpos[:, place : place + 3] + turn @ (_moment(inertia) / mass)
        potential -= mass * (centre @ np.asarray(model.opt.gravity))
    return kinetic, potential


def _inertia(model: mujoco.MjModel, place: int, dof: int) -> Floats:
    """Return the 6 x 6 inertia of a free joint along its body's axes: linear, then angular."""
    data = mujoco.MjData(model)
    data.qpos[place : place + 7] = [0, 0, 0, 1, 0, 0, 0]
    mujoco.mj_forward(model, data)
    columns = np.zeros((_FREE_DOFS, model.nv))
    units = np.zeros((_FREE_DOFS, model.nv))
    units[np.arange(_FREE_DOFS), dof + np.arange(_FREE_DOFS)] = 1
    for column, unit in zip(columns, units, strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    return columns[:, dof : dof + _FREE_DOFS]


def _moment(inertia: Floats) -> Floats:
    """Return mass times centre of mass [kg m], which couples linear and angular velocity."""
    return np.array([inertia[1, 5], inertia[2, 3], inertia[0, 4]])


_SAMPLE = 0.25
"""Time at which trajectories are compared [s], before chaos separates them."""

_LEAST = 1e-12
"""Difference [m or rad] below which there is only rounding."""


@dataclass(frozen=True)
class EnergyBudget:
    """The energy budget of one motion.

    Attributes:
        seconds: its duration [s].
        change: mechanical energy at the end minus that at the start [J].
        most: largest deviation of the energy from that at the start [J].
        peak: largest kinetic energy [J].
        dampers: energy taken by viscous damping of the joints [J].
    """

    seconds: float
    change: float
    most: float
    peak: float
    dampers: float

    def rate(self, peak: float) -> float:
        """Return the change of energy per peak kinetic energy [J] and time, in 1/s."""
        return self.change / peak / self.seconds

    def unexplained(self, peak: float) -> float:
        """Return the same for the change that damping does not explain, in 1/s."""
        return (self.change + self.dampers) / peak / self.seconds


def energy_budget(
    trace: StoredTrace, damping: Floats, excluded: tuple[Floats, Floats]
) -> EnergyBudget:
    """Return the energy budget of a trace.

    A damper with coefficient b takes the power b qvel^2; it is integrated by the trapezoidal rule,
    whose error is of second order in the timestep.

    Args:
        trace: a run of at least two steps.
        damping: (nv,) viscous coefficient of each degree of freedom.
        excluded: (N + 1,) each, kinetic and potential energy of excluded bodies [J].
    """
    rows = len(trace.kinetic)
    kinetic = trace.kinetic - excluded[0][:rows]
    energy = kinetic + trace.potential - excluded[1][:rows]
    power = (trace.qvel[:rows] ** 2) @ damping
    return EnergyBudget(
        seconds=float(trace.time[rows - 1] - trace.time[0]),
        change=float(energy[-1] - energy[0]),
        most=float(np.abs(energy - energy[0]).max()),
        peak=float(kinetic.max()),
        dampers=float(np.trapezoid(power, trace.time[:rows])),
    )


def convergence_order(coarse: StoredTrace, middle: StoredTrace, fine: StoredTrace) -> float:
    """Return the order p of an error of h^p, by the ratio of Richardson extrapolation.

    Args:
        coarse: a run at timestep h.
        middle: the same at h/2.
        fine: the same at h/4.

    Returns:
        ``log2(|q(h) - q(h/2)| / |q(h/2) - q(h/4)|)`` with the largest difference of a coordinate
        a quarter of a second after the start; NaN where there is no difference but rounding.
    """
    step = max(1, round(_SAMPLE / float(coarse.time[1] - coarse.time[0])))
    step = min(step, len(coarse.qpos) - 1)
    first = _largest_difference(coarse.qpos[step], middle.qpos[2 * step])
    second = _largest_difference(middle.qpos[2 * step], fine.qpos[4 * step])
    if not min(first, second) > _LEAST:
        return math.nan
    return math.log2(first / second)


def _largest_difference(some: Floats, others: Floats) -> float:
    return float(np.abs(some - others).max())


SECONDS = 5.0
BEST = "RK4"
"""The integrator of the highest order."""

_OFF = ("contact", "limit", "frictionloss", "equality", "actuation", "damper")
_MEDIUM = ("density", "viscosity")
_SHARES = (1.0, 0.5, 0.25)
_TIMEOUT = 300.0


@dataclass(frozen=True)
class FreeMotionRun:
    """A run of the model in free motion.

    Attributes:
        tried: its run.
        integrator: the integrator.
        timestep: length of a step [s].
        damped: whether the model's damping was on.
        budget: its energy budget, without bodies that fly freely beside a mechanism; None if it
            is not complete.
    """

    tried: CheckRun
    integrator: str
    timestep: float
    damped: bool
    budget: EnergyBudget | None

    @property
    def drift(self) -> float:
        """Magnitude of the change of energy per peak kinetic energy and time [1/s]."""
        return abs(self.budget.rate(self.budget.peak)) if self.budget else math.inf

    @property
    def name(self) -> str:
        """The integrator and the timestep, as text."""
        return f"{self.integrator} at {self.timestep * 1e3:g} ms"


def why_not_applicable(checked: CheckedModel) -> str:
    """Return why energy in free motion cannot be judged; empty if it can."""
    model = checked.base.model
    if not model.nv:
        return "the model has nothing that moves"
    if model.nplugin:
        return "plugins act on the model, and their work is not known"
    if np.any(checked.start.applied):
        return "the scene pushes its bodies with forces from outside, which do work"
    return ""


def free_motions(runner: CheckRunner, store: str) -> list[FreeMotionRun]:
    """Run the free motion with the model's integrator and RK4, at three timesteps each.

    The first run has the model's settings; the last, if the model has damping, keeps that on.
    """
    checked = runner.checked
    own, timestep = str(checked.settings["integrator"]), checked.resolved.timestep
    rows: list[Values] = [
        {**_free_settings(checked), "integrator": integrator, "timestep": timestep * share}
        for integrator in dict.fromkeys((own, BEST))
        for share in _SHARES
        if share == 1 or checked.fits(timestep * share, SECONDS)
    ]
    undamped = len(rows)
    if is_damped(checked):
        rows.append({**_damped_settings(checked, _MEDIUM, "damper"), "integrator": own})
    runs = runner.run(
        store,
        "Free motion: contacts, limits and all that gives or takes energy are off",
        rows,
        duration=SECONDS,
        checks="none",
        timeout=_TIMEOUT,
    )
    return [_motion(checked, each, damped=row >= undamped) for row, each in enumerate(runs)]


def is_damped(checked: CheckedModel) -> bool:
    """Say whether joints, tendons or the medium dissipate energy."""
    model = checked.prepared.model
    fluid = any(checked.settings[name] for name in _MEDIUM)
    viscous = model.dof_damping.any() or model.tendon_damping.any()
    return bool(fluid or (viscous and checked.resolved.flags["damper"]))


def is_accounted(checked: CheckedModel) -> bool:
    """Say whether all damping is linear in joint velocities, so that its work is known."""
    model = checked.prepared.model
    curved = getattr(model, "dof_dampingpoly", np.zeros(1))
    fluid = any(checked.settings[name] for name in _MEDIUM)
    return not (fluid or model.tendon_damping.any() or np.any(curved))


def _motion(checked: CheckedModel, tried: CheckRun, *, damped: bool) -> FreeMotionRun:
    settings = tried.record.settings
    damping = np.array(checked.prepared.model.dof_damping, dtype=np.float64) * damped
    return FreeMotionRun(
        tried=tried,
        integrator=str(settings["integrator"]),
        timestep=as_number(settings["timestep"]),
        damped=damped,
        budget=energy_budget(tried.trace, damping, _excluded_energy(checked, tried))
        if tried.is_complete
        else None,
    )


def free_flying_bodies(checked: CheckedModel) -> tuple[int, ...]:
    """Return the single free bodies beside a mechanism; none if there is no mechanism."""
    model = checked.prepared.model
    loose = single_free_bodies(model)
    return loose if model.nv > 6 * len(loose) else ()


def _excluded_energy(checked: CheckedModel, tried: CheckRun) -> tuple[Floats, Floats]:
    trace = tried.trace
    return free_body_energy(
        checked.prepared.model, free_flying_bodies(checked), trace.qpos, trace.qvel
    )


def _free_settings(checked: CheckedModel) -> dict[str, object]:
    """Return the effects to switch off and settings to zero for free motion."""
    model = checked.base.model
    values: dict[str, object] = dict.fromkeys(_OFF, False)
    values |= {name: 0.0 for name in _MEDIUM if checked.settings[name]}
    compensated = np.flatnonzero(model.body_gravcomp)
    return values | {f"body_gravcomp[{model.body(index).name}]": 0.0 for index in compensated}


def _damped_settings(
    checked: CheckedModel, medium: tuple[str, ...], switch: str
) -> dict[str, object]:
    return {
        name: value
        for name, value in _free_settings(checked).items()
        if name not in {*medium, switch}
    }
