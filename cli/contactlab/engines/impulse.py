"""The impulse engine: a point mass above a plane, in free flight except for impulses at the plane.

A baseline without contact model for the same scenes: it fills the same arrays as MuJoCo, so that
both are measured, labeled and compared alike. Flight is semi-implicit like MuJoCo's Euler; an
impact happens within its step, when the gap closes, and shows as a force of impulse / timestep in
that step's row.
"""

import time
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.contact.contact_laws import damping_ratio, resolve_impact, restitution_from_damping
from contactlab.contact.trace_arrays import (
    DISTANCE,
    FORCE,
    FOUND,
    LINEAR_VELOCITY,
    NORMAL,
    POSITION,
    SLOT_WIDTH,
    TANGENT,
    Floats,
)
from contactlab.engines.engine import (
    Buffers,
    PreparedRuns,
    Proceed,
    Rollout,
    RolloutArrays,
    SimulationEngine,
    Watch,
    engine,
    no_limit,
    package_version,
    proceed_always,
)
from contactlab.errors import SceneError
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.scene.compiled_scene import CompiledScene, PreparedModel
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene

_FREE_JOINT, _SLIDE_JOINT = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_PLANE_TYPE, _SPHERE_TYPE = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_SPHERE)
_REQUIREMENTS_TEXT = (
    "the impulse engine moves one sphere, on a free joint or on slides along orthogonal axes, "
    "against one plane; use such a scene, or engine: mujoco"
)


@dataclass(frozen=True)
class _PointMass:
    """The point mass of a model and the plane below it, in SI units."""

    axes: Floats  # (3, nv) velocity of the body for each unit joint velocity
    origin: Floats  # (3,) position of the sphere at zero coordinates
    mass: float
    radius: float
    point: Floats  # (3,) a point of the plane
    frame: Floats  # (3, 3) normal of the plane, and two tangents
    gravity: Floats  # (3,)
    timestep: float
    restitution: float  # ratio of rebound to approach speed
    friction: float


class _StepState(NamedTuple):
    """Position [m] and velocity [m/s] at the end of a step, and the impulse within it [N s]."""

    position: Floats
    velocity: Floats
    impulse: Floats


@engine
class ImpulseEngine(SimulationEngine):
    """Newton's restitution and Coulomb friction, as impulses on one sphere above one plane."""

    name = "impulse"
    summary = "the impulse law for a sphere above a plane"

    @property
    def version(self) -> str:
        """The version of contactlab."""
        return package_version("contactlab")

    def refusal(self, scene: Scene, run: RunSpec) -> str | None:
        """Return why it cannot simulate a run: other geoms or joints, or external forces."""
        base = scene.base_of(run)
        try:
            _require_gravity_alone(scene.initial_states([run]))
            _find_point_mass(base, base.prepare(run.list_edits()))
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
        cost: list[float] = []
        for run in range(count):
            if run and not proceed():
                break
            watch()
            begin = time.thread_time()
            ball = _find_point_mass(runs.base, runs.prepared[run])
            _simulate_run(runs.base, ball, runs.starts.select_run(run), arrays, run)
            cost.append(time.thread_time() - begin)
        return Rollout.completed(arrays, np.array(cost))


def _require_gravity_alone(starts: InitialStates) -> None:
    if starts.applied.any() or starts.driven_inputs.size:
        raise SceneError("the impulse engine has no forces except gravity; use engine: mujoco")


def _simulate_run(
    base: CompiledScene, ball: _PointMass, start: InitialStates, arrays: RolloutArrays, run: int
) -> None:
    state, sensors = arrays.state[run], arrays.sensors[run]
    count, first = ball.axes.shape[1], 1 + base.model.nq
    position, velocity = ball.axes @ start.qpos[0, :count], ball.axes @ start.qvel[0, :count]
    now = _StepState(position, velocity, np.zeros(3))
    state[:, 1:first] = start.qpos[0]
    for step in range(len(state)):
        state[step, 0] = step * ball.timestep
        state[step, 1 : 1 + count] = ball.axes.T @ now.position
        state[step, first : first + count] = ball.axes.T @ now.velocity
        if step < len(sensors):
            # If the gap closes within the step, the impulse acts at that moment.
            timestep, position, normal = ball.timestep, now.position, ball.frame[0]
            velocity = now.velocity + timestep * ball.gravity
            gap = (ball.origin + position - ball.point) @ normal - ball.radius
            approach = velocity @ normal
            if approach >= 0 or gap + timestep * approach >= 0:
                then = _StepState(position + timestep * velocity, velocity, np.zeros(3))
            else:
                before = min(max(-gap / approach, 0.0), timestep)
                impulse = resolve_impact(
                    ball.mass, velocity, normal, ball.restitution, ball.friction
                )
                after = velocity + impulse / ball.mass
                position = position + before * velocity + (timestep - before) * after
                then = _StepState(position, after, impulse)
            # The sensors have the state before the step, and the impulse within it.
            row, layout = sensors[step], base.layout
            if layout.kinetic is not None:
                row[layout.kinetic] = 0.5 * ball.mass * now.velocity @ now.velocity
            if layout.potential is not None:
                row[layout.potential] = -ball.mass * ball.gravity @ (ball.origin + now.position)
            if then.impulse.any():
                slot = row[layout.pairs[0] : layout.pairs[0] + SLOT_WIDTH]
                slot[FOUND] = row[layout.contacts] = 1
                slot[FORCE] = ball.frame @ then.impulse / ball.timestep
                slot[DISTANCE] = 0.0
                slot[POSITION] = ball.origin + now.position - ball.radius * ball.frame[0]
                slot[NORMAL], slot[TANGENT] = ball.frame[:2]
                slot[LINEAR_VELOCITY] = ball.frame @ now.velocity
            now = then


def _find_point_mass(base: CompiledScene, prepared: PreparedModel) -> _PointMass:
    model = prepared.model
    geoms = [side[0] for side in base.pairs[0].geoms] if len(base.pairs) == 1 else []
    geom_of_type = {int(model.geom_type[geom]): geom for geom in geoms}
    if geom_of_type.keys() != {_PLANE_TYPE, _SPHERE_TYPE} or base.pairs[0].bodies:
        raise SceneError(_REQUIREMENTS_TEXT)
    plane, sphere = geom_of_type[_PLANE_TYPE], geom_of_type[_SPHERE_TYPE]
    data = mujoco.MjData(model)
    data.qpos[:] = 0
    # The body's velocity for each unit joint velocity; the model has no other joints.
    body = int(model.geom_bodyid[sphere])
    if model.body_parentid[body] != 0 or (model.jnt_bodyid != body).any():
        raise SceneError(_REQUIREMENTS_TEXT)
    kinds, axes = set(model.jnt_type.tolist()), np.array(model.jnt_axis.T)
    if kinds == {_FREE_JOINT}:
        axes = np.eye(3)
    elif kinds != {_SLIDE_JOINT} or not np.allclose(
        axes.T @ axes, np.eye(model.njnt), atol=SUM_ROUNDING
    ):
        raise SceneError(_REQUIREMENTS_TEXT)
    if model.jnt_type[0] == _FREE_JOINT:
        data.qpos[3] = 1
    mujoco.mj_kinematics(model, data)
    record = next(iter(prepared.pairs.values()))
    normal = np.array(data.geom_xmat[plane]).reshape(3, 3)[:, 2]
    tangent = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    tangent /= np.linalg.norm(tangent)
    return _PointMass(
        axes=axes,
        origin=np.array(data.geom_xpos[sphere]),
        mass=float(model.body_mass[model.geom_bodyid[sphere]]),
        radius=float(model.geom_size[sphere, 0]),
        point=np.array(data.geom_xpos[plane]),
        frame=np.stack([normal, tangent, np.cross(normal, tangent)]),
        gravity=np.array(model.opt.gravity),
        timestep=float(model.opt.timestep),
        restitution=float(restitution_from_damping(damping_ratio(record.solref))),
        friction=record.friction[0],
    )
