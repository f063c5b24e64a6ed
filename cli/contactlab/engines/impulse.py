"""The impulse engine: a point mass above a plane, in free flight but for impulses at the plane.

A baseline without contact model for the same scenes: it fills the same arrays as MuJoCo, so that
both are measured, labelled and compared alike. Flight is semi-implicit like MuJoCo's Euler; an
impact happens within its step, when the gap closes, and shows as a force of impulse / timestep in
that step's row.
"""

import time
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.contact import (
    DISTANCE,
    FORCE,
    FOUND,
    LINEAR_VELOCITY,
    NORMAL,
    POSITION,
    SLOT_WIDTH,
    TANGENT,
    Floats,
    damping_ratio,
    resolve_impact,
    restitution_of,
)
from contactlab.engines.engine import (
    Buffers,
    PreparedRuns,
    Proceed,
    Rollout,
    RolloutArrays,
    SimulationEngine,
    Watch,
    no_limit,
    package_version,
    proceed_always,
)
from contactlab.errors import SceneError
from contactlab.scene import CompiledScene, InitialStates, PreparedModel, ResolvedRun, Scene

_GEOM = mujoco.mjtGeom
_NO_FORCES = "the impulse engine knows no forces but gravity; use engine: mujoco"
_NEEDS = (
    "the impulse engine moves one sphere, on a free joint or on slides along orthogonal axes, "
    "against one plane; use such a scene, or engine: mujoco"
)


@dataclass(frozen=True)
class _Mass:
    """The point mass of a model and the plane below it.

    Attributes:
        axes: (3, nv) velocity of the body for each unit joint velocity.
        origin: (3,) place of the body where its coordinates are 0 [m].
        weight: mass [kg].
        radius: of the sphere [m].
        point: (3,) a point of the plane [m].
        normal: (3,) of the plane.
        gravity: (3,) [m/s^2].
        timestep: [s].
        restitution: ratio of rebound to approach speed.
        friction: sliding friction.
    """

    axes: Floats
    origin: Floats
    weight: float
    radius: float
    point: Floats
    normal: Floats
    gravity: Floats
    timestep: float
    restitution: float
    friction: float


@dataclass(frozen=True)
class _Step:
    """Where a step ends: place [m] and velocity [m/s], and the impulse within it [N s], if any."""

    place: Floats
    velocity: Floats
    impulse: Floats


class ImpulseEngine(SimulationEngine):
    """Newton's restitution and Coulomb friction, as impulses on one sphere above one plane."""

    name = "impulse"
    summary = "the impulse law for a sphere above a plane"

    @property
    def version(self) -> str:
        """The version of contactlab."""
        return package_version("contactlab")

    def refusal(self, scene: Scene, run: ResolvedRun) -> str | None:
        """Return why it cannot simulate a run: other geoms or joints, or external forces."""
        base = scene.base_of(run)
        try:
            _require_gravity_alone(scene.starts([run]))
            _mass_of(base, base.prepare(run.edits()))
        except SceneError as error:
            return str(error)
        return None

    def roll_out(
        self,
        runs: PreparedRuns,
        buffers: Buffers,
        watch: Watch = no_limit,
        proceed: Proceed = proceed_always,
    ) -> Rollout:
        """Simulate point masses above a plane."""
        _require_gravity_alone(runs.starts)
        count = len(runs.prepared)
        arrays = buffers.arrays(runs.base.model, count, runs.steps)
        arrays.state[:], arrays.sensors[:], arrays.iterations[:] = 0.0, 0.0, 0
        cost = np.zeros(count)
        for run in range(count):
            if run and not proceed():
                count = run
                break
            watch()
            begin = time.thread_time()
            mass = _mass_of(runs.base, runs.prepared[run])
            _fly(runs.base, mass, runs.starts.pick(run), arrays, run)
            cost[run] = time.thread_time() - begin
        return Rollout(
            state=arrays.state[:count],
            sensors=arrays.sensors[:count],
            iterations=arrays.iterations[:count],
            steps=(runs.steps,) * count,
            cost=cost[:count],
            warnings=tuple({} for _ in range(count)),
            errors=(None,) * count,
        )


def _require_gravity_alone(starts: InitialStates) -> None:
    if starts.applied.any() or starts.driven.size:
        raise SceneError(_NO_FORCES)


def _fly(
    base: CompiledScene, mass: _Mass, start: InitialStates, arrays: RolloutArrays, run: int
) -> None:
    """Step one run and record it."""
    state, sensors = arrays.state[run], arrays.sensors[run]
    timestep = mass.timestep
    count = mass.axes.shape[1]
    velocity = 1 + base.model.nq
    place, speed = mass.axes @ start.qpos[0, :count], mass.axes @ start.qvel[0, :count]
    now = _Step(place, speed, np.zeros(3))
    state[:, 1:velocity] = start.qpos[0]
    for step in range(len(sensors)):
        state[step, 0] = step * timestep
        state[step, 1 : 1 + count] = mass.axes.T @ now.place
        state[step, velocity : velocity + count] = mass.axes.T @ now.velocity
        then = _step(mass, now, timestep)
        _record(base, mass, sensors[step], now, then)
        now = then
    state[-1, 0] = len(sensors) * timestep
    state[-1, 1 : 1 + count] = mass.axes.T @ now.place
    state[-1, velocity : velocity + count] = mass.axes.T @ now.velocity


def _step(mass: _Mass, now: _Step, timestep: float) -> _Step:
    """Move for one step; where the gap closes within it, the impulse acts at that moment."""
    place, speed = now.place, now.velocity + timestep * mass.gravity
    gap = (mass.origin + place - mass.point) @ mass.normal - mass.radius
    approach = speed @ mass.normal
    if approach >= 0 or gap + timestep * approach >= 0:
        return _Step(place + timestep * speed, speed, np.zeros(3))
    before = min(max(-gap / approach, 0.0), timestep)
    impact = resolve_impact(mass.weight, speed, mass.normal, mass.restitution, mass.friction)
    after = impact.velocity[0]
    return _Step(place + before * speed + (timestep - before) * after, after, impact.impulse[0])


def _record(base: CompiledScene, mass: _Mass, row: Floats, now: _Step, step: _Step) -> None:
    """Fill a sensor row: the state before a step, and the impulse within it."""
    layout = base.layout
    if layout.kinetic is not None:
        row[layout.kinetic] = 0.5 * mass.weight * now.velocity @ now.velocity
    if layout.potential is not None:
        row[layout.potential] = -mass.weight * mass.gravity @ (mass.origin + now.place)
    if not step.impulse.any():
        return
    tangent = _tangent(mass.normal)
    frame = np.stack([mass.normal, tangent, np.cross(mass.normal, tangent)])
    slot = row[layout.pairs[0] : layout.pairs[0] + SLOT_WIDTH]
    slot[FOUND] = row[layout.contacts] = 1
    slot[FORCE] = frame @ step.impulse / mass.timestep
    slot[DISTANCE] = 0.0
    slot[POSITION] = mass.origin + now.place - mass.radius * mass.normal
    slot[NORMAL], slot[TANGENT] = mass.normal, tangent
    slot[LINEAR_VELOCITY] = frame @ now.velocity


def _tangent(normal: Floats) -> Floats:
    across = np.asarray(np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))]), np.float64)
    return across / np.linalg.norm(across)


def _mass_of(base: CompiledScene, prepared: PreparedModel) -> _Mass:
    model = prepared.model
    plane, sphere = _plane_and_sphere(base, model)
    data = mujoco.MjData(model)
    data.qpos[:] = 0
    axes = _axes(model, int(model.geom_bodyid[sphere]))
    if model.jnt_type[0] == int(mujoco.mjtJoint.mjJNT_FREE):
        data.qpos[3] = 1
    mujoco.mj_kinematics(model, data)
    record = next(iter(prepared.pairs.values()))
    return _Mass(
        axes=axes,
        origin=np.array(data.geom_xpos[sphere]),
        weight=float(model.body_mass[model.geom_bodyid[sphere]]),
        radius=float(model.geom_size[sphere, 0]),
        point=np.array(data.geom_xpos[plane]),
        normal=np.array(data.geom_xmat[plane]).reshape(3, 3)[:, 2],
        gravity=np.array(model.opt.gravity),
        timestep=float(model.opt.timestep),
        restitution=float(restitution_of(damping_ratio(record.solref))),
        friction=record.friction[0],
    )


def _plane_and_sphere(base: CompiledScene, model: mujoco.MjModel) -> tuple[int, int]:
    kinds = {int(_GEOM.mjGEOM_PLANE): 0, int(_GEOM.mjGEOM_SPHERE): 1}
    if len(base.pairs) != 1 or base.pairs[0].bodies:
        raise SceneError(_NEEDS)
    geoms = [side[0] for side in base.pairs[0].geoms]
    found = sorted(geoms, key=lambda geom: kinds.get(int(model.geom_type[geom]), 2))
    if [kinds.get(int(model.geom_type[geom])) for geom in found] != [0, 1]:
        raise SceneError(_NEEDS)
    return found[0], found[1]


def _axes(model: mujoco.MjModel, body: int) -> Floats:
    """Return how the body moves with its joints, which must be its only ones."""
    joints = list(range(model.njnt))
    if model.body_parentid[body] != 0 or any(model.jnt_bodyid[joint] != body for joint in joints):
        raise SceneError(_NEEDS)
    kinds = {int(model.jnt_type[joint]) for joint in joints}
    if kinds == {int(mujoco.mjtJoint.mjJNT_FREE)}:
        return np.eye(3)
    axes = np.array([model.jnt_axis[joint] for joint in joints]).T
    straight = kinds == {int(mujoco.mjtJoint.mjJNT_SLIDE)}
    if not straight or not np.allclose(axes.T @ axes, np.eye(len(joints)), atol=1e-9):
        raise SceneError(_NEEDS)
    return axes
