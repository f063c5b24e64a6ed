"""Pinocchio's rigid-body dynamics, in free motion."""

import time
from collections.abc import Callable
from pathlib import Path
from runpy import run_path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np

PACKAGE = "pin"
REQUIREMENTS = ("pin>=4.1,<5", "mujoco=={mujoco}", "numpy")
_JOINTS, _ARRIVALS = (
    SimpleNamespace(**run_path(str(Path(__file__).parent / "beside" / name)))
    for name in ("joints.py", "arrivals.py")
)
_FREE, _BALL, _SLIDE, _OFF = _JOINTS.FREE, _JOINTS.BALL, _JOINTS.SLIDE, _JOINTS.OFF


def refusal(model: mujoco.MjModel) -> str | None:
    """Return why it cannot simulate a model; None if it can."""
    return next((why for applies, why in _refusals(model) if applies), None)


def _refusals(model: mujoco.MjModel) -> list[tuple[Any, str]]:
    """Return what it cannot do, each with whether a model needs it."""
    disabled, off = model.opt.disableflags, _OFF.mjDSBL_CONSTRAINT
    return [
        (
            model.opt.integrator != mujoco.mjtIntegrator.mjINT_EULER,
            "it integrates as MuJoCo's Euler does; set integrator to Euler",
        ),
        (
            not disabled & (_OFF.mjDSBL_CONTACT | off) and may_collide(model),
            "it knows no contact here; set contact to false",
        ),
        (
            not disabled & (_OFF.mjDSBL_FRICTIONLOSS | off) and model.dof_frictionloss.any(),
            "it knows no dry friction of joints here; set frictionloss to false",
        ),
        *_JOINTS.refusals(model),
    ]


def may_collide(model: mujoco.MjModel) -> bool:
    """Return whether any two geoms may touch."""
    bits = np.bitwise_or.reduce(model.geom_contype) & np.bitwise_or.reduce(model.geom_conaffinity)
    return bool(bits) or model.npair > 0


def simulate(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    """Simulate runs one after the other."""
    import serve

    return {name: np.array(rows) for name, rows in serve.of_each(request, _run, tick).items()}


def forward(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    """Tell what Pinocchio computes of the starts before it steps."""
    import serve

    return serve.of_each(request, _forward, tick)


def _forward(request: dict[str, Any], run: int, tick: Callable[[], None]) -> dict[str, Any]:
    import pinocchio
    import serve

    model = serve.model_of(request, run)
    dynamics = _Dynamics(pinocchio, model)
    control = serve.inputs_of(request, run, model)[0][0]
    qpos, qvel = request["qpos"][run], request["qvel"][run]
    inertia, bias = dynamics.of(qpos, qvel)
    force = _JOINTS.joint_forces(model, qpos, qvel, control) - dynamics.damping * qvel - bias
    tick()
    return {"qfrc_bias": bias, "qacc_smooth": np.linalg.solve(inertia, force)}


class _Dynamics:
    """The inertia of a model, with armatures, and the forces of its motion and of gravity."""

    def __init__(self, pinocchio: Any, model: mujoco.MjModel) -> None:
        self._pinocchio, self._model, self._twin = pinocchio, model, _twin(pinocchio, model)
        self._data = self._twin.createData()
        off = model.opt.disableflags & _OFF.mjDSBL_DAMPER
        self.damping = np.zeros(model.nv) if off else model.dof_damping.copy()
        _ARRIVALS.check_dynamics(model, self.of)

    def of(self, qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        own = _coordinates(self._model, qpos)
        inertia = self._pinocchio.crba(self._twin, self._data, own)
        bias = self._pinocchio.nonLinearEffects(self._twin, self._data, own, qvel)
        whole = np.triu(inertia) + np.triu(inertia, 1).T + np.diag(self._model.dof_armature)
        return whole, bias


def _run(request: dict[str, Any], run: int, tick: Callable[[], None]) -> dict[str, Any]:
    import pinocchio
    import serve

    model = serve.model_of(request, run)
    controls, forces, _ = serve.inputs_of(request, run, model)
    if forces.any():
        raise NotImplementedError("no forces are applied to bodies here; drive by actuators")
    dynamics, step = _Dynamics(pinocchio, model), model.opt.timestep
    qpos, qvel = request["qpos"][run].copy(), request["qvel"][run].copy()
    explicit = bool(model.opt.disableflags & _OFF.mjDSBL_EULERDAMP)
    implicit = step * dynamics.damping * (not explicit)
    states, begin = [np.concatenate([qpos, qvel])], time.process_time()
    for control in controls:
        inertia, bias = dynamics.of(qpos, qvel)
        force = _JOINTS.joint_forces(model, qpos, qvel, control) - dynamics.damping * qvel - bias
        # As MuJoCo's Euler: damping is implicit, velocities come before positions.
        qvel = qvel + step * np.linalg.solve(inertia + np.diag(implicit), force)
        mujoco.mj_integratePos(model, qpos, qvel, step)
        states.append(np.concatenate([qpos, qvel]))
    cost = time.process_time() - begin
    tick()
    state = np.array(states)
    sensors = np.zeros((len(controls), model.nsensordata))
    serve.add_energies(model, state, sensors)
    return {"state": state, "sensors": sensors, "cost": cost}


def _twin(pinocchio: Any, model: mujoco.MjModel) -> Any:
    """Return a model of the same bodies and joints, in the same order of coordinates."""
    twin = pinocchio.Model()
    twin.gravity.linear = _JOINTS.gravity_of(model)
    # Of each body: the joint that moves it, and where the body is in that joint's frame.
    carried = {0: (0, pinocchio.SE3.Identity())}
    for body in range(1, model.nbody):
        joint, place = carried[int(model.body_parentid[body])]
        place = place * _pose(pinocchio, model.body_pos[body], model.body_quat[body])
        first = model.body_jntadr[body]
        for each in range(first, first + model.body_jntnum[body]):
            if model.jnt_type[each] == _FREE:
                place = pinocchio.SE3.Identity()
            anchor = pinocchio.SE3(np.eye(3), np.array(model.jnt_pos[each]))
            place = place * anchor
            for kind in _kinds(pinocchio, model, each):
                joint = twin.addJoint(joint, kind, place, f"{each} {twin.njoints}")
                place = pinocchio.SE3.Identity()
            place = anchor.inverse()
        own = _pose(pinocchio, model.body_ipos[body], model.body_iquat[body])
        inertia = pinocchio.Inertia(
            float(model.body_mass[body]), np.zeros(3), np.diag(model.body_inertia[body])
        )
        twin.appendBodyToJoint(joint, inertia, place * own)
        carried[body] = joint, place
    return twin


def _pose(pinocchio: Any, position: np.ndarray, quaternion: np.ndarray) -> Any:
    w, x, y, z = quaternion
    return pinocchio.SE3(pinocchio.Quaternion(w, x, y, z).matrix(), np.array(position))


def _kinds(pinocchio: Any, model: mujoco.MjModel, joint: int) -> list[Any]:
    """Return joints that have a joint's coordinates, one after the other."""
    kind, axis = model.jnt_type[joint], np.array(model.jnt_axis[joint])
    if kind == _FREE:
        slides = [pinocchio.JointModelPrismaticUnaligned(each) for each in np.eye(3)]
        return [*slides, pinocchio.JointModelSpherical()]
    if kind == _BALL:
        return [pinocchio.JointModelSpherical()]
    if kind == _SLIDE:
        return [pinocchio.JointModelPrismaticUnaligned(axis)]
    return [pinocchio.JointModelRevoluteUnaligned(axis)]


def _coordinates(model: mujoco.MjModel, qpos: np.ndarray) -> np.ndarray:
    """Return qpos as Pinocchio has it: from joints' references, scalars of quaternions last."""
    own = qpos.copy()
    for joint, place in enumerate(model.jnt_qposadr):
        kind = model.jnt_type[joint]
        if kind in (_FREE, _BALL):
            start = place + 3 * (kind == _FREE)
            own[start : start + 4] = np.roll(qpos[start : start + 4], -1)
        else:
            own[place] -= model.qpos0[place]
    return own
