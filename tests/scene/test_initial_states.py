"""Start states: what initial values set, what a seed moves, what a keyframe holds."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.scene.scene import Scene

MODEL = """
<mujoco>
  <worldbody>
    <body name="box" pos="0 0 1"><freejoint name="box"/><geom name="box" size=".1"/></body>
    <body name="pendulum" pos="1 0 1">
      <joint name="ball" type="ball"/><geom fromto="0 0 0 0 0 -.5" type="capsule" size=".05"/>
      <body pos="0 0 -.5">
        <joint name="hinge" axis="0 1 0"/><joint name="slide" type="slide" axis="1 0 0"/>
        <geom size=".05"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="hinge"/></actuator>
  <keyframe>
    <key name="tilted" qpos="3 4 5 0.6 0.8 0 0 0.6 0 0.8 0 0.3 0.1" ctrl="0.7"
         qvel="1 2 3 4 5 6 7 8 9 10 11"/>
  </keyframe>
</mujoco>
"""
INITIAL = """
keyframe: qpos0
initial:
  speed: {default: 2.0, unit: m/s, description: s, sets: {box.vx: speed * cos(radians(heading))}}
  heading: {default: 60.0, unit: deg, description: h, sets: {box.vy: speed * sin(radians(heading))}}
  angle:
    default: 0.5
    unit: rad
    description: a
    sets: {hinge: angle, hinge.v: -angle, ball.wz: 2 * angle}
  twist: {default: 0.0, unit: "1", description: t, sets: {box.qw: 1 + twist, box.qz: twist}}
  effort: {default: 0.0, unit: N m, description: e, sets: {motor.ctrl: effort, box.fx: 3 * effort}}
"""
Make = Callable[..., Scene]


@pytest.fixture(scope="module")
def scene(make_scene: Make) -> Scene:
    return make_scene(MODEL, INITIAL)


def starts(scene: Scene, *values: dict[str, Any], seed: int = 0) -> Any:
    return scene.initial_states([scene.resolve(each, seed, None) for each in values])


@given(speed=st.floats(-9, 9), heading=st.floats(-180, 180), angle=st.floats(-3, 3))
def test_initial_values_are_computed_into_their_places(
    speed: float, heading: float, angle: float, scene: Scene
) -> None:
    values = {"speed": speed, "heading": heading, "angle": angle}
    found = starts(scene, values, {})
    model = scene.base({}).model
    data = mujoco.MjData(model)
    turn = np.radians(heading)
    data.joint("box").qvel[:2] = speed * np.cos(turn), speed * np.sin(turn)
    data.joint("hinge").qpos[0], data.joint("hinge").qvel[0] = angle, -angle
    data.joint("ball").qvel[2] = 2 * angle
    assert found.qpos[0] == pytest.approx(data.qpos, abs=1e-12)
    assert found.qvel[0] == pytest.approx(data.qvel, abs=1e-12)
    assert found.qvel[1, 0] == pytest.approx(1.0)


@given(twist=st.floats(-0.9, 9))
def test_quaternions_stay_unit(twist: float, scene: Scene) -> None:
    found = starts(scene, {"twist": twist})
    norms = [np.linalg.norm(found.qpos[0, at : at + 4]) for at in (3, 7)]
    assert norms == pytest.approx([1.0, 1.0], abs=1e-12)
    assert np.arctan2(found.qpos[0, 6], found.qpos[0, 3]) == pytest.approx(
        np.arctan2(twist, 1 + twist)
    )


def test_forces_and_controls(scene: Scene) -> None:
    found = starts(scene, {"effort": 0.25}, {})
    assert found.ctrl.tolist() == [[0.25], [0.0]]
    expected = np.zeros((2, scene.base({}).model.nbody, 6))
    expected[0, 1, 0] = 0.75
    assert found.applied.tolist() == expected.reshape(2, -1).tolist()


def test_a_keyframe_gives_state_and_control(make_scene: Make) -> None:
    found = starts(make_scene(MODEL, "keyframe: tilted\n"), {})
    model = mujoco.MjModel.from_xml_string(MODEL)
    assert found.qpos[0] == pytest.approx(model.key_qpos[0])
    assert found.qvel[0].tolist() == list(range(1, 12))
    assert found.ctrl.tolist() == [[0.7]]


def test_initial_values_come_over_a_keyframe(make_scene: Make) -> None:
    found = starts(
        make_scene(MODEL, INITIAL.replace("keyframe: qpos0", "keyframe: tilted")), {"angle": 0.9}
    )
    assert found.qpos[0, 11] == 0.9
    assert found.qpos[0, 2] == 5.0


def test_without_a_seeded_part_all_seeds_start_alike(scene: Scene) -> None:
    first, second = (starts(scene, {}, seed=seed) for seed in (0, 1))
    assert first.qpos.tobytes() == second.qpos.tobytes()


PERTURB = "perturb: {coordinates: [box.?, box.q?, hinge, '*.v'], scale: 0.01}\n"
# x y z qw qx qy qz of the box, and the hinge; then velocities of the hinge and the slide.
MOVED = [0, 1, 2, 3, 4, 5, 6, 11, 13 + 9, 13 + 10]


@pytest.fixture(scope="module")
def seeded(make_scene: Make) -> Scene:
    return make_scene(MODEL, PERTURB + INITIAL)


@given(one=st.integers(0, 2**31 - 1), other=st.integers(0, 2**31 - 1))
def test_a_seed_moves_named_coordinates_within_its_scale(
    one: int, other: int, seeded: Scene
) -> None:
    first, again, second = (starts(seeded, {}, seed=seed) for seed in (one, one, other))
    state = np.concatenate([first.qpos[0], first.qvel[0]])
    repeat = np.concatenate([again.qpos[0], again.qvel[0]])
    assert state.tobytes() == repeat.tobytes()
    assert (first.qpos.tobytes() == second.qpos.tobytes()) == (one == other)
    plain = starts(seeded, {}, seed=one).qvel[0]
    model = seeded.base({}).model
    own = np.concatenate([model.qpos0, np.zeros(model.nv)])
    own[[11, 13, 14, 13 + 8, 13 + 9]] = 0.5, 1.0, 2 * np.sin(np.radians(60)), 1.0, -0.5
    moved = np.abs(state - own)
    # A quaternion is divided by its norm again, which is between 0.99 and 1.02 for such offsets.
    assert (moved[MOVED] <= 0.01 / 0.99 + 0.02 * np.abs(own[MOVED])).all()
    assert (moved[[0, 1, 2, 11]] <= 0.01).all()
    assert np.delete(moved, MOVED).max() < 1e-15
    assert np.linalg.norm(state[3:7]) == pytest.approx(1.0, abs=1e-12)
    assert plain.tobytes() == first.qvel[0].tobytes()


def test_offsets_fill_their_range(seeded: Scene) -> None:
    heights = [starts(seeded, {}, seed=seed).qpos[0, 2] - 1.0 for seed in range(400)]
    # The mean of 400 uniform offsets in +-0.01 has a deviation of 0.01 / sqrt(1200).
    assert abs(np.mean(heights)) < 5 * 0.01 / np.sqrt(1200)
    assert min(heights) < -0.0095
    assert max(heights) > 0.0095


def test_a_bare_model_is_moved_sideways_and_at_its_joints(make_scene: Make) -> None:
    scene = make_scene(MODEL)
    own = {"keyframe": "qpos0"}
    first, second = (starts(scene, own, seed=seed) for seed in (0, 1))
    places = np.flatnonzero(first.qpos[0] != second.qpos[0])
    assert places.tolist() == [0, 1, 11, 12]
    assert np.abs(first.qpos[0] - scene.base({}).model.qpos0).max() <= 1e-4
    assert not first.qvel.any()


def test_shipped_starts_differ_by_seed_only_where_they_say() -> None:
    scene = Scene.open("box_stack")
    first, second = (starts(scene, {"boxes": 3}, seed=seed) for seed in (3, 4))
    places = np.flatnonzero(first.qpos[0] != second.qpos[0])
    assert places.tolist() == [0, 1, 7, 8, 14, 15]


def test_the_perturbation_of_a_seed_has_a_factor(make_scene: Make) -> None:
    """Factor 0 is the keyframe to the bit, 1 what a seed does, and -1 as far on the other side."""
    bare = make_scene(MODEL)
    exact, off, opposite, plain = starts(
        bare, *({"perturbation": factor} for factor in (0, 1, -1)), {}, seed=7
    ).qpos
    assert np.array_equal(exact, bare.base({}).model.key_qpos[0])
    assert np.array_equal(off, plain)
    assert not np.array_equal(off, exact)
    # Adding and taking away rounds each to half an ulp of values up to 5.
    assert off - exact == pytest.approx(exact - opposite, rel=0, abs=2e-15)
