"""Drake's discrete multibody plant: arms in free motion, balls and boxes in contact."""

import time
from collections.abc import Callable
from pathlib import Path
from runpy import run_path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np

PACKAGE = "drake"
REQUIREMENTS = ("drake>=1.51,<2", "mujoco=={mujoco}", "numpy")
IGNORED = dict.fromkeys(
    ("solimp", "impratio", "cone", "elliptic", "refsafe"), "its contacts are of another law"
) | dict.fromkeys(
    ("solver", "iterations", "tolerance", "jacobian", "noslip", "noslip_iterations", "warmstart",
     "ls_iterations", "ls_tolerance"), "it has a solver of its own",
)  # fmt: skip


_BESIDE = Path(__file__).parent
_FREE_MOTION, _JOINTS, _CONTACTS, _ARRIVALS = (
    SimpleNamespace(**run_path(str(_BESIDE / name)))
    for name in (
        "pinocchio.py",
        "beside/joints.py",
        "beside/drake_contacts.py",
        "beside/arrivals.py",
    )
)


def refusal(model: mujoco.MjModel) -> str | None:
    """Return why it cannot simulate a model; None if it can."""
    if touches(model):
        return _CONTACTS.refusal(model)
    scalar = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    if not np.isin(model.jnt_type, [int(each) for each in scalar]).all():
        return (
            "it turns free and ball joints along the tangent, not the arc; take hinges and slides"
        )
    if (model.body_jntnum > 1).any():
        return "it moves several joints of one body in another order; give each a body of its own"
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_EULERDAMP:
        return "its damping is implicit; leave eulerdamp on"
    return _FREE_MOTION.refusal(model)


def touches(model: mujoco.MjModel) -> bool:
    """Return whether there are contacts: then bodies are free, and what joints move is refused."""
    off = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return not model.opt.disableflags & off and _FREE_MOTION.may_collide(model)


def simulate(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    """Simulate runs one after the other."""
    import serve

    return {name: np.array(rows) for name, rows in serve.of_each(request, _run, tick).items()}


def forward(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    """Tell what Drake computes of the starts before it steps."""
    import serve

    return serve.of_each(request, _forward, tick)


def _run(request: dict[str, Any], run: int, tick: Callable[[], None]) -> dict[str, Any]:
    import serve

    model = serve.model_of(request, run)
    controls, applied, _ = serve.inputs_of(request, run, model)
    pressed = touches(model)
    if applied.any() and not pressed:
        raise NotImplementedError("no forces are applied to bodies here; drive by actuators")
    twin = (_CONTACTS.Contacts if pressed else Arm)(model, model.opt.timestep)
    qpos, qvel = request["qpos"][run], request["qvel"][run]
    states, begin = [np.concatenate([qpos, qvel])], time.process_time()
    for driven in applied if pressed else controls:
        qpos, qvel = twin.step(qpos, qvel, driven)
        states.append(np.concatenate([qpos, qvel]))
    cost = time.process_time() - begin
    tick()
    state = np.array(states)
    if pressed:
        return {"state": state, "sensors": twin.measured(state, controls), "cost": cost}
    sensors = np.zeros((len(controls), model.nsensordata))
    serve.add_energies(model, state, sensors)
    return {"state": state, "sensors": sensors, "cost": cost}


def _forward(request: dict[str, Any], run: int, tick: Callable[[], None]) -> dict[str, Any]:
    import serve

    model = serve.model_of(request, run)
    tick()
    if touches(model):
        return {}
    control = serve.inputs_of(request, run, model)[0][0]
    arm = Arm(model, model.opt.timestep)
    return arm.forward(request["qpos"][run], request["qvel"][run], control)


class Arm:
    """A model as Drake imports it; its joints are in the same order, whatever Drake's is.

    Without a timestep it is continuous.
    """

    def __init__(self, model: mujoco.MjModel, timestep: float) -> None:
        import serve
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
        from pydrake.systems.framework import DiagramBuilder

        builder = DiagramBuilder()
        self._model, (self._plant, _) = model, AddMultibodyPlantSceneGraph(builder, timestep)
        joints = [model.joint(each).name or f"joint_{each}" for each in range(model.njnt)]
        Parser(self._plant).AddModelsFromString(serve.mjcf_of(_moving(model)), "xml")
        self._plant.mutable_gravity_field().set_gravity_vector(_JOINTS.gravity_of(model))
        for name, dof in zip(joints, model.jnt_dofadr, strict=True):
            # Without an actuator, Drake drops armature.
            actuator = self._plant.AddJointActuator(name, self._plant.GetJointByName(name))
            actuator.set_default_rotor_inertia(float(model.dof_armature[dof]))
            actuator.set_default_gear_ratio(1.0)
        if timestep:
            self._plant.SetUseSampledOutputPorts(False)
        self._plant.Finalize()
        self.diagram = builder.Build()
        self.root = self.diagram.CreateDefaultContext()
        self._context = self._plant.GetMyMutableContextFromRoot(self.root)
        found = [self._plant.GetJointByName(name) for name in joints]
        self._places = [each.position_start() for each in found]
        self._speeds = [each.velocity_start() for each in found]
        self._plant.get_actuation_input_port().FixValue(self._context, np.zeros(model.njnt))
        _ARRIVALS.check_dynamics(model, self._dynamics)

    def put(self, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Set coordinates and velocities."""
        q, v = np.zeros(self._model.nq), np.zeros(self._model.nv)
        q[self._places], v[self._speeds] = qpos - self._model.qpos0, qvel
        self._plant.SetPositions(self._context, q)
        self._plant.SetVelocities(self._context, v)

    def step(
        self, qpos: np.ndarray, qvel: np.ndarray, control: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the coordinates and velocities one step later."""
        self.put(qpos, qvel)
        forces = np.zeros(self._model.nv)
        forces[self._speeds] = _JOINTS.joint_forces(self._model, qpos, qvel, control)
        port = self._plant.get_applied_generalized_force_input_port()
        port.FixValue(self._context, forces)
        after = self._plant.EvalUniquePeriodicDiscreteUpdate(self._context).get_vector(0)
        return self.take(np.array(after.get_value()), qpos)

    def take(self, own: np.ndarray, _qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return a state of Drake's as MuJoCo has it."""
        q, v = np.split(own, [self._model.nq])
        return q[self._places] + self._model.qpos0, v[self._speeds]

    def own(self, root: Any) -> np.ndarray:
        """Return the state of a context as Drake has it."""
        return self._plant.GetPositionsAndVelocities(self._plant.GetMyContextFromRoot(root)).copy()

    def rates(self, own: np.ndarray) -> np.ndarray:
        """Return how the coordinates of a state of Drake's change [1/s, or rad/s]."""
        return own[self._model.nq :]

    def apply(self, _applied: np.ndarray) -> None:
        """Apply no forces on bodies: there are none."""

    def forward(self, qpos: np.ndarray, qvel: np.ndarray, control: np.ndarray) -> dict[str, Any]:
        """Return forces of motion and gravity, and the acceleration."""
        inertia, bias = self._dynamics(qpos, qvel)
        off = self._model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_DAMPER
        damping = self._model.dof_damping * (not off)
        force = _JOINTS.joint_forces(self._model, qpos, qvel, control) - damping * qvel - bias
        return {"qfrc_bias": bias, "qacc_smooth": np.linalg.solve(inertia, force)}

    def _dynamics(self, qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the inertia, with armatures, and the forces of motion and gravity."""
        self.put(qpos, qvel)
        plant, context = self._plant, self._context
        gravity = plant.CalcGravityGeneralizedForces(context)
        bias = (plant.CalcBiasTerm(context) - gravity)[self._speeds]
        return plant.CalcMassMatrix(context)[np.ix_(self._speeds, self._speeds)], bias


def _moving(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a model of what Drake has to move: no shapes, and nothing that acts beside damping.

    A body without mass has as good as none, without which Drake ends the process.
    """
    import copy

    plain = copy.copy(model)
    plain.jnt_limited[:], plain.jnt_stiffness[:], plain.dof_frictionloss[:] = 0, 0, 0
    plain.qpos0[:] = 0  # coordinates count from there
    plain.body_mass[1:] = _ARRIVALS.positive(model.body_mass[1:])
    plain.body_inertia[1:] = _ARRIVALS.positive(model.body_inertia[1:])
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_DAMPER:
        plain.dof_damping[:] = 0
    mujoco.mj_setConst(plain, mujoco.MjData(plain))
    return plain
