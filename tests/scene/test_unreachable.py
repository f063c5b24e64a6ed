"""Proofs that geoms cannot touch: against closed forms, and against random configurations."""

import os

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactlab.scene.model_edits import FLAG_NAMES
from contactlab.scene.scene_source import find_scene
from contactlab.scene.unreachable import (
    Clearance,
    GeomPair,
    filtered_pairs,
    joint_ranges,
    unreachable_pairs,
)

# A rod of length 1 and radius 0.02 turns in the plane, a second one at its end; and a post.
ARM = """<mujoco>
  <compiler angle="radian"/>
  <option>{flags}</option>
  <worldbody>
    <geom name="post" type="sphere" size="0.1" pos="{post} 0 0" margin="{margin}"/>
    <body name="upper">
      <joint name="shoulder" axis="0 0 1" {shoulder}/>
      <geom name="upper" type="capsule" size="0.02" fromto="0 0 0 1 0 0"/>
      <body name="lower" pos="1 0 0">
        <joint name="elbow" axis="0 0 1" range="-1 1"/>
        <geom name="lower" type="capsule" size="0.02" fromto="0.1 0 0 0.5 0 0"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
REACH = 1.5 + 0.02 + 0.1


def arm(
    post: float, shoulder: str = 'range="-3 3"', margin: float = 0.0, flags: str = ""
) -> mujoco.MjModel:
    text = ARM.format(post=post, shoulder=shoulder, margin=margin, flags=flags)
    return mujoco.MjModel.from_xml_string(text)


def proven(model: mujoco.MjModel) -> set[tuple[str, str]]:
    found = unreachable_pairs(model, filtered_pairs(model))
    return {(model.geom(first).name, model.geom(second).name) for first, second in found}


BOTH = {("post", "upper"), ("post", "lower")}


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        pytest.param(arm(REACH + 0.01), BOTH, id="out of reach"),
        pytest.param(arm(REACH - 0.01), {("post", "upper")}, id="within reach of the second"),
        pytest.param(arm(1.1), set[tuple[str, str]](), id="within reach of both"),
        pytest.param(arm(REACH + 0.01, margin=0.02), {("post", "upper")}, id="within the margin"),
        # From 1 rad on the other side; the elbow adds 1, and each may go a tenth beyond its range.
        pytest.param(arm(-1.1, 'range="-1 1"'), BOTH, id="behind"),
        pytest.param(
            arm(-1.1, 'range="-1 1"', flags='<flag limit="disable"/>'),
            set[tuple[str, str]](),
            id="no limit holds it",
        ),
        pytest.param(arm(REACH + 0.01, 'limited="false"'), BOTH, id="all the way round"),
        pytest.param(
            arm(REACH + 0.01, margin=0.02, flags='<flag override="enable"/>'),
            BOTH,
            id="margins overridden by none",
        ),
    ],
)
def test_an_arm_reaches_as_far_as_its_links(
    model: mujoco.MjModel, expected: set[tuple[str, str]]
) -> None:
    assert proven(model) == expected


@pytest.mark.skipif("speculative" not in FLAG_NAMES, reason="speculative came with MuJoCo 4.0")
def test_nothing_is_out_of_reach_of_contacts_at_a_distance() -> None:
    assert not proven(arm(REACH + 0.01, flags='<flag speculative="enable"/>'))


def test_a_limit_that_does_not_hold_proves_nothing() -> None:
    """Joints that start beyond their limits, or get there, may get anywhere."""
    text = ARM.format(post=-1.1, shoulder='range="-1 1"', margin=0, flags="")
    inside = mujoco.MjModel.from_xml_string(text)
    outside = mujoco.MjModel.from_xml_string(
        text.replace("</mujoco>", '<keyframe><key qpos="2 0"/></keyframe></mujoco>')
    )
    pairs = filtered_pairs(inside)
    assert len(unreachable_pairs(inside, pairs)) == 2
    assert unreachable_pairs(outside, pairs) == set()
    assert len(unreachable_pairs(inside, pairs, [np.array([[1.1, 0.0]])])) == 2
    assert unreachable_pairs(inside, pairs, [np.array([[1.1, 0.0], [1.3, 0.0]])]) == set()


LOOSE = """<mujoco>
  <asset><hfield name="hills" nrow="2" ncol="2" size="1 1 0.1 0.1" elevation="0 0 0 0"/></asset>
  <worldbody>
    <geom name="post" {post}/>
    <body {body}>{joint}<geom name="far" type="sphere" size="0.1" pos="9 0 0"/></body>
  </worldbody>
</mujoco>
"""
POST, HINGE = 'type="sphere" size="0.1"', "<joint/>"


@pytest.mark.parametrize(
    ("post", "body", "joint"),
    [
        pytest.param(POST, "", "<freejoint/>", id="free"),
        pytest.param(POST, "", '<joint type="ball"/>', id="ball"),
        pytest.param(POST, "", '<joint type="slide"/>', id="slide"),
        pytest.param('type="hfield" hfield="hills"', "", HINGE, id="height field"),
        pytest.param('type="plane" size="1 1 1"', "", "<freejoint/>", id="plane"),
    ],
)
def test_what_has_no_bound_is_never_proven(post: str, body: str, joint: str) -> None:
    model = mujoco.MjModel.from_xml_string(LOOSE.format(post=post, body=body, joint=joint))
    assert len(filtered_pairs(model)) == 1
    assert proven(model) == set()


def test_with_bounds_it_is() -> None:
    """The same bodies, on joints that bound where they get."""
    slide = '<joint type="slide" axis="1 0 0" range="-8.5 0" limited="true"/>'
    for joint in (HINGE, slide.replace("8.5", "7")):
        model = mujoco.MjModel.from_xml_string(LOOSE.format(post=POST, body="", joint=joint))
        assert proven(model) == {("post", "far")}
    # A tenth of the range further it would be 8.8 + 0.2 from the middle of the post.
    model = mujoco.MjModel.from_xml_string(
        LOOSE.format(post=POST, body="", joint=slide.replace("8.5", "8"))
    )
    assert proven(model) == set()


def test_pairs_that_a_model_lists_touch_whatever_masks_say() -> None:
    text = ARM.format(post=9, margin=0, shoulder="", flags="")
    pair = '<contact><pair geom1="post" geom2="lower"/></contact></mujoco>'
    model = mujoco.MjModel.from_xml_string(text.replace("</mujoco>", pair))
    assert filtered_pairs(model) == [(0, 1)]


@st.composite
def trees(draw: st.DrawFn) -> str:
    """Draw a tree of up to six bodies on hinges and slides, with one or two geoms each."""
    number = st.floats(-0.5, 0.5, width=16)

    def triple() -> str:
        return " ".join(str(draw(number)) for _ in range(3))

    def body(depth: int) -> str:
        kind = draw(st.sampled_from(["hinge", "hinge", "slide"]))
        axis = draw(st.sampled_from(["1 0 0", "0 1 0", "0 0 1", "1 1 1"]))
        low = draw(st.floats(-1.5, 0, width=16))
        joint = f'type="{kind}" axis="{axis}" range="{low} {low + 1.5}" pos="{triple()}"'
        shape = draw(st.sampled_from(["box", "capsule", "sphere", "ellipsoid"]))
        geom = f'<geom type="{shape}" size="0.1 0.15 0.05" pos="{triple()}" euler="{triple()}"/>'
        inner = "".join(body(depth - 1) for _ in range(draw(st.integers(0, 2)) if depth else 0))
        return f'<body pos="{triple()}" euler="{triple()}"><joint {joint}/>{geom}{inner}</body>'

    bodies = "".join(body(2) for _ in range(draw(st.integers(1, 2))))
    compiler = '<compiler angle="radian"/><default><geom margin="0.01"/></default>'
    fixed = '<geom type="box" size="0.1 0.1 0.1" pos="0.6 0 0"/>'
    return f"<mujoco>{compiler}<worldbody>{fixed}{bodies}</worldbody></mujoco>"


def met(model: mujoco.MjModel, configurations: int, seed: int = 1) -> set[GeomPair]:
    """Return the pairs that touch in random configurations, one in four at ends of ranges."""
    generator, found = np.random.default_rng(seed), set[GeomPair]()
    low, high = joint_ranges(model, ()).T
    known = np.isfinite(low) & np.isfinite(high)
    data = mujoco.MjData(model)
    for _ in range(configurations):
        data.qpos[:] = model.qpos0
        share = generator.uniform(size=known.sum())
        share = np.where(generator.uniform(size=len(share)) < 0.25, share.round(), share)
        data.qpos[model.jnt_qposadr[known]] = low[known] + share * (high - low)[known]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        found |= {(int(a), int(b)) for a, b in np.sort(data.contact.geom, axis=1)}
    return found


@pytest.mark.long
@settings(max_examples=25)
@given(text=trees())
def test_no_configuration_of_random_trees_brings_proven_pairs_together(text: str) -> None:
    model = mujoco.MjModel.from_xml_string(text)
    found = unreachable_pairs(model, filtered_pairs(model))
    assert not found & met(model, 200)


@pytest.mark.long
@settings(max_examples=25)
@given(text=trees(), seed=st.integers(0, 99))
def test_a_joint_moves_geoms_no_further_than_its_lever(text: str, seed: int) -> None:
    """Distances change by no more than levers times ways; distances are good to 1e-6 m."""
    model = mujoco.MjModel.from_xml_string(text)
    clearance, generator = Clearance(model, ()), np.random.default_rng(seed)
    low, high = clearance.ranges.T
    first, second = (generator.uniform(low, high) for _ in range(2))
    for pair in filtered_pairs(model):
        levers = clearance.motion_bounds(pair)
        assert levers is not None
        apart: list[float] = []
        for qpos in (first, second):
            clearance.set_configuration(qpos)
            apart.append(max(clearance.measure_distance(*pair, 10.0), 0.0))
        assert abs(apart[0] - apart[1]) <= levers @ np.abs(first - second) + 1e-5


@pytest.mark.parametrize("name", ["grasp_mug", "free_arm", "ragdoll"])
def test_no_configuration_of_shipped_models_brings_proven_pairs_together(name: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(find_scene(name).model))
    assert not unreachable_pairs(model, filtered_pairs(model)) & met(model, 300)


@pytest.mark.long
@pytest.mark.skipif(
    "MENAGERIE_ROOT" not in os.environ,
    reason="MENAGERIE_ROOT names no folder with the robot's meshes",
)
def test_the_panda_is_proven_right() -> None:
    """Of its 184 pairs a fifth at least; 2000 configurations bring none of these together."""
    source = find_scene("menagerie:franka_emika_panda/panda")
    model = mujoco.MjModel.from_xml_path(str(source.model))
    found = unreachable_pairs(model, filtered_pairs(model))
    assert len(found) > 36
    assert not found & met(model, 2000)
