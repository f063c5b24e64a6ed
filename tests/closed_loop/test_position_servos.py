"""Laws of a PD that moves into the model: equal torques, equal models, and only stated gains."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.closed_loop.control_loop import INTEGRATION, ControlLoop, LoopRows
from contactlab.closed_loop.loop_margins import LoopStudy
from contactlab.closed_loop.position_servos import (
    list_stated_servos,
    list_steered_keys,
    move_inside,
)
from contactlab.contact.trace_arrays import Floats
from contactlab.engines.engine import PolicyClass
from contactlab.engines.pd_controller import PdController, send_targets
from contactlab.errors import SceneError
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import write_model
from contactlab.scene.scene import Scene

ARM = """<mujoco><option timestep=".002"/><default><motor ctrlrange="-4 4"/></default><worldbody>
<body><joint name="one" axis="0 1 0" range="-90 90"/><geom size=".05" pos=".1 0 0"/>
<body pos=".2 0 0"><joint name="two" axis="0 1 0"/><geom size=".04" pos=".1 0 0"/></body></body>
</worldbody><actuator>
<motor name="first" joint="one" gear="3"></motor>
<general joint="two" gear="-2" forcerange="-1 3" gainprm="1"/>
</actuator><keyframe><key name="bent" qpos=".3 -.4" ctrl="1 2"/><key qpos=".1 .2"/></keyframe>
</mujoco>"""
PD = partial(PdController, kp=6.0, kd=0.5)


class GainPolicy:
    """A PD per control, with gains that it states, and one that it does not obey."""

    kp = (8.0, -5.0)
    kd = (0.4, -0.1)
    across = 0.0

    def __init__(self, model: mujoco.MjModel) -> None:
        """Need nothing of the model."""
        del model

    @classmethod
    def make_other(cls, model: mujoco.MjModel) -> "GainPolicy":
        """Make a policy without a class of its own."""
        return cls(model)

    def __call__(self, *seen: Floats) -> Floats:
        """Return torques toward a moving target, within limits."""
        target = 0.1 * np.sin(seen[0])[:, None] - seen[1]
        wanted = target * GainPolicy.kp - seen[2] * GainPolicy.kd
        return np.clip(wanted + self.across * seen[1][:, ::-1], -4, 4)


class CrossPolicy(GainPolicy):
    """Has more feedback than it states."""

    across = 0.5


class WrongPolicy(GainPolicy):
    """States other gains."""

    kp = (9.0, -5.0)


class SilentPolicy(GainPolicy):
    """States no gain."""

    kp = None  # pyright: ignore[reportAssignmentType]


def make_loop(policy: PolicyClass, xml: str = ARM) -> ControlLoop:
    model = mujoco.MjModel.from_xml_string(xml)
    start = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_getState(model, mujoco.MjData(model), start, INTEGRATION)
    return ControlLoop(model, policy, start, 100.0)


@pytest.mark.parametrize("policy", [PD, GainPolicy])
def test_servos_make_the_torques_of_the_policy(policy: PolicyClass) -> None:
    loop = make_loop(policy)
    inside = move_inside(loop, list_stated_servos(loop))
    random, rows = np.random.default_rng(0), 5
    seen = [np.linspace(0, 1, rows), *random.uniform(-0.2, 0.2, (2, rows, 2)), np.empty((rows, 0))]
    outer: Any = loop.policy(loop.model)
    sent: Any = inside.policy(inside.model)
    controls = outer(*seen), sent(*seen)
    for row in range(rows):
        torques = []
        for made, control in zip((loop, inside), controls, strict=True):
            data = mujoco.MjData(made.model)
            data.qpos[:], data.qvel[:], data.ctrl[:] = seen[1][row], seen[2][row], control[row]
            mujoco.mj_forward(made.model, data)
            torques.append(data.qfrc_actuator.copy())
        np.testing.assert_allclose(*torques, rtol=0, atol=1e-12)


def test_a_pd_sends_its_own_targets() -> None:
    """They are constant, whatever the state, in the lengths of the actuators."""
    loop = make_loop(PD)
    rows = LoopRows(move_inside(loop, list_stated_servos(loop))).repeat_row(4)
    rows.ask_policy()
    for row, data in enumerate(rows.data):
        data.qpos[:], data.qvel[:] = 0.1 * row, -0.2 * row
    np.testing.assert_allclose(rows.ask_policy(), 0, atol=1e-12)


def test_gains_are_per_length_of_the_actuator() -> None:
    servos = list_stated_servos(make_loop(PD))
    assert [servo.kp for servo in servos] == pytest.approx([6 / 9, 6 / 4])
    assert [servo.kv for servo in servos] == pytest.approx([0.5 / 9, 0.5 / 4])
    assert [servo.forces for servo in servos] == [(-4, 4), (-1, 3)]
    assert [servo.kp for servo in list_stated_servos(make_loop(GainPolicy))] == pytest.approx(
        [8 / 3, 5 / 2]
    )


@pytest.mark.parametrize("policy", [CrossPolicy, WrongPolicy, SilentPolicy, GainPolicy.make_other])
def test_only_stated_gains_become_servos(policy: PolicyClass) -> None:
    assert list_stated_servos(make_loop(policy)) == ()


def test_a_file_gets_the_same_servos(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(ARM)
    loop = make_loop(PD)
    servos = list_stated_servos(loop)
    edits = ModelEdits({"integrator": "implicitfast"}, servos=servos)
    edits = replace(edits, steered=list_steered_keys(loop.model, servos))
    path = write_model(Scene.open(str(tmp_path / "arm.xml")), edits, tmp_path / "new").path
    text, inside = path.read_text(), move_inside(loop, servos).model
    assert '<position name="first" joint="one" gear="3" kp="' in text
    assert "</motor>" not in text
    made = mujoco.MjModel.from_xml_path(str(path))
    for field in ("gainprm", "biasprm", "biastype", "forcerange", "forcelimited", "ctrllimited"):
        name = f"actuator_{field}"
        np.testing.assert_array_equal(getattr(made, name), getattr(inside, name))
    assert made.opt.integrator == inside.opt.integrator
    np.testing.assert_allclose(made.key_ctrl, made.key_qpos * [3, -2])


def test_a_damping_beyond_the_step_holds_inside() -> None:
    """Outside, a damping holds below 2 I / T; as a servo, implicitfast takes it implicitly."""
    loop = make_loop(partial(PdController, kp=1.0, kd=1.0))
    study = LoopStudy(loop, periods=200)
    assert not study.holds_simulated(loop)
    assert study.holds_simulated(move_inside(loop, list_stated_servos(loop)))


def test_targets_need_servos_and_a_class() -> None:
    motors, targets = make_loop(PD).model, send_targets(GainPolicy)
    with pytest.raises(SceneError, match="lacks position servos"):
        targets(motors)
    with pytest.raises(SceneError, match="write a class"):
        send_targets(GainPolicy(motors).make_other)
