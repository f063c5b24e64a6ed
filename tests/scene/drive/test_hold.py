"""What holds a posture: actuators of every kind carry a loaded arm, within what steps carry."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.engines import Buffers, PreparedRuns, find_engine
from contactlab.errors import SceneError, UnheldWarning
from contactlab.scene.drive.hold import find_servos, hold_posture
from contactlab.scene.scene import Scene
from contactlab.schema.drive import Drive, NoiseDrive, drive_data, parse_drive

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


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("drive", ["hold", "exercise", NoiseDrive(noise=0.2)])
def test_another_model_is_driven_by_what_holds_the_first(
    drive: Drive, kind: str, tmp_path: Path
) -> None:
    """The file that has a timestep moves as the first one does at that timestep, to the bit."""
    first = arm(tmp_path, "".join(KINDS[kind].format(joint=each) for each in ("upper", "lower")))
    first = first.with_drive(drive, tmp_path)
    text = (tmp_path / "arm.xml").read_text()
    (tmp_path / "other.xml").write_text(text.replace("0.002", "0.006"))
    other = Scene.open(str(tmp_path / "other.xml"))
    given = parse_drive(drive_data(first.handed_on(drive)))
    wanted = end_of(first, 0.6, 0.006)
    np.testing.assert_array_equal(end_of(other.with_drive(given, tmp_path), 0.6, 0.006), wanted)


def test_springs_of_another_model_are_refused(tmp_path: Path) -> None:
    first = arm(tmp_path, KINDS["motors"].format(joint="upper"))
    given = first.handed_on("hold")
    other = arm(tmp_path, KINDS["motors"].format(joint="upper") * 2)
    with pytest.raises(SceneError, match="of a model with 1 actuators, but this one has 2"):
        other.with_drive(given, tmp_path)


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
    """At four timesteps, h^2 k / I is 1.6 at most; an explicit step carries 4."""
    actuators = "".join(KINDS["motors"].format(joint=name) for name in ("upper", "lower"))
    scene = arm(tmp_path, actuators, f'integrator="{integrator}"')
    assert np.abs(end_of(scene, 1.0, 0.002 * factor)).max() < 1e-3


def test_rates_of_springs_and_dampers_are_bounded(tmp_path: Path) -> None:
    """The generalized eigenvalues of springs and dampers, from dense matrices."""
    actuators = "".join(KINDS["motors"].format(joint=name) for name in ("upper", "lower"))
    model = arm(tmp_path, actuators, 'gravity="0 0 0"').base({}).model
    for timestep in (1e-4, 2e-3, 5e-2):
        model.opt.timestep = timestep
        servos = find_servos(model, model.qpos0)
        rows, inertia = np.eye(2) * 3, np.zeros((2, 2))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        for place in range(2):
            mujoco.mj_mulM(model, data, inertia[place], np.eye(2)[place])
        for gains, limit in (
            (servos.stiffness, 0.1 / timestep**2),
            (servos.damping, 0.25 / timestep),
        ):
            spring = rows.T @ np.diag(gains) @ rows
            rates = np.linalg.eigvals(np.linalg.solve(inertia, spring)).real
            assert rates.max() <= limit * (1 + 1e-9)
            assert rates.min() > 0


def test_forces_stay_within_what_ranges_allow(tmp_path: Path) -> None:
    """An arm too heavy for its motors sinks, and they never exceed gain times range."""
    weak = '<motor joint="{joint}" gear="1" ctrlrange="-1 1" ctrllimited="true"/>'
    scene = arm(tmp_path, "".join(weak.format(joint=name) for name in ("upper", "lower")))
    runs = PreparedRuns.of(scene, scene.resolve({}, 0, 0.5))
    model, start = runs.models[0], runs.starts
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = start.qpos[0], start.ctrl[0]
    for _ in range(250):
        mujoco.mj_step(model, data)
        assert np.abs(data.actuator_force).max() <= 1
    assert np.abs(data.qpos).max() > 0.1


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
    assert scene.starts([run]).ctrl.tolist() == [[0.3, 0.4]]


def test_a_posture_follows_initial_values_and_the_springs_do_not(tmp_path: Path) -> None:
    """Runs that are compared have the same gains, and each its own controls."""
    actuators = "".join(KINDS["motors"].format(joint=name) for name in ("upper", "lower"))
    scene = arm(tmp_path, actuators)
    (tmp_path / "scene.yaml").write_text(
        "version: 1\ntitle: t\ndescription: d\nmodel: arm.xml\nduration: 1\ndrive: hold\n"
        "initial: {lift: {default: 0, unit: rad, description: l, sets: {upper: lift}}}\n"
    )
    scene = Scene.open(str(tmp_path / "scene.yaml").removesuffix("/scene.yaml"))
    runs = [scene.resolve({"lift": lift}, 0, None) for lift in (0.0, -0.5)]
    prepared = PreparedRuns.of(scene, *runs)
    first, second = prepared.models
    assert (first.actuator_biasprm == second.actuator_biasprm).all()
    rollout = find_engine("mujoco").roll_out(prepared, Buffers())
    drift = rollout.state[:, -1, 1:3] - rollout.state[:, 0, 1:3]
    assert np.abs(drift).max() < 1e-3


def test_antagonists_share_a_load_within_their_bounds(tmp_path: Path) -> None:
    """Muscle-like actuators only pull: the one that cannot help stays at its least."""
    pulls = '<motor joint="upper" gear="{gear}" ctrlrange="0 1" ctrllimited="true"/>'
    actuators = pulls.format(gear=20) + pulls.format(gear=-20)
    model = arm(tmp_path, actuators).base({}).model
    servos = find_servos(model, model.qpos0).of(np.empty(0, np.intp))
    posture = hold_posture(model, servos, model.qpos0, np.full(2, np.nan))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert posture.ctrl[0] == 0
    assert posture.ctrl[1] == pytest.approx(-data.qfrc_bias[0] / 20)


@pytest.mark.parametrize(
    ("actuators", "said"),
    [
        ('<motor name="one" joint="upper"/>', "no actuator moves lower$"),
        (
            '<muscle name="m" joint="upper" lengthrange="-1 1"/><motor joint="lower"/>',
            "without feedback: m$",
        ),
        (
            KINDS["motors"].format(joint="lower").replace("20", ".1"),
            r"upper; too weak .*actuator\[0\]$",
        ),
        ("", "no actuator moves upper, lower$"),
    ],
)
def test_what_is_not_held_is_said(actuators: str, said: str, tmp_path: Path) -> None:
    """Of weak actuators: 0.3 N m are less than the 2.45 of a link."""
    with pytest.warns(UnheldWarning, match=f"arm.xml: not held: .*{said}") as caught:
        arm(tmp_path, actuators).with_drive("exercise", tmp_path)
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


def standing(folder: Path, height: float, knee: str = "-2 2") -> Scene:
    """Return a leg that carries a weight, guided along the vertical."""
    (folder / "leg.xml").write_text(STANDING.format(height=height, knee=knee))
    return Scene.open(str(folder / "leg.xml")).with_drive("hold", folder)


def test_a_robot_stands_in_its_posture(tmp_path: Path) -> None:
    """The ground bears 31 kg at the foot, which is below the hip: the knee, 0.3 m beside, turns.

    What the control lacks of its 91 N m the spring bears, by giving way.
    """
    scene = standing(tmp_path, 0.86)
    assert np.abs(end_of(scene, 2.0)[1:]).max() < 0.02
    knee = scene.starts([scene.resolve({}, 0, None)]).ctrl[0, 1] * 50
    model = scene.base({}).model
    stiffness = find_servos(model, model.qpos0).stiffness[1] * 50**2
    assert knee == pytest.approx(-0.3 * 31 * 9.81, abs=0.02 * stiffness)


def test_a_posture_ends_where_limits_of_joints_do(tmp_path: Path) -> None:
    """A knee that starts 0.2 rad beyond its limit is held there: nothing pulls it back."""
    scene = standing(tmp_path, 20.0, "11.459156 90")
    qpos = end_of(scene, 0.5)
    assert qpos[2] == pytest.approx(0.2, abs=0.01)


def test_signals_start_when_a_robot_is_at_rest(tmp_path: Path) -> None:
    """One that stands comes to rest soon; one that falls for longer than a second does not."""
    starts: list[float] = []
    for height in (0.8501, 20.0):
        noisy = standing(tmp_path, height).with_drive(NoiseDrive(noise=0.1), tmp_path)
        signals = noisy.starts([noisy.resolve({}, 0, 4.0)]).signals[0]
        starts.append(signals.times[0, 0])
    assert 0.05 <= starts[0] < starts[1] == 1.0


@pytest.mark.parametrize(("half", "falls"), [(0.02, True), (0.3, False)])
def test_a_robot_that_falls_over_is_said(
    half: float, falls: bool, tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    """A centre of mass 0.1 m beside the middle of its foot is carried by the broad one only."""
    (tmp_path / "robot.xml").write_text(
        '<mujoco><worldbody><geom type="plane" size="5 5 .1"/><body name="trunk" pos="0 0 1">'
        f'<freejoint/><geom type="box" size="{half} {half} .01" pos="0 0 -.99" mass=".1"/>'
        '<geom type="capsule" size=".02" fromto="0 0 -.98 0 0 0" mass="1" contype="0"/>'
        '<body><joint name="arm" axis="0 1 0"/><geom type="capsule" size=".03" mass="5"'
        ' fromto="0 0 0 .24 0 0" contype="0"/></body></body></worldbody>'
        '<actuator><motor joint="arm"/></actuator></mujoco>'
    )
    Scene.open(str(tmp_path / "robot.xml")).with_drive("hold", tmp_path)
    said = [str(each.message) for each in recwarn.list]
    assert [
        each.endswith("not held: falls over, since actuators hold joints only: trunk")
        for each in said
    ] == [True] * falls


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
