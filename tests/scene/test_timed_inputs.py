"""What a manifest says of a hold: sensors against kinematics, windows, mistakes."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.engines import Buffers
from contactlab.engines.mujoco_batch import roll_out
from contactlab.engines.rollout_trace import make_trace
from contactlab.errors import SceneError
from contactlab.scene.run_setup import make_setup
from contactlab.scene.scene import Scene

Make = Callable[..., Scene]
MODEL = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body name="hand" pos="0.1 0.2 1" euler="20 -30 40">
      <joint name="wave" axis="1 2 3"/><geom name="hand" size=".05" pos=".1 0 0"/>
    </body>
    <body name="mug" pos=".5 0 .3">
      <freejoint name="mug"/>
      <geom name="mug" type="box" size=".05 .03 .02" pos=".01 .02 .03"/>
    </body>
  </worldbody>
</mujoco>
"""
TEXT = (
    "subject: mug\npairs: [{geoms: [floor, mug]}]\n"
    "initial: {wait: {default: 0.02, unit: s, description: w}}\n"
)


def test_the_subject_is_seen_from_its_holder(make_scene: Make) -> None:
    """Place and turn are those of the bodies' own frames, which kinematics gives as well."""
    scene = make_scene(MODEL, TEXT + "hold: {from: 0.02, to: 0.1, relative_to: hand}\n")
    run = scene.resolve({}, 0, None)
    base = scene.base({})
    prepared = base.prepare({})
    rollout = roll_out([prepared.model], scene.initial_states([run]), run.steps, Buffers())
    held = make_trace(base, [prepared], rollout).held_pose
    assert held is not None
    data = mujoco.MjData(prepared.model)
    for step in range(0, run.steps, 7):
        data.qpos[:] = rollout.state[0, step, 1 : 1 + prepared.model.nq]
        mujoco.mj_kinematics(prepared.model, data)
        hand, mug = data.body("hand"), data.body("mug")
        expected = hand.xmat.reshape(3, 3).T @ (mug.xpos - hand.xpos)
        assert held.position[0, step] == pytest.approx(expected, abs=1e-12)
        assert held.rotation[0, step] == pytest.approx(hand.xquat, abs=1e-12)


def test_without_a_holder_it_is_the_world(make_scene: Make) -> None:
    scene = make_scene(MODEL, TEXT + "hold: {from: 0, to: 0.1}\n")
    run = scene.resolve({}, 0, None)
    base = scene.base({})
    rollout = roll_out([base.model], scene.initial_states([run]), 20, Buffers())
    held = make_trace(base, [base.prepare({})], rollout).held_pose
    assert held is not None
    mug = 1 + int(base.model.joint("mug").qposadr[0])
    assert held.position[0] == pytest.approx(rollout.state[0, :-1, mug : mug + 3], abs=1e-12)
    assert held.rotation[0] == pytest.approx(np.tile([1.0, 0, 0, 0], (20, 1)))


def test_windows_follow_initial_values(make_scene: Make) -> None:
    scene = make_scene(MODEL, TEXT + "hold: {from: wait, to: wait + 0.05, relative_to: hand}\n")
    runs = [scene.resolve(values, 0, None) for values in ({}, {"wait": 0.04})]
    base = scene.base({})
    models = [base.prepare({}).model for _ in runs]
    hold = make_setup(base, scene.source.manifest, runs, models, {}).hold
    assert hold is not None
    assert hold.start.tolist() == [0.02, 0.04]
    assert hold.stop == pytest.approx([0.07, 0.09])
    late = [scene.resolve({"wait": -1.0}, 0, None)]
    with pytest.raises(SceneError, match="hold goes from -1 s"):
        make_setup(base, scene.source.manifest, late, models[:1], {})


def test_without_a_hold_nothing_is_added(make_scene: Make) -> None:
    scene = make_scene(MODEL, TEXT)
    run = scene.resolve({}, 0, None)
    base = scene.base({})
    assert base.holding is None
    assert make_setup(base, scene.source.manifest, [run], [base.model], {}).hold is None
    rollout = roll_out([base.model], scene.initial_states([run]), 3, Buffers())
    assert make_trace(base, [base.prepare({})], rollout).held_pose is None


@pytest.mark.parametrize(
    ("hold", "message"),
    [
        (
            "{from: 0.02, to: 0.1, relative_to: hands}",
            "relative_to names 'hands', which is not a body.*hand",
        ),
        ("{from: 0.05, to: 0.02}", "hold goes from 0.05 s to 0.02 s"),
        ("{from: 0.05, to: 0.2}", "hold ends at 0.2 s, after the run, which takes 0.1 s"),
        ("{from: 0.05, to: later}", "unknown later"),
        ("{from: 0.05}", "hold.to: it is missing"),
        ("{from: 0.05, to: 0.1, by: hand}", "hold.by: unknown key"),
    ],
)
def test_mistakes_say_what_and_where(hold: str, message: str, make_scene: Make) -> None:
    with pytest.raises(SceneError, match=rf"scene.yaml(.|\n)*{message}"):
        make_scene(MODEL, f"{TEXT}hold: {hold}\n")


def test_a_hold_needs_a_subject(make_scene: Make) -> None:
    with pytest.raises(SceneError, match="name the held body in `subject`"):
        make_scene(MODEL, "hold: {from: 0, to: 0.1}\n")


STRUCTURE = (
    "structure: {{width: {{default: {default}, unit: m, description: w, {rest}, "
    "element: './/body[@name=\"mug\"]', attribute: pos}}}}\n"
)


@pytest.mark.parametrize(
    ("text", "expected"),
    [('"0.1 {} 0.5"', [0.1, 0.2, 0.5]), ('"0 {width / 2 + 0.004} -{}"', [0, 0.104, -0.2])],
)
def test_a_structure_writes_its_text(text: str, expected: list[float], make_scene: Make) -> None:
    scene = make_scene(MODEL, STRUCTURE.format(default=0.1, rest=f"text: {text}"))
    model = scene.base({"width": 0.2}).model
    assert model.body("mug").pos == pytest.approx(expected)


def test_a_text_that_cannot_be_computed_is_said(make_scene: Make) -> None:
    with pytest.raises(SceneError, match=r"structure 'width': cannot compute \{height / 2\}: "):
        make_scene(MODEL, STRUCTURE.format(default=0.1, rest='text: "0 {height / 2} 0"'))


@pytest.mark.parametrize(
    ("rest", "fine", "wrong"),
    [("unit: m", 0.1, 0.0), ("least: 0.0", 0.0, -0.1), ("integer: true, least: 0", 0, -1)],
)
def test_least_values(rest: str, fine: Any, wrong: Any, make_scene: Make) -> None:
    rest = rest.replace("unit: m", "integer: false")
    text = STRUCTURE.format(default=1, rest=f'{rest}, text: "0 {{}} 0.3"')
    axis = make_scene(MODEL, text).catalogue.find_axis("width")
    assert axis is not None
    assert axis.parse(fine) == fine
    with pytest.raises(ValueError, match="write a"):
        axis.parse(wrong)
