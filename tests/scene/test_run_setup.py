"""The yardsticks of a group of runs: what is free, passive, thick, and what bars the way."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.contact.trace_setup import Setup
from contactlab.scene.run_setup import make_setup
from contactlab.scene.scene import Scene

Make = Callable[..., Scene]
BALL = "<worldbody><body name='b'><freejoint/><geom size='.1'/></body></worldbody>"


def setup(scene: Scene, *values: dict[str, Any], **thresholds: float) -> Setup:
    runs = [scene.resolve(each, 0, None) for each in values or ({},)]
    base = scene.base(runs[0].structure)
    models = [base.prepare(run.list_edits()).model for run in runs]
    return make_setup(base, scene.source.manifest, runs, models, thresholds)


def test_shipped_ball() -> None:
    found = setup(
        Scene.open("ball_drop"),
        {"mass": 3.0, "cone": "elliptic", "iterations": 7},
        {"gravity": (0.0, 1.0, -2.0), "drop_height": 0.5},
        invented=4.0,
    )
    assert found.elliptic.tolist() == [True, False]
    assert found.iterations.tolist() == [7, 100]
    assert found.gravity.tolist() == [[0, 0, -9.81], [0, 1, -2]]
    assert found.passive
    assert found.quaternions == (3,)
    (body,) = found.free_bodies
    assert (body.name, body.qpos, body.dof) == ("ball", 0, 0)
    assert body.mass.tolist() == [3.0, 1.0]
    (barrier,) = found.barriers
    assert barrier.reach == np.inf
    assert barrier.normal.tolist() == [0, 0, 1]
    assert found.thickness.tolist() == [0.05]
    assert found.settings["drop_height"] == [1.0, 0.5]
    assert found.settings["mass"] == [3.0, 1.0]
    assert found.thresholds["invented"] == 4.0
    assert found.oracle == "restitution"


def test_shares_of_mass_do_not_depend_on_other_runs() -> None:
    scene, values = Scene.open("ball_drop"), [{"mass": each} for each in np.linspace(0.1, 3, 30)]
    together = setup(scene, *values)
    for run, each in enumerate(values):
        (own,), (alone,) = together.select([run]).free_bodies, setup(scene, each).free_bodies
        assert (own.share, own.mass) == (alone.share, alone.mass)


def test_gravity_that_is_switched_off(make_scene: Make) -> None:
    text = f"<mujoco><option><flag gravity='disable'/></option>{BALL}</mujoco>"
    assert setup(make_scene(text)).gravity.tolist() == [[0, 0, 0]]


@pytest.mark.parametrize(
    ("shape", "half"),
    [
        ("type='sphere' size='.3'", 0.3),
        ("type='capsule' size='.2 .05'", 0.2),
        ("type='cylinder' size='.2 .05'", 0.05),
        ("type='cylinder' size='.05 .2'", 0.05),
        ("type='box' size='.3 .1 .2'", 0.1),
        ("type='ellipsoid' size='.3 .1 .2'", 0.1),
    ],
)
def test_thickness_is_that_of_the_thinnest_geom(shape: str, half: float, make_scene: Make) -> None:
    scene = make_scene(
        f"<mujoco><worldbody><geom type='plane' size='1 1 1'/><body pos='0 0 1'><freejoint/>"
        f"<geom {shape}/></body><body pos='2 0 1'><freejoint/><geom size='.5'/></body></worldbody>"
        "</mujoco>"
    )
    thickness = setup(scene).thickness
    names = [pair.name for pair in scene.base({}).pairs]
    assert dict(zip(names, thickness, strict=True)) == pytest.approx(
        {"geom[0]-geom[1]": half, "geom[0]-geom[2]": 0.5, "geom[1]-geom[2]": half}
    )


def test_barriers_are_fixed_planes_and_boxes_before_free_bodies(make_scene: Make) -> None:
    scene = make_scene(
        """
        <mujoco><worldbody>
          <geom name="floor" type="plane" size="1 1 1" euler="90 0 0" pos="1 2 3"/>
          <geom name="wall" type="box" size=".5 .01 .4" euler="0 0 90" pos="0 0 9"/>
          <geom name="post" type="cylinder" size=".1 .3" pos="5 0 0"/>
          <body name="free" pos="0 0 5"><freejoint/><geom name="core" size=".1"/>
            <body><geom name="shell" size=".1" pos="0 .3 0"/></body></body>
          <body name="door" pos="0 0 7"><joint/><geom name="door" size=".1"/></body>
        </worldbody></mujoco>"""
    )
    found = setup(scene)
    pairs = scene.base({}).pairs
    barred = {(pairs[each.pair].sides, each.body.name) for each in found.barriers}
    expected = {(wall, part) for wall in ("floor", "wall") for part in ("core", "shell")}
    assert barred == {(sides, "free") for sides in expected}
    for barrier in found.barriers:
        if pairs[barrier.pair].sides[0] == "wall":
            # Turned about z, its thin y axis lies along x; its face is 0.4 m short of its centre.
            assert np.abs(barrier.normal) == pytest.approx([1, 0, 0], abs=1e-12)
            assert barrier.point == pytest.approx([0, 0, 9])
            assert barrier.reach == 0.4
        else:
            assert barrier.normal == pytest.approx([0, -1, 0], abs=1e-12)
            assert barrier.point == pytest.approx([1, 2, 3])


DRIVEN = {
    "motor": "<actuator><motor joint='j'/></actuator>",
    "wind": "<option wind='1 0 0'/>",
    "held up": None,
}


@pytest.mark.parametrize("case", DRIVEN)
def test_what_is_driven_is_not_passive(case: str, make_scene: Make) -> None:
    extra = DRIVEN[case]
    held = "" if extra else "gravcomp='1'"
    text = (
        f"<mujoco>{extra or ''}<worldbody><body name='b' {held}><joint name='j'/><geom size='.1'/>"
        "</body></worldbody></mujoco>"
    )
    assert not setup(make_scene(text)).passive


FLEX = """<flexcomp name='f' type='grid' dim='1' count='3 1 1' spacing='.1 .1 .1' mass='1'>
<edge stiffness='9'/></flexcomp>"""
SPRINGS = {
    "joint": ("<joint stiffness='1'/><geom size='.1'/>", True),
    "flex": (FLEX, True),
    "none": ("<joint/><geom size='.1'/>", False),
}


@pytest.mark.parametrize("case", SPRINGS)
def test_springs_are_of_joints_and_of_flexes(case: str, make_scene: Make) -> None:
    inner, stores = SPRINGS[case]
    text = f"<mujoco><worldbody><body name='b'>{inner}</body></worldbody></mujoco>"
    assert setup(make_scene(text)).springs == stores


def test_a_run_that_holds_a_body_up_is_not_passive(make_scene: Make) -> None:
    text = "<mujoco><worldbody><body name='b'><joint/><geom size='.1'/></body></worldbody></mujoco>"
    scene = make_scene(text)
    assert setup(scene).passive
    assert not setup(scene, {}, {"body_gravcomp[b]": 1.0}).passive


def test_pushes_are_not_passive(make_scene: Make) -> None:
    text = f"<mujoco>{BALL}</mujoco>"
    push = "initial: {f: {default: 0, unit: N, description: d, sets: {b.fx: f}}}\n"
    move = "initial: {f: {default: 0, unit: m/s, description: d, sets: {b.vx: f}}}\n"
    assert not setup(make_scene(text, push)).passive
    assert setup(make_scene(text, move)).passive


FREE = (
    "<body><freejoint/><geom size='.1'/><body pos='0 0 .3'><joint/><geom size='.1'/></body></body>"
)


@pytest.mark.parametrize(
    ("option", "world", "free"),
    [
        ("gravity='0 0 0'", FREE, True),
        ("gravity='0 0 0'", FREE + FREE.replace("<body>", "<body pos='1 0 0'>", 1), True),
        ("", FREE, False),
        ("gravity='0 0 0'", FREE + "<geom type='plane' size='1 1 1'/>", False),
        ("gravity='0 0 0'", FREE + "<body><joint/><geom size='.1'/></body>", False),
        ("gravity='0 0 0'", FREE + "<body mocap='true'><geom size='.1'/></body>", False),
        ("gravity='0 0 0' density='1'", FREE, False),
        ("gravity='0 0 0' viscosity='1'", FREE, False),
        ("gravity='0 0 0'", "", False),
    ],
)
def test_a_free_system_is_recorded_with_its_momentum(
    option: str, world: str, free: bool, make_scene: Make
) -> None:
    base = make_scene(f"<mujoco><option {option}/><worldbody>{world}</worldbody></mujoco>").base({})
    assert base.free is free
    assert (base.layout.momentum is not None) is free
    assert (base.layout.angular_momentum is not None) is free


def test_speculative_contacts_are_known() -> None:
    if not hasattr(mujoco.mjtEnableBit, "mjENBL_SPECULATIVE"):
        pytest.skip("this engine makes none")
    found = setup(Scene.open("ball_drop"), {"speculative": True}, {})
    assert found.speculative is not None
    assert found.speculative.tolist() == [True, False]


def test_thickness_is_that_of_what_can_touch() -> None:
    """Pads are 8 mm thick; the hollow mug's walls 4 mm, and its solid 80 mm."""
    scene = Scene.open("grasp_mug")
    hollow, solid = (setup(scene, {"shape": shape}) for shape in (1, 2))
    assert hollow.thickness.tolist() == [0.002, 0.002]
    assert solid.thickness.tolist() == [0.004, 0.004]
