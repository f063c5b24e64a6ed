"""Where runs start: at a keyframe with all that it holds, or at the model's own start."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from contactlab.engines import Buffers
from contactlab.engines.mujoco_batch import roll_out
from contactlab.errors import SceneError
from contactlab.scene.run_spec import run_ids
from contactlab.scene.scene import Scene

Make = Callable[..., Scene]
# A slide with an integrating servo, which has an activation, and a body that is moved by hand.
MODEL = """
<mujoco>
  <worldbody>
    <body name="hand" mocap="true" pos="0 0 1"><geom name="hand" size=".1"/></body>
    <body name="cart">
      <joint name="cart" type="slide"/><geom name="cart" size=".1"/>
    </body>
  </worldbody>
  <actuator><intvelocity name="servo" joint="cart" kp="10" actrange="-1 1"/></actuator>
  <keyframe>
    <key qpos="-.2"/>
    <key name="near" qpos=".1" qvel=".2" act=".3" ctrl=".4" mpos="1 2 3" mquat="0 1 0 0"/>
    <key name="far" qpos="9"/>
  </keyframe>
</mujoco>
"""
STILL = MODEL[: MODEL.index("<keyframe>")] + "</mujoco>"
KEYED = STILL.replace("</mujoco>", '<keyframe><key qpos=".1"/></keyframe></mujoco>')


def spec_of(scene: Scene) -> tuple[str, ...]:
    axis = scene.catalogue.find_axis("keyframe")
    assert axis is not None
    return axis.choices


def test_a_bare_model_starts_from_its_first_keyframe_with_controls(make_scene: Make) -> None:
    scene = make_scene(MODEL)
    assert spec_of(scene) == ("key[0]", "near", "far", "qpos0")
    starts = ({}, *({"keyframe": each} for each in spec_of(scene)))
    runs = [scene.resolve(each, 0, None) for each in starts]
    places = scene.initial_states(runs).qpos[:, 0]
    # The seed 0 starts as the model is written.
    assert places.tolist() == [0.1, -0.2, 0.1, 9.0, 0.0]
    ids = [scene.run_id(run) for run in runs]
    assert ids[0] == ids[2]
    assert len(set(ids)) == 4


def test_without_any_controls_it_starts_from_the_first_one(make_scene: Make) -> None:
    scene = make_scene(MODEL.replace(' ctrl=".4"', ""))
    assert scene.initial_states([scene.resolve({}, 0, None)]).qpos[:, 0].tolist() == [-0.2]


def test_what_starts_from_no_keyframe_has_the_id_of_a_model_without(make_scene: Make) -> None:
    """Ids of versions that knew no keyframes without names stay as they were."""
    manifest = "keyframe: qpos0\nperturb: {coordinates: [cart], scale: .1}\n"
    known = make_scene(KEYED.replace("<key ", '<key name="near" '), manifest)
    unknown, none = make_scene(KEYED, manifest), make_scene(STILL, manifest)

    def run_id(scene: Scene) -> str:
        return next(run_ids(scene.base({}), scene.resolve({}, 0, None), "one scene", [0]))

    ids = [run_id(scene) for scene in (none, unknown, known)]
    assert ids[0] == ids[1] != ids[2]


def test_a_manifest_says_where_to_start(make_scene: Make) -> None:
    for line, expected in (("keyframe: qpos0\n", 0.0), ("keyframe: far\n", 9.0)):
        scene = make_scene(MODEL, line)
        start = scene.initial_states([scene.resolve({}, 0, None)])
        assert start.qpos.tolist() == [[expected]]
        near = scene.initial_states([scene.resolve({"keyframe": "near"}, 0, None)])
        assert near.qpos.tolist() == [[0.1]]


def test_a_model_without_keyframes_has_no_such_axis(make_scene: Make) -> None:
    scene = make_scene(STILL)
    assert scene.catalogue.find_axis("keyframe") is None
    assert "keyframe" not in scene.resolve({}, 0, None).settings


def test_a_keyframe_that_is_not_there_is_told(make_scene: Make) -> None:
    with pytest.raises(SceneError, match="has no keyframe 'near'"):
        make_scene(STILL, "keyframe: near\n")


def test_a_value_of_that_name_is_refused(make_scene: Make) -> None:
    line = "initial: {keyframe: {default: 1, unit: m, description: d, sets: {cart: '1'}}}\n"
    with pytest.raises(SceneError, match="is the name of another axis"):
        make_scene(MODEL, line)


@pytest.mark.parametrize("keyframe", ["near", "far", "key[0]"])
def test_a_run_is_a_loop_from_that_keyframe(keyframe: str, make_scene: Make) -> None:
    """Bit for bit, with activation and the places of what is moved by hand."""
    scene = make_scene(MODEL, "pairs: [{geoms: [hand, cart]}]\n")
    run = scene.resolve({"keyframe": keyframe}, 0, None)
    model = scene.base_of(run).prepare(run.list_edits()).model
    rollout = roll_out([model], scene.initial_states([run]), 50, Buffers())
    plain = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(plain)
    index = 0 if keyframe == "key[0]" else plain.key(keyframe).id
    mujoco.mj_resetDataKeyframe(plain, data, index)
    expected = [_state(data)]
    for _ in range(50):
        mujoco.mj_step(plain, data)
        expected.append(_state(data))
    assert rollout.state[0].tobytes() == np.array(expected).tobytes()
    started = mujoco.MjData(model)
    mujoco.mj_forward(model, started)
    assert np.array_equal(started.mocap_pos, data.mocap_pos)
    assert np.array_equal(started.mocap_quat, data.mocap_quat)


def _state(data: mujoco.MjData) -> np.ndarray:
    return np.concatenate([[data.time], data.qpos, data.qvel, data.act])


def test_a_place_that_is_asked_for_comes_over_a_keyframe(make_scene: Make) -> None:
    scene = make_scene(MODEL)
    run = scene.resolve({"keyframe": "near", "body_pos[hand]": (4.0, 5.0, 6.0)}, 0, None)
    model = scene.base_of(run).prepare(run.list_edits()).model
    assert model.body("hand").pos.tolist() == [4, 5, 6]
    assert model.body("hand").quat.tolist() == [0, 1, 0, 0]
