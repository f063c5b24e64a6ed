"""Noise has its band and share at every timestep; an exercise drives all, within its ranges."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.errors import SceneError
from contactlab.scene.drive.signals import control_ranges, pushed_bodies
from contactlab.scene.scene import Scene
from contactlab.scene.timed_inputs import Signals
from contactlab.schema.drive import NoiseDrive

ARM = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody><body>
<joint name="turn" axis="0 1 0" range="-60 90" limited="true"/>
<geom type="capsule" size=".03" fromto="0 0 0 .5 0 0" mass="1"/>
<body pos=".5 0 0"><joint name="slide" type="slide" axis="1 0 0" range="-.1 .2" limited="true"/>
<geom size=".05" mass=".2"/></body></body></worldbody><actuator>
<motor name="motor" joint="turn" ctrlrange="-4 4" ctrllimited="true"/>
<position name="servo" joint="slide" kp="200" kv="15" ctrlrange="-.1 .2"/></actuator></mujoco>"""


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    """Two joints, one turned by a motor, one moved by a servo."""
    (tmp_path / "arm.xml").write_text(ARM)
    return Scene.open(str(tmp_path / "arm.xml"))


def controls(scene: Scene, timestep: float, seconds: float, seed: int = 0) -> np.ndarray:
    """Return (T, nu) the controls of a run."""
    run = scene.resolve({"timestep": timestep}, seed, seconds)
    return scene.initial_states([run]).input_rows(0, timestep, np.arange(run.steps))[:, :2]


def test_noise_has_its_band_and_its_share(scene: Scene, tmp_path: Path) -> None:
    """Power above the rate is what linear knots leave: less than 1e-3 with 12 in a period.

    The mean square of a sum of sines over 400 s is that of its expectation to 3 %: the slowest
    of 20 frequencies below 5 Hz turn over tens of times.
    """
    noisy = scene.with_drive(NoiseDrive(noise=0.3, rate=5.0), tmp_path)
    found = controls(noisy, 0.01, 400.0)[20:]
    offsets = found - controls(scene.with_drive("hold", tmp_path), 0.01, 0.01)
    assert np.sqrt(np.mean(offsets**2, axis=0)) == pytest.approx([0.3 * 4, 0.3 * 0.15], rel=0.03)
    power = np.abs(np.fft.rfft(offsets * np.hanning(len(offsets))[:, None], axis=0)) ** 2
    frequency = np.fft.rfftfreq(len(offsets), 0.01)
    assert (power[frequency > 5.05].sum(axis=0) < 1e-3 * power.sum(axis=0)).all()
    low = power[frequency < 1.25].sum(axis=0) / power.sum(axis=0)
    assert low == pytest.approx([0.25, 0.25], rel=0.1)


def test_noise_is_the_same_at_every_timestep_and_another_for_each_seed(
    scene: Scene, tmp_path: Path
) -> None:
    noisy = scene.with_drive(NoiseDrive(noise=0.2, rate=10.0), tmp_path)
    coarse, fine = controls(noisy, 0.004, 1.0), controls(noisy, 0.001, 1.0)
    assert np.allclose(coarse, fine[::4], rtol=0, atol=1e-12)
    assert not np.allclose(coarse, controls(noisy, 0.004, 1.0, seed=1))


def test_runs_of_a_job_get_what_each_gets_alone(scene: Scene, tmp_path: Path) -> None:
    """To the bit, also where neighbours differ in more than their seeds."""
    noisy = scene.with_drive(NoiseDrive(noise=0.2, rate=10.0), tmp_path)
    asked = [(0.002, 5, 1.0), (0.002, 6, 1.0), (0.004, 5, 1.0), (0.002, 5, 0.5), (0.002, 7, 1.0)]
    runs = [noisy.resolve({"timestep": step}, seed, end) for step, seed, end in asked]
    together = noisy.initial_states(runs)
    for place, (run, (step, _, end)) in enumerate(zip(runs, asked, strict=True)):
        alone, steps = noisy.initial_states([run]), np.arange(run.steps)
        inputs = together.input_rows(place, step, steps), alone.input_rows(0, step, steps)
        assert inputs[0].tobytes() == inputs[1].tobytes()
        assert np.array_equal(together.control_ranges(place, end), alone.control_ranges(0, end))


def test_steps_too_long_for_the_noise_are_refused(scene: Scene, tmp_path: Path) -> None:
    noisy = scene.with_drive(NoiseDrive(noise=0.2, rate=60.0), tmp_path)
    controls(noisy, 0.008, 0.1)
    with pytest.raises(SceneError, match=r"60 Hz needs timesteps of at most 0\.00833333 s"):
        controls(noisy, 0.009, 0.1)


def test_an_exercise_rests_and_then_moves_all(scene: Scene, tmp_path: Path) -> None:
    exercised = scene.with_drive("exercise", tmp_path)
    inputs = controls(exercised, 1e-3, 3.0)
    assert not inputs[:1000].any()
    moving = np.abs(np.diff(inputs, axis=0)) > 1e-9
    assert (moving[1030:].sum(axis=0) == 98).all(), "a control changes 50 times a second"
    low, high = np.array([[-4, -0.1], [4, 0.2]])
    middle, reach = (low + high) / 2, 0.7 * (high - low) / 2
    assert (np.abs(inputs[1200:] - middle) <= reach * (1 + 1e-12)).all()
    # Half a period of the slowest sine is 1 s, so that 2 s have an end of each.
    assert (np.abs(inputs[1200:] - middle).max(axis=0) > 0.99 * reach).all()


POSTURE = """<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody>
<body><joint name="a"/><geom size=".1" mass="1"/></body>
<body pos="1 0 0"><joint name="b" type="slide"/><geom size=".1" mass="1"/></body>
<body pos="2 0 0"><joint name="c"/><geom size=".1" mass="1"/></body></worldbody>
<tendon><fixed name="t"><joint joint="b" coef="-2"/></fixed></tendon><actuator>
<position joint="a" gear="3" kp="5" kv="1"/><position tendon="t" kp="50" kv="4" timeconst=".02"/>
<general joint="c" biastype="affine" gainprm="2" biasprm="1 -4 -1" ctrlrange="0 .5"
  ctrllimited="true"/><motor joint="a"/><velocity joint="a" kv="1"/></actuator>
<keyframe><key name="posture" qpos=".7 .3 .1"/></keyframe></mujoco>"""


def test_servos_hold_a_posture_that_has_no_controls(tmp_path: Path) -> None:
    """At rest no servo pulls, but one whose range ends before; of the model's own, all are 0."""
    path = tmp_path / "posture.xml"
    path.write_text(POSTURE)
    scene = Scene.open(str(path)).with_drive("exercise", tmp_path)
    runs = [scene.resolve({"keyframe": name}, 0, 1.0) for name in ("posture", "qpos0")]
    held, reference = (scene.initial_states([run]).ctrl[0] for run in runs)
    # Lengths are 3 x .7, -2 x .3 and .1; of the third, (4 x .1 - 1) / 2 is below its range.
    assert held == pytest.approx([2.1, -0.6, 0, 0, 0])
    assert not reference.any()


def test_all_timesteps_see_the_same_controls(scene: Scene, tmp_path: Path) -> None:
    """Where steps and changes coincide, to the bit; a step between two has that of the first."""
    exercised = scene.with_drive("exercise", tmp_path)
    fine = controls(exercised, 0.0005, 3.0)
    for times in (2, 4, 8, 20, 40):
        coarse = controls(exercised, 0.0005 * times, 3.0)
        assert coarse.tobytes() == fine[::times].tobytes()
    assert fine.tobytes() != controls(exercised, 0.0005, 3.0, seed=1).tobytes()


PUSHED = """<mujoco><option gravity="0 -3 -4"/><worldbody>
<body name="one" pos="0 0 3"><freejoint/><geom size=".1" mass="2"/><body pos="0 0 .3">
<joint type="ball"/><geom size=".1" mass="1"/></body></body>
<body name="two" pos="1 0 3"><freejoint/><geom size=".1" mass=".5"/></body>
<body name="three" pos="2 0 3"><joint/><geom size=".1"/></body></worldbody></mujoco>"""


def test_free_bodies_are_pushed_by_their_weight_for_50_ms(tmp_path: Path) -> None:
    """Across gravity: 5 m/s^2 here, and 3 kg and 0.5 kg with what they carry."""
    (tmp_path / "free.xml").write_text(PUSHED)
    scene = Scene.open(str(tmp_path / "free.xml")).with_drive("exercise", tmp_path)
    run = scene.resolve({"timestep": 1e-3}, 0, 3.0)
    inputs = scene.initial_states([run]).input_rows(0, 1e-3, np.arange(run.steps))
    forces = inputs.reshape(len(inputs), -1, 6)
    assert not forces[..., 3:].any()
    sizes = np.linalg.norm(forces[..., :3], axis=2)
    for body, weight in ((1, 15.0), (3, 2.5)):
        pushed = np.flatnonzero(sizes[:, body])
        assert len(pushed) in (49, 50, 51)
        assert np.ptp(pushed) == len(pushed) - 1
        assert pushed[0] >= 1000
        assert sizes[pushed, body] == pytest.approx(weight)
        assert forces[pushed, body, :3] @ [0, -3, -4] == pytest.approx(0, abs=1e-9)
    assert not sizes[:, [0, 2, 4]].any()


BOUNDED = """<mujoco><worldbody><body><joint name="turn" axis="0 1 0"/>
<geom name="rod" type="capsule" size=".03" fromto="0 0 0 .5 0 0"/>
<body pos=".5 0 0"><joint name="slide" type="slide"/><geom size=".05"/></body></body></worldbody>
<tendon><fixed name="both"><joint joint="turn" coef=".5"/><joint joint="slide" coef=".5"/></fixed>
</tendon><actuator>
<general name="hand" tendon="both" ctrlrange="0 255" biastype="affine" gainprm=".0157"
  biasprm="0 -100 -10"/>
<position name="servo" joint="slide" kp="900" ctrlrange="-.2 .01"/>
<position name="turned" joint="turn" gear="-3" kp="9" ctrlrange="-.2 .1"/>
<intvelocity name="rate" joint="turn" kp="50" actrange="-.1 .3" ctrlrange="-.05 .2"/>
<damper name="damper" joint="turn" kv="1" ctrlrange="0 3"/>
<general name="off" joint="turn" gainprm="2" biasprm="0 -5" biastype="affine" ctrlrange="1 3"/>
</actuator></mujoco>"""


def test_exercised_controls_stay_in_their_ranges(tmp_path: Path) -> None:
    """Joints and tendons without limits say nothing of how far; and each control moves."""
    (tmp_path / "bounded.xml").write_text(BOUNDED)
    scene = Scene.open(str(tmp_path / "bounded.xml")).with_drive("exercise", tmp_path)
    run = scene.resolve({"timestep": 1e-3}, 0, 10.0)
    starts, model = scene.initial_states([run]), scene.base_of(run).model
    inputs = starts.input_rows(0, 1e-3, np.arange(run.steps))[:, : model.nu]
    assert (np.ptp(inputs, axis=0) > 1e-3).all()
    low, high = model.actuator_ctrlrange.T
    limited = model.actuator_ctrllimited.astype(bool)
    assert limited.all()
    # The one whose range excludes zero rests in its middle.
    assert inputs[0].tolist() == [0, 0, 0, 0, 0, 2]
    assert (inputs >= low).all()
    assert (inputs <= high).all()


RANGES = """<mujoco><worldbody><body><joint name="turn" range="-60 90" limited="true"/>
<geom size=".1" mass="1" pos=".5 0 0"/></body></worldbody><actuator>
<motor joint="turn" gear="3"/><motor joint="turn" forcerange="-4 6"/>
<position joint="turn" kp="10"/><velocity joint="turn" kv="2"/>
<muscle joint="turn" lengthrange="-1 2"/></actuator></mujoco>"""


def test_controls_without_limits_have_the_ranges_of_what_they_do() -> None:
    """A motor accelerates its joint by 10 rad/s^2; a servo goes to the limits of its joint."""
    model = mujoco.MjModel.from_xml_string(RANGES)
    ranges = control_ranges(model)
    data = mujoco.MjData(model)
    data.ctrl[0] = ranges[0, 1]
    model.opt.gravity[:] = 0
    model.actuator_gainprm[1:], model.actuator_biasprm[1:] = 0, 0
    mujoco.mj_forward(model, data)
    assert data.qacc[0] == pytest.approx(10)
    assert ranges[0, 0] == -ranges[0, 1]
    assert ranges[1:].tolist() == [[-4, 6], [-np.pi / 3, np.pi / 2], [-1, 1], [0, 1]]


def test_what_has_neither_actuators_nor_free_bodies_is_pushed_at_its_ends() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint/><geom size=".1"/><body pos="0 0 .3"><joint/>'
        '<geom size=".1"/></body></body><body><geom size=".1"/></body></worldbody></mujoco>'
    )
    assert pushed_bodies(model).tolist() == [2]


def test_shared_knots_interpolate_as_numpy_does() -> None:
    """To the bit, jumps and ends included."""
    generator = np.random.default_rng(3)
    times = np.sort(np.round(generator.uniform(0, 1, 60), 2))
    levels = generator.normal(size=(4, 60))
    asked = np.concatenate([np.linspace(-0.2, 1.2, 701), times])
    found = Signals(np.arange(4), times[None], levels).values_at(asked)
    for place in range(4):
        assert found[:, place].tobytes() == np.interp(asked, times, levels[place]).tobytes()


def test_joined_signals_leave_inputs_that_are_driven_already() -> None:
    first = Signals(np.array([2, 0]), np.array([[0.0, 1.0]]), np.array([[1.0, 2.0], [3.0, 4.0]]))
    other = Signals(np.array([1, 2]), np.array([[0.5]]), np.array([[5.0], [6.0]]))
    both, asked = first.merge_signals(other), np.linspace(0, 1, 5)
    assert both.places.tolist() == [2, 0, 1]
    assert np.array_equal(both.values_at(asked)[:, :2], first.values_at(asked))
    assert both.values_at(asked)[:, 2].tolist() == [5.0] * 5
    assert first.merge_signals(first) is first
