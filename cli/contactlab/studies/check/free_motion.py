"""Check 2: is the energy of each kinematic tree conserved where only springs and inertia act."""

import copy
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.judge.limits import PERCENT_PER_SECOND, Limit, informative
from contactlab.schema.check_report import CheckResult, Measure
from contactlab.store.mcap.trace_reader import StoredTrace
from contactlab.studies.check.check_entries import Measured, check, remedy
from contactlab.studies.check.check_runs import CheckRun
from contactlab.studies.check.checked_model import CheckedModel
from contactlab.studies.check.inertia import judged_inertias
from contactlab.studies.session import Values

NAME = "free_motion"
_ASKS = "in free motion, the energy of each kinematic tree drifts by at most 0.1 % a second"
_SECONDS, _TIMEOUT = 5.0, 300.0
_SPEED = 2.5  # speed of every joint at the start [rad/s]: that of a brisk motion of a robot
_BEST = "RK4"  # the integrator of the highest order
_OFF = ("contact", "limit", "frictionloss", "equality", "actuation", "damper")
_MEDIUM = ("density", "viscosity")
_SHARES = (1.0, 0.5, 0.25)

_SAMPLE = 0.25  # time at which trajectories are compared [s], before chaos separates them
_LEAST_DIFFERENCE = 1e-12  # difference [m or rad] below which there is only rounding
_STILL = 1e-6  # kinetic energy per mass [J/kg] below which nothing moves: about 1 mm/s
_STATES = 500  # states at which the energy is computed, evenly spaced


@check(
    NAME,
    asks=_ASKS,
    place=2,
    limits=(
        Limit("energy_gain", "1/s", "gate", 1e-2, shown=PERCENT_PER_SECOND),
        Limit("energy_drift", "1/s", "warn", 1e-3, shown=PERCENT_PER_SECOND),
    ),
    findings=("inertia_not_positive", "inertia_triangle", "inertia_balanced"),
)
def check_free_motion(checked: CheckedModel) -> Measured:
    """Run the model with nothing but springs and inertia, and compare the energy of each tree.

    A drift is the change of a tree's energy per its peak kinetic energy and time. The gain is that
    of the model with its own damping.
    """
    impossible, notes = judged_inertias(checked)
    if reason := _why_not_applicable(checked):
        return Measured(impossible, [reason, *notes])
    free, kept = _free_motions(checked)
    stores = checked.stores(NAME)
    if free[0].run.is_complete and not free[0].budgets:
        reason = "nothing moves: no joint can be set in motion"
        return Measured([], [reason, *notes], stores)
    measures = [*_drifts(checked, free), *_gains(checked, free[0], kept), *_orders(free)]
    notes = [_switched_off(checked), *notes]
    return Measured([*measures, *impossible], notes, stores)


def _why_not_applicable(checked: CheckedModel) -> str:
    """Return why energy in free motion cannot be judged; empty if it can."""
    model = checked.base.model
    if not model.nv:
        return "the model has nothing that moves"
    if model.nplugin:
        return "plugins act on the model, and their work is not known"
    if np.any(checked.scene.starts([checked.resolved]).applied):
        return "the scene pushes its bodies with forces from outside, which do work"
    return ""


def _drifts(checked: CheckedModel, free: Sequence["FreeMotion"]) -> Iterator[Measure]:
    nominal, *others = free
    if not nominal.budgets:
        yield checked.measure("energy_drift", math.inf, nominal.name)
    for tree, budget in nominal.budgets.items():
        name = nominal.name_of(tree)
        yield checked.measure("energy_drift", abs(budget.rate(budget.peak)), name)
        yield informative("energy_deviation_max", budget.most / budget.peak, "1", name)
    for motion, tree in product(others, nominal.budgets):
        found = motion.budgets.get(tree)
        drift = abs(found.rate(found.peak)) if found else math.inf
        yield informative("energy_drift", drift, "1/s", nominal.name_of(tree, motion.name))


def _gains(checked: CheckedModel, nominal: "FreeMotion", kept: "FreeMotion") -> Iterator[Measure]:
    """Yield the gain with the model's own damping, per free kinetic energy."""
    if not kept.budgets:
        yield checked.measure("energy_gain", math.inf, kept.name)
    for tree, budget in kept.budgets.items():
        peak = nominal.budgets.get(tree, budget).peak
        name = kept.name_of(tree, kept.name + (", damping on" if kept.damped else ""))
        yield checked.measure("energy_gain", budget.rate(peak), name)


def _orders(free: Sequence["FreeMotion"]) -> Iterator[Measure]:
    for integrator in dict.fromkeys(motion.integrator for motion in free):
        same = [motion for motion in free if motion.integrator == integrator and motion.budgets]
        if len(same) == len(_SHARES):
            order = convergence_order(*(motion.run.trace for motion in same))
            yield informative("convergence_order", order, "1", integrator)


@remedy("energy_gain", "energy_drift")
def steadier(checked: CheckedModel, result: CheckResult) -> Iterator[Values]:
    """Yield integrators and timesteps, the cheapest first, but those that are known to miss.

    No integrator mends an inertia that no body can have.
    """
    drifts = [measure for measure in result.measures if measure.name == "energy_drift"]
    limit = next((drift.limit for drift in drifts if drift.limit is not None), math.inf)
    own, timestep = str(checked.resolved.settings["integrator"]), checked.resolved.timestep
    if any(measure.name.startswith("inertia") for measure in result.measures):
        return
    for integrator, share in ((own, 2), (_BEST, 1), (own, 4), (_BEST, 2)):
        name = _motion_name(integrator, timestep / share)
        found = [drift.value for drift in drifts if (drift.of or "").endswith(name)]
        if all(value is not None and value <= limit for value in found):
            step = {} if share == 1 else {"timestep": timestep / share}
            yield step if integrator == own else {"integrator": integrator, **step}


def _free_motions(checked: CheckedModel) -> tuple[list["FreeMotion"], "FreeMotion"]:
    """Run the free motion with the model's integrator and RK4, at three timesteps each.

    Return the runs, of which the first has the model's settings, as all have of a brief model; and
    one that keeps the model's damping, the first if there is none.
    """
    own, timestep = str(checked.resolved.settings["integrator"]), checked.resolved.timestep
    motions = [
        (integrator, timestep * share)
        for integrator in dict.fromkeys((own, _BEST))
        for share in _SHARES
        if share == 1 or checked.fits(timestep * share, _SECONDS)
    ]
    free = _free_settings(checked)
    rows: list[Values] = [
        {**free, "integrator": integrator, "timestep": step}
        for integrator, step in (motions[:1] if checked.brief else motions)
    ]
    damped = _is_damped(checked)
    if damped:
        off = {name: value for name, value in free.items() if name not in {*_MEDIUM, "damper"}}
        rows.append({**off, "integrator": own, "timestep": timestep})
    text = "Free motion: contacts, limits and all that gives or takes energy are off"
    runs = checked.run(
        NAME, text, rows, duration=_SECONDS, checks="none", timeout=_TIMEOUT, drive="none"
    )
    kept = FreeMotion(runs.pop(), damped=True) if damped else None
    undamped = [FreeMotion(run, damped=False) for run in runs]
    return undamped, kept or undamped[0]


def _free_settings(checked: CheckedModel) -> dict[str, object]:
    """Return what free motion starts with, what it switches off and what it sets to zero."""
    model = checked.base.model
    values: dict[str, object] = {**dict.fromkeys(_OFF, False), "joint_speed": _SPEED}
    values |= dict.fromkeys(_media(checked), 0.0)
    values |= {"gravity": 0.0} if falls(checked.prepared.model) else {}
    compensated = np.flatnonzero(model.body_gravcomp)
    return values | {f"body_gravcomp[{model.body(index).name}]": 0.0 for index in compensated}


def _switched_off(checked: CheckedModel) -> str:
    """Return in words what acts in free motion, and what does not."""
    off = [*_OFF, *_media(checked)]
    gravity = "gravity too, since it floats" if falls(checked.prepared.model) else "gravity acts"
    return f"every joint starts at {_SPEED:g} rad/s, either way; off: {', '.join(off)}; {gravity}"


def _is_damped(checked: CheckedModel) -> bool:
    """Say whether joints, tendons or the medium dissipate energy."""
    model = checked.prepared.model
    viscous = model.dof_damping.any() or model.tendon_damping.any()
    return bool(_media(checked) or (viscous and checked.resolved.flags["damper"]))


def _media(checked: CheckedModel) -> list[str]:
    """Return the settings by which a medium acts on the model."""
    return [name for name in _MEDIUM if checked.resolved.settings[name]]


def falls(model: mujoco.MjModel) -> bool:
    """Say whether a tree would just fall: its root is free, or on a slide along gravity."""
    trees, gravity = np.asarray(model.body_treeid), np.array(model.opt.gravity)
    roots = (trees != trees[model.body_parentid])[model.jnt_bodyid]
    steep = np.abs(model.jnt_axis @ gravity) > 0.1 * np.linalg.norm(gravity)
    sprung = model.jnt_stiffness.reshape(model.njnt, -1).any(axis=1)
    slides = (model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE) & steep & ~sprung
    return bool((roots & (slides | (model.jnt_type == mujoco.mjtJoint.mjJNT_FREE))).any())


def _motion_name(integrator: str, timestep: float) -> str:
    return f"{integrator} at {timestep * 1e3:g} ms"


@dataclass(frozen=True)
class FreeMotion:
    """A run of the model in free motion, with the model's own damping or without any."""

    run: CheckRun
    damped: bool

    @property
    def integrator(self) -> str:
        """Its integrator."""
        return str(self.run.resolved.settings["integrator"])

    @property
    def name(self) -> str:
        """The integrator and the timestep, as text."""
        return _motion_name(self.integrator, self.run.resolved.timestep)

    def name_of(self, tree: str, what: str | None = None) -> str:
        """Return the name of a motion, or its own, after that of the tree where it has several."""
        what = what or self.name
        return what if len(self.budgets) == 1 else f"{tree}, {what}"

    @cached_property
    def budgets(self) -> dict[str, "EnergyBudget"]:
        """The energy budget of each tree that moves, by its name; none if it is incomplete."""
        if not self.run.is_complete:
            return {}
        model, trace = self.run.model, self.run.trace
        trees = trees_of(model)
        rows = np.unique(np.linspace(0, len(trace.qpos) - 1, _STATES).astype(int))
        energies = tree_energies(model, trees, trace.qpos[rows], trace.qvel[rows])
        budgets: dict[str, EnergyBudget] = {}
        for tree, kinetic, potential in zip(trees, *energies, strict=True):
            budget = energy_budget(float(trace.time[-1] - trace.time[0]), kinetic, potential)
            if budget.peak > _STILL * tree.mass:
                budgets[tree.name] = budget
        return budgets


class Tree(NamedTuple):
    """Bodies that move together, and no others with them."""

    name: str  # of its root body
    dofs: NDArray[np.bool_]  # (nv,) whether each degree of freedom is its
    bodies: NDArray[np.bool_]  # (nbody,) whether each body is its
    mass: float  # of its bodies [kg]


def trees_of(model: mujoco.MjModel) -> list[Tree]:
    """Return the kinematic trees of a model; one if tendons with stiffness couple them."""
    dofs, bodies = np.array(model.dof_treeid), np.array(model.body_treeid)
    if model.ntree > 1 and model.tendon_stiffness.any():
        dofs, bodies = np.minimum(dofs, 0), np.minimum(bodies, 0)
    trees: list[Tree] = []
    for number in np.unique(dofs):
        own = bodies == number
        name = model.body(int(own.argmax())).name
        trees.append(Tree(name, dofs == number, own, float(model.body_mass[own].sum())))
    return trees


def tree_energies(
    model: mujoco.MjModel, trees: Sequence[Tree], qpos: Floats, qvel: Floats
) -> tuple[Floats, Floats]:
    """Return the kinetic and the potential energy of each tree [J], (T, N) each.

    The mass matrix does not couple trees, so that a tree's kinetic energy is v' M v / 2 of its own
    velocities. Its potential energy is that of a model where only its bodies have weight and only
    its joints have springs. Configurations are (N, nq), velocities (N, nv).
    """
    data = mujoco.MjData(model)
    alone = [_alone(model, tree) for tree in trees] if len(trees) > 1 else [model]
    kinetic, potential = np.zeros((2, len(trees), len(qpos)))
    product = np.zeros(model.nv)
    for row, (position, velocity) in enumerate(zip(qpos, qvel, strict=True)):
        data.qpos[:], data.qvel[:] = position, velocity
        mujoco.mj_fwdPosition(model, data)
        for place, (tree, own) in enumerate(zip(trees, alone, strict=True)):
            moving = velocity * tree.dofs
            mujoco.mj_mulM(model, data, product, moving)
            kinetic[place, row] = moving @ product / 2
            mujoco.mj_energyPos(own, data)
            potential[place, row] = data.energy[0]
    return kinetic, potential


def _alone(model: mujoco.MjModel, tree: Tree) -> mujoco.MjModel:
    own = copy.copy(model)
    own.body_mass[~tree.bodies] = 0
    own.jnt_stiffness[~tree.bodies[model.jnt_bodyid]] = 0
    return own


class EnergyBudget(NamedTuple):
    """The energy budget of one motion."""

    seconds: float  # its duration [s]
    change: float  # mechanical energy at the end minus that at the start [J]
    most: float  # largest deviation of the energy from that at the start [J]
    peak: float  # largest kinetic energy [J]

    def rate(self, peak: float) -> float:
        """Return the change of energy per peak kinetic energy [J] and time, in 1/s."""
        return self.change / peak / self.seconds


def energy_budget(seconds: float, kinetic: Floats, potential: Floats) -> EnergyBudget:
    """Return the budget of energies (T,) [J] at some times, the first and the last among them."""
    energy = kinetic + potential
    return EnergyBudget(
        seconds=seconds,
        change=float(energy[-1] - energy[0]),
        most=float(np.abs(energy - energy[0]).max()),
        peak=float(kinetic.max()),
    )


def convergence_order(coarse: StoredTrace, middle: StoredTrace, fine: StoredTrace) -> float:
    """Return the order p of an error of h^p, by the ratio of Richardson extrapolation.

    Of runs at timesteps h, h/2 and h/4 that is ``log2(|q(h) - q(h/2)| / |q(h/2) - q(h/4)|)`` with
    the largest difference of a coordinate a quarter of a second after the start; NaN where there is
    no difference but rounding.
    """
    step = max(1, round(_SAMPLE / float(coarse.time[1] - coarse.time[0])))
    step = min(step, len(coarse.qpos) - 1)
    places = coarse.qpos[step], middle.qpos[2 * step], fine.qpos[4 * step]
    first, second = (float(np.abs(one - two).max()) for one, two in pairwise(places))
    return math.log2(first / second) if min(first, second) > _LEAST_DIFFERENCE else math.nan
