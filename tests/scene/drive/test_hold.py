"""What holds a posture: a load from outside, whatever the actuators, which it never touches."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.engines import Buffers, PreparedRuns, find_engine
from contactlab.errors import UnheldWarning
from contactlab.scene.drive.hold import find_load
from contactlab.scene.scene import Scene

# Two links of 1 kg, stretched out against gravity: 2 kg at 0.5 m on average, 9.81 N m and more.
ARM = """<mujoco><option timestep="0.002" {option}/><worldbody>
<body pos="0 0 2"><joint name="upper" axis="0 1 0" {joint}/>
<geom type="capsule" size=".03" fromto="0 0 0 .5 0 0" mass="1" contype="0"/>
<site name="near" pos=".4 0 .05"/>
<body pos=".5 0 0"><joint name="lower" axis="0 1 0" {joint}/>
<geom type="capsule" size=".03" fromto="0 0 0 .5 0 0" mass="1" contype="0"/>
</body></body></worldbody>
<tendon><fixed name="sum"><joint joint="upper" coef="1"/><joint joint="lower" coef=".5"/></fixed>
<fixed name="own"><joint joint="lower" coef="2"/></fixed></tendon>
<actuator>{actuators}</actuator></mujoco>"""

KINDS = {
    "motors": '<motor joint="{joint}" gear="3" ctrlrange="-20 20" ctrllimited="true"/>',
    "position": '<position joint="{joint}" kp="400" kv="4"/>',
    "velocity": '<velocity joint="{joint}" kv="5"/>',
    "intvelocity": '<intvelocity joint="{joint}" kp="400" kv="4" actrange="-3 3"/>',
    "filtered motors": '<general joint="{joint}" dyntype="filter" dynprm=".05" gainprm="9"/>',
    "exact filters": '<general joint="{joint}" dyntype="filterexact" dynprm=".02" gainprm="4"/>',
    "integrated motors": '<general joint="{joint}" dyntype="integrator" gainprm="5"/>',
    "damped": '<general joint="{joint}" gainprm="10" biastype="affine" biasprm="1 0 -.5"/>',
}
TENDONS = '<motor tendon="sum" gear="2"/><motor tendon="own" gear="-3"/>'


def arm(folder: Path, actuators: str, option: str = "", joint: str = "") -> Scene:
    """Return the arm with some actuators, held."""
    path = folder / "arm.xml"
    path.write_text(ARM.format(actuators=actuators, option=option, joint=joint))
    return Scene.open(str(path)).with_drive("hold", folder)


def end_of(scene: Scene, seconds: float, timestep: float = 0.002) -> np.ndarray:
    """Return the configuration at the end of a run of the seed 0, and its start."""
    runs = PreparedRuns.of(scene, scene.resolve({"timestep": timestep}, 0, seconds))
    rollout = find_engine("mujoco").roll_out(runs, Buffers())
    assert rollout.steps == (runs.steps,)
    return rollout.state[0, -1, 1 : 1 + scene.base({}).model.nq]


@pytest.mark.parametrize("kind", [*KINDS, "tendons"])
def test_a_loaded_arm_stays(kind: str, tmp_path: Path) -> None:
    """Balance is exact: what is left is the seed's perturbation, 1e-4 rad at most."""
    each = (
        TENDONS
        if kind == "tendons"
        else "".join(KINDS[kind].format(joint=name) for name in ("upper", "lower"))
    )
    scene = arm(tmp_path, each)
    assert np.abs(end_of(scene, 2.0)).max() < 1e-3
    limp = scene.with_drive("none", tmp_path)
    assert np.abs(end_of(limp, 2.0)).max() > 0.02


@pytest.mark.parametrize("factor", [0.25, 1.0, 4.0])
@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicitfast"])
def test_springs_suit_other_timesteps_and_integrators(
    factor: float, integrator: str, tmp_path: Path
) -> None:
    """At 4 Hz, (h w)^2 is 0.04 at most; an explicit step carries 4."""
    actuators = "".join(KINDS["motors"].format(joint=name) for name in ("upper", "lower"))
    scene = arm(tmp_path, actuators, f'integrator="{integrator}"')
    assert np.abs(end_of(scene, 1.0, 0.002 * factor)).max() < 1e-3


def test_no_mode_is_faster_than_4_hz(tmp_path: Path) -> None:
    """The generalized eigenvalues of the springs, from dense matrices; at any timestep the same."""
    actuators = "".join(KINDS["motors"].format(joint=name) for name in ("upper", "lower"))
    model = arm(tmp_path, actuators, 'gravity="0 0 0"').base({}).model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((2, 2))
    for place in range(2):
        mujoco.mj_mulM(model, data, inertia[place], np.eye(2)[place])
    found: list[np.ndarray] = []
    for timestep in (1e-4, 2e-3, 5e-2):
        model.opt.timestep = timestep
        load = find_load(model, model.qpos0, np.zeros(2), np.zeros(0))
        rates = np.linalg.eigvals(np.linalg.solve(inertia, np.diag(load.stiffness))).real
        assert 0 < rates.min() <= rates.max() <= (2 * np.pi * 4) ** 2 * (1 + 1e-9)
        found.append(load.stiffness)
    assert found[0].tobytes() == found[1].tobytes() == found[2].tobytes()


def test_a_load_changes_no_field_of_an_actuator(tmp_path: Path) -> None:
    """Nor limits, masses or gravity: of all arrays, those of the joints' own springs only."""
    actuators = "".join(kind.format(joint="lower") for kind in KINDS.values())
    scene = arm(tmp_path, actuators)
    (model,) = PreparedRuns.of(scene, scene.resolve({}, 0, None)).models
    written = scene.base({}).model
    changed = {
        name
        for name in dir(written)
        if isinstance(getattr(written, name), np.ndarray)
        and not np.array_equal(getattr(written, name), getattr(model, name), equal_nan=True)
    }
    assert changed == {"jnt_stiffness", "dof_damping", "qpos_spring"}


def test_a_load_is_what_generalized_forces_from_outside_would_be(tmp_path: Path) -> None:
    """Its springs, given to plain MuJoCo as qfrc_applied, accelerate the model as written alike.

    To rounding, at states off the start; the dampers too, as forces at the state.
    """
    scene = arm(tmp_path, KINDS["motors"].format(joint="lower"), joint='stiffness="3"')
    run = scene.resolve({}, 0, None)
    (held,) = PreparedRuns.of(scene, run).models
    written = scene.base({}).model
    load = find_load(written, written.qpos0, np.zeros(1), np.zeros(0))
    random = np.random.default_rng(0)
    for _ in range(5):
        plain, inner = mujoco.MjData(written), mujoco.MjData(held)
        for data in (plain, inner):
            data.qpos[:], data.qvel[:], data.ctrl[:] = 0.1, -0.2, 3.0
        plain.qpos[:] = inner.qpos[:] = random.normal(size=2)
        plain.qvel[:] = inner.qvel[:] = random.normal(size=2)
        away = plain.qpos[load.joints] - load.places
        forces = load.balance - load.stiffness * away - load.damping * plain.qvel[load.joints]
        plain.qfrc_applied[load.joints] = forces
        mujoco.mj_forward(written, plain)
        mujoco.mj_forward(held, inner)
        np.testing.assert_allclose(inner.qacc, plain.qacc, rtol=1e-9, atol=1e-9)


def test_a_keyframes_controls_are_kept(tmp_path: Path) -> None:
    text = ARM.format(
        actuators="".join(KINDS["position"].format(joint=name) for name in ("upper", "lower")),
        option="",
        joint="",
    ).replace("</mujoco>", '<keyframe><key qpos=".1 .2" ctrl=".3 .4"/></keyframe></mujoco>')
    path = tmp_path / "arm.xml"
    path.write_text(text)
    scene = Scene.open(str(path)).with_drive("hold", tmp_path)
    run = scene.resolve({"keyframe": "key[0]"}, 0, None)
    assert scene.initial_states([run]).ctrl.tolist() == [[0.3, 0.4]]


def test_a_load_follows_initial_values(tmp_path: Path) -> None:
    """Each run is held where it starts."""
    actuators = "".join(KINDS["motors"].format(joint=name) for name in ("upper", "lower"))
    arm(tmp_path, actuators)
    (tmp_path / "scene.yaml").write_text(
        "version: 1\ntitle: t\ndescription: d\nmodel: arm.xml\nduration: 1\ndrive: hold\n"
        "initial: {lift: {default: 0, unit: rad, description: l, sets: {upper: lift}}}\n"
    )
    scene = Scene.open(str(tmp_path / "scene.yaml").removesuffix("/scene.yaml"))
    for lift in (0.0, -0.5):
        prepared = PreparedRuns.of(scene, scene.resolve({"lift": lift}, 0, None))
        rollout = find_engine("mujoco").roll_out(prepared, Buffers())
        drift = rollout.state[:, -1, 1:3] - rollout.state[:, 0, 1:3]
        assert np.abs(drift).max() < 1e-3


@pytest.mark.parametrize(
    ("actuators", "said"),
    [
        ('<motor name="one" joint="upper"/>', "no actuator moves lower$"),
    ],
)
def test_what_is_not_held_is_said(actuators: str, said: str, tmp_path: Path) -> None:
    with pytest.warns(UnheldWarning, match=f"arm.xml: not held: .*{said}") as caught:
        arm(tmp_path, actuators)
    assert len(caught) == 1


STANDING = """<mujoco><option timestep="0.002"/><worldbody>
<geom type="plane" size="1 1 .1"/>
<body pos="0 0 {height}"><joint type="slide" axis="0 0 1"/>
<geom type="sphere" size=".1" mass="30" contype="0" conaffinity="0"/>
<body><joint name="hip" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 .3 0 -.4"
  mass=".5" contype="0" conaffinity="0"/>
<body pos=".3 0 -.4"><joint name="knee" axis="0 1 0" range="{knee}" limited="true"/>
<geom type="capsule" size=".02" fromto="0 0 0 -.3 0 -.4" mass=".5" contype="0" conaffinity="0"/>
<geom type="sphere" pos="-.3 0 -.4" size=".05" condim="1"/>
</body></body></body></worldbody><actuator>
<motor joint="hip" gear="50"/><motor joint="knee" gear="50"/></actuator></mujoco>"""


def standing(folder: Path, height: float, knee: str = "-90 90") -> Scene:
    """Return a leg that carries a weight, guided along the vertical."""
    (folder / "leg.xml").write_text(STANDING.format(height=height, knee=knee))
    return Scene.open(str(folder / "leg.xml")).with_drive("hold", folder)


def test_a_robot_stands_in_its_posture(tmp_path: Path) -> None:
    """The ground bears 31 kg at the foot, 0.3 m beside the knee; without support it collapses.

    Springs of the leg's own inertia are soft for 30 kg, so that what the balance lacks of 91 N m
    makes it give way by some hundredths of a radian.
    """
    scene = standing(tmp_path, 0.86)
    assert np.abs(end_of(scene, 2.0)[1:]).max() < 0.06
    limp = scene.with_drive("none", tmp_path)
    assert np.abs(end_of(limp, 2.0)[1:]).max() > 0.5


def test_a_posture_ends_where_limits_of_joints_do(tmp_path: Path) -> None:
    """A knee that starts 0.2 rad beyond its limit is held there: nothing pulls it back."""
    scene = standing(tmp_path, 20.0, "11.459156 90")
    qpos = end_of(scene, 0.5)
    assert qpos[2] == pytest.approx(0.2, abs=0.01)


def test_a_start_beyond_limits_is_said(tmp_path: Path) -> None:
    with pytest.warns(UnheldWarning, match="up to 0.2 beyond their limits at the start: knee"):
        standing(tmp_path, 0.86, "11.459156 90")


def test_a_body_that_a_mocap_body_holds_is_said(tmp_path: Path) -> None:
    (tmp_path / "led.xml").write_text(
        '<mujoco><worldbody><body name="hand" mocap="true"/><body name="tool"><freejoint/>'
        '<geom size=".1"/><body><joint name="turn"/><geom size=".1"/></body></body></worldbody>'
        '<equality><weld body1="hand" body2="tool"/></equality>'
        '<actuator><motor joint="turn"/></actuator></mujoco>'
    )
    with pytest.warns(UnheldWarning, match="not held: fixed to a mocap body: tool$"):
        Scene.open(str(tmp_path / "led.xml")).with_drive("hold", tmp_path)


def test_nothing_is_said_of_what_is_held(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    for kind in KINDS.values():
        arm(tmp_path, "".join(kind.format(joint=name) for name in ("upper", "lower")))
    assert not recwarn.list
