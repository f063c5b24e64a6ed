"""Masses and inertias that no body has: each planted fault is found, and what is sound is not."""

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from contactlab import resources
from contactlab.errors import SceneError
from contactlab.scene.body_inertia import (
    hull_volume,
    in_words,
    inertia_faults,
    scene_inertia_faults,
)
from contactlab.scene.compile_model import InertiaFault, compile_model, written_inertia_faults
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import SceneSource, find_scene

Write = Callable[[Path, Mapping[str, str]], None]
Lengths = st.tuples(*[st.floats(0.01, 0.5)] * 3)
# A box of water, 0.2 x 0.1 x 0.1 m: 2 kg, and m (b^2 + c^2) / 12 about each axis.
BOX = '<geom type="box" size=".1 .05 .05"/>'
SOUND = 'mass="2" pos="0 0 0" diaginertia="0.0033333 0.0083333 0.0083333"'


def text(inertial: str, compiler: str = "", geom: str = BOX, joint: str = "<freejoint/>") -> str:
    return (
        f"<mujoco><compiler {compiler}/><worldbody><body name='sound' pos='1 0 0'>"
        f"<freejoint/>{BOX}</body><body name='faulty'>{joint}<inertial {inertial}/>{geom}</body>"
        "</worldbody></mujoco>"
    )


def model_of(inertial: str, **parts: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(text(inertial, **parts))


def kinds(faults: tuple[InertiaFault, ...]) -> list[tuple[str, str]]:
    return [(each.body, each.kind) for each in faults]


def test_what_is_sound_has_no_fault() -> None:
    assert inertia_faults(model_of(SOUND)) == ()
    assert list(written_inertia_faults(mujoco.MjSpec.from_string(text(SOUND)))) == []


@pytest.mark.parametrize(
    ("inertial", "geom", "kind", "value", "limit"),
    [
        # 60 kg and 2 g in 2 l.
        ('mass="60" pos="0 0 0" diaginertia=".3 .3 .3"', BOX, "density", 3e4, 2e4),
        ('mass=".002" pos="0 0 0" diaginertia="3e-6 8e-6 8e-6"', BOX, "density", 1.0, 50.0),
        # The centre is 0.05 m beyond the end of 0.1 m; 5 % of 0.2 m are allowed.
        (SOUND.replace('"0 0 0"', '".15 0 0"'), BOX, "outside", 0.05, 0.01),
        # sqrt((B + C - A) / 2 / m) = sqrt(.19 / 2 / 2), where the shape is 0.2 m long.
        ('mass="2" pos="0 0 0" diaginertia=".01 .1 .1"', BOX, "too_large", 0.21794, 0.2),
        # sqrt((A + B + C) / 2 / m) = sqrt(2.01 / 2 / 2); twice the diagonal to a corner.
        ('mass="2" pos="0 0 0" diaginertia=".01 1 1"', BOX, "beyond", 0.70887, 0.24495),
        # A thirtieth of 2 m: sqrt(3 1e-3 / 2 / 2) = 27.4 mm is nearer than 66.7 mm.
        (
            'mass="2" pos="0 0 0" diaginertia="1e-3 1e-3 1e-3"',
            '<geom type="capsule" size=".02" fromto="-.98 0 0 .98 0 0"/>',
            "too_small",
            0.027386,
            2 / 30,
        ),
        # Without a shape: sqrt(3/5) (3 2 / (4 pi 2e4))^(1/3) = 22.3 mm.
        ('mass="2" pos="0 0 0" diaginertia="1e-6 1e-6 1e-6"', "", "too_small", 8.66e-4, 0.022323),
    ],
)
def test_a_planted_fault_is_found(
    inertial: str, geom: str, kind: str, value: float, limit: float
) -> None:
    (fault,) = inertia_faults(model_of(inertial, geom=geom))
    assert (fault.body, fault.kind) == ("faulty", kind)
    assert fault.value == pytest.approx(value, rel=1e-3)
    assert fault.limit == pytest.approx(limit, rel=1e-3)
    assert fault.reason


@given(Lengths, st.floats(60, 15000), st.sampled_from(["box", "ellipsoid"]))
def test_no_solid_of_a_material_has_a_fault(
    size: tuple[float, float, float], density: float, shape: str
) -> None:
    geom = f'<geom type="{shape}" size="{size[0]} {size[1]} {size[2]}" density="{density}"/>'
    turned = f'<body euler="20 30 40"><freejoint/>{geom}</body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{turned}</worldbody></mujoco>")
    assert inertia_faults(model) == ()


@pytest.mark.parametrize(
    "geom",
    [
        '<geom size=".1"/>',
        '<geom type="capsule" size=".1 .2"/>',
        '<geom type="cylinder" size=".1 .2"/>',
        '<geom type="ellipsoid" size=".1 .2 .3"/>',
        '<geom type="box" size=".1 .2 .3"/>',
        '<geom type="mesh" mesh="wedge"/>',
    ],
)
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_the_density_of_every_shape_is_its_own(geom: str, factor: float) -> None:
    """MuJoCo gives a mass of density times volume; just beyond 20,000 it is a fault."""
    dense = geom.replace("/>", f' density="{20000 * factor}" euler="10 20 30" pos="1 2 3"/>')
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><asset><mesh name='wedge' vertex='0 0 0 .1 0 0 0 .1 0 0 0 .1'/></asset>"
        f"<worldbody><body><freejoint/>{dense}</body></worldbody></mujoco>"
    )
    found = [each for each in inertia_faults(model) if each.kind == "density"]
    assert len(found) == (factor > 1)
    for fault in found:
        assert fault.value == pytest.approx(20000 * factor, rel=1e-5)


def test_the_hull_of_a_mesh_is_that_of_qhull() -> None:
    """Its volume is read of the faces that MuJoCo collides with."""
    points = np.random.default_rng(1).normal(size=(40, 3)) * [0.1, 0.2, 0.3]
    vertex = " ".join(map(str, points.ravel()))
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><asset><mesh name='cloud' vertex='{vertex}'/></asset><worldbody>"
        "<geom type='mesh' mesh='cloud'/></worldbody></mujoco>"
    )
    assert model.mesh_graphadr[0] >= 0
    # Vertices are single precision.
    assert hull_volume(model, 0) == pytest.approx(ConvexHull(points).volume, rel=1e-5)


@given(
    st.tuples(*[st.integers(-999, 999).map(lambda each: each / 999)] * 3).filter(
        lambda each: np.linalg.norm(each) > 0.1
    ),
    st.sampled_from(["capsule", "cylinder", "ellipsoid", "box", "mesh"]),
)
def test_extents_hold_every_point_of_a_shape(
    direction: tuple[float, float, float], shape: str
) -> None:
    """A body whose centre lies at a shape's farthest point has no fault; beyond it, it has."""
    along = np.array(direction) / np.linalg.norm(direction)
    reach, geom = _farthest(shape, along)
    for share, expected in ((0.99, 0), (2.5, 1)):
        place = " ".join(map(str, share * reach))
        model = mujoco.MjModel.from_xml_string(
            "<mujoco><asset><mesh name='m' inertia='exact' vertex='-.1 -.1 -.1 .1 -.1 -.1 -.1 .1 "
            "-.1 -.1 -.1 .1 .1 .1 .1'/></asset><worldbody><body><freejoint/>"
            f"<inertial mass='1' pos='{place}' diaginertia='1e-3 1e-3 1e-3'/>{geom}</body>"
            "</worldbody></mujoco>"
        )
        faults = [each for each in inertia_faults(model) if each.kind == "outside"]
        assert len(faults) == expected


def _farthest(shape: str, along: np.ndarray) -> tuple[np.ndarray, str]:
    """Return the point of a shape that is farthest along a direction, and the shape."""
    size = np.array([0.1, 0.2, 0.3])
    straight = np.sign(along) * size
    flat = np.append(along[:2] / max(float(np.linalg.norm(along[:2])), 1e-9), 0.0)
    end = np.array([0, 0, np.sign(along[2])])
    corners = 0.1 * np.array([[-1, -1, -1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1], [1, 1, 1]])
    points = {
        "box": straight,
        "ellipsoid": size**2 * along / np.linalg.norm(size * along),
        "capsule": 0.1 * along + 0.2 * end,
        "cylinder": 0.1 * flat + 0.2 * end,
        "mesh": corners[np.argmax(corners @ along)],
    }
    sizes = {"mesh": 'mesh="m"'}.get(shape, 'size=".1 .2 .3"')
    return points[shape], f'<geom type="{shape}" {sizes}/>'


@pytest.mark.parametrize(
    ("inertial", "kind", "value"),
    [
        ('mass="1" pos="0 0 0" diaginertia="1 1 3"', "triangle", 3.0),
        ('mass="1" pos="0 0 0" fullinertia="2 2 1 1 0 0"', "triangle", 3.0),
        ('mass="1" pos="0 0 0" fullinertia="1 1 1 2 0 0"', "not_positive", -1.0),
        ('mass="1" pos="0 0 0" diaginertia="1 1 0"', "not_positive", 0.0),
        ('mass="0" pos="0 0 0" diaginertia="1 1 1"', "not_positive", 0.0),
        ('mass="-1" pos="0 0 0" diaginertia="1 1 1"', "not_positive", -1.0),
    ],
)
def test_what_unread_is_found_and_told(
    inertial: str, kind: str, value: float, tmp_path: Path
) -> None:
    (tmp_path / "robot.xml").write_text(text(inertial))
    source = find_scene("robot.xml", tmp_path)
    (fault,) = written_inertia_faults(mujoco.MjSpec.from_string(text(inertial)))
    assert (fault.body, fault.kind) == ("faulty", kind)
    assert fault.value == pytest.approx(value, abs=1e-12)
    with pytest.raises(SceneError, match="does not compile") as caught:
        Scene(source)
    assert f"body 'faulty': {fault.reason}" in str(caught.value)


def faults_of(source: SceneSource) -> tuple[InertiaFault, ...]:
    return scene_inertia_faults(source, {}, compile_model(source, {}, lambda _: None))


def test_a_balanced_inertia_is_told_although_it_compiles(tmp_path: Path) -> None:
    wrong = 'mass="2" pos="0 0 0" diaginertia=".001 .001 .01"'
    (tmp_path / "robot.xml").write_text(text(wrong, 'balanceinertia="true"'))
    (fault,) = faults_of(find_scene("robot.xml", tmp_path))
    assert (fault.body, fault.kind, fault.value, fault.limit) == ("faulty", "balanced", 0.01, 0.002)
    assert "mean, 0.004" in fault.reason


def test_an_inertia_that_is_not_used_is_no_fault() -> None:
    wrong = 'mass="1" pos="0 0 0" diaginertia="1 1 3"'
    spec = mujoco.MjSpec.from_string(text(wrong, 'inertiafromgeom="true"'))
    assert list(written_inertia_faults(spec)) == []


@pytest.mark.parametrize(
    ("body", "compiles"),
    [
        ("<joint/>", False),
        ("<joint/><body name='end'><geom size='.1'/></body>", True),
        ("<joint/><body name='end'><joint/><geom size='.1'/></body>", False),
        ("<joint/><geom size='.1'/><body name='end'/>", True),
        ("<joint/><geom size='.1'/><body name='end'><inertial pos='0 0 0' mass='1'/></body>", True),
        (
            (
                "<joint/><inertial pos='0 0 0' mass='1' diaginertia='0 0 0'/>"
                "<body name='end'><geom size='.1'/></body>"
            ),
            True,
        ),
    ],
)
def test_what_moves_alone_needs_an_inertia(body: str, compiles: bool) -> None:
    spec = mujoco.MjSpec.from_string(
        f"<mujoco><worldbody><body name='first'>{body}</body></worldbody></mujoco>"
    )
    assert (list(written_inertia_faults(spec)) == []) == compiles
    if compiles:
        assert inertia_faults(spec.compile()) == ()
    else:
        with pytest.raises(ValueError, match="must be larger"):
            spec.compile()


def test_bodies_beyond_one_limit_are_told_in_one_line() -> None:
    """All but the first by name: a robot of hollow shells is no wall of text."""
    shell = BOX.replace("/>", ' mass=".001"/>')
    bodies = "".join(f"<body name='{name}'><freejoint/>{shell}</body>" for name in "abc")
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    faults = inertia_faults(model)
    assert kinds(faults) == [(name, "density") for name in "abc"]
    [line] = in_words(faults)
    assert line == f"body 'a': {faults[0].reason}; likewise 'b', 'c'"
    many = [replace(faults[0], body=str(number)) for number in range(9)]
    [line] = in_words(many)
    assert line.endswith("; likewise '1', '2', '3', '4', '5', '6', 2 more")
    [*lines] = in_words([faults[0], replace(faults[1], limit=faults[1].limit + 1)])
    assert len(lines) == 2


def test_a_fault_of_another_kind_stays_what_it_is(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text(text(SOUND, geom='<geom type="cube" size="1"/>'))
    with pytest.raises(SceneError, match="cube"):
        faults_of(find_scene("robot.xml", tmp_path))


def test_urdf_is_read_as_well(tmp_path: Path) -> None:
    link = (
        '<link name="arm"><inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="3" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    joint = '<joint name="j" type="continuous"><parent link="base"/><child link="arm"/></joint>'
    robot = f'<robot name="r"><link name="base"/>{link}{joint}</robot>'
    (tmp_path / "robot.urdf").write_text(robot)
    with pytest.raises(SceneError, match="body 'arm': its principal moments are 1, 1, 3"):
        faults_of(find_scene("robot.urdf", tmp_path))


# Scenes that are what their case asks for, not what could be built.
UNREAL = {
    "heavy_on_light": {("heavy", "density"), ("heavy", "too_small")},
    "light_on_heavy": {
        (box, kind) for box in ("box0", "box1") for kind in ("density", "too_small")
    },
    # A rod that moves in a plane, with the same moment about every axis.
    "painleve_rod": {("rod", "too_large")},
    "stiff_joint": {("rod", "too_large")},
    "rest_penetration": {("ball", "density")},
    "tumbling_box": {("box", "density")},
    "panda_free": {("link1", "too_large"), ("link2", "too_large")},
}


@pytest.mark.parametrize("name", resources.scene_names())
def test_shipped_scenes(name: str) -> None:
    found = set(kinds(faults_of(find_scene(name))))
    if name == "rolling_plate":
        assert {kind for _, kind in found} == {"density"}
    else:
        assert found == UNREAL.get(name, set())


def test_the_identified_inertias_are_those_of_bodies() -> None:
    """Positive and within the triangle, as Gaz et al. demand of them."""
    spec = mujoco.MjSpec.from_file(str(resources.MODELS / "panda_free" / "scene.xml"))
    assert list(written_inertia_faults(spec)) == []
    moments = np.sort(spec.compile().body_inertia[1:], axis=1)
    assert moments.min() > 0
    assert (moments[:, 0] + moments[:, 1] >= moments[:, 2]).all()


@pytest.mark.long
@pytest.mark.skipif(
    "MENAGERIE_ROOT" not in os.environ,
    reason="MENAGERIE_ROOT names no folder with the robot's meshes",
)
def test_three_links_of_the_panda_are_larger_than_their_shapes() -> None:
    """What is identified from motion alone need not be what a link has.

    Link 1 turns about a fixed axis, so that only its moment about that acts; its others put
    5 kg at 0.38 m from the centre of a link that is 0.25 m long.
    """
    faults = faults_of(find_scene("menagerie:franka_emika_panda/panda"))
    assert kinds(faults) == [(f"link{index}", "too_large") for index in (1, 2, 7)]
    assert faults[0].value == pytest.approx(0.3755, abs=1e-4)
    assert faults[0].limit == pytest.approx(0.2503, abs=1e-4)


def pendulum(radius_of_gyration: float, armature: float = 0.0, joint: str = "hinge") -> str:
    """A rod of 1 m and 2 kg on a joint, its mass at a distance from its center."""
    moment = 2 * radius_of_gyration**2
    return f"""<mujoco><worldbody><body name="rod"><joint type="{joint}" axis="0 1 0"
      armature="{armature}"/><inertial pos="0 0 -.5" mass="2" diaginertia="{moment} {moment} .001"/>
      <geom type="capsule" fromto="0 0 0 0 0 -1" size=".01"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("spread", "armature", "joint", "beyond"),
    [
        (0.29, 0.0, "hinge", False),  # a uniform rod
        (0.9, 0.0, "hinge", False),  # less than twice the .51 m to the end of the rod
        (1.1, 0.0, "hinge", True),
        (1.1, 100.0, "hinge", False),  # the inertia of the motor hides it
        (50.0, 0.0, "slide", False),  # nothing turns it
    ],
)
def test_mass_beyond_the_machine_is_impossible_if_a_joint_feels_it(
    spread: float, armature: float, joint: str, beyond: bool
) -> None:
    model = mujoco.MjModel.from_xml_string(pendulum(spread, armature, joint))
    assert ("beyond" in {fault.kind for fault in inertia_faults(model)}) == beyond


def test_the_farthest_point_is_of_the_body_if_it_is_alone() -> None:
    """A small link at the end of the rod makes a machine of both."""
    link = '<body><joint axis="0 1 0"/><geom size=".01"/></body>'
    alone = pendulum(1.1)
    for text, owner in (
        (alone, "its geoms"),
        (alone.replace("</body></worldbody>", f"{link}</body></worldbody>"), "the machine"),
    ):
        faults = inertia_faults(mujoco.MjModel.from_xml_string(text))
        (reason,) = [fault.reason for fault in faults if fault.kind == "beyond"]
        assert f"farthest point of {owner} is" in reason


def test_a_link_may_have_mass_anywhere_in_its_machine() -> None:
    """Its geoms are often simplified; those of the other links bound it, too."""
    long = '<body pos="0 0 -1"><joint axis="0 1 0"/><geom type="capsule" size=".01 1"/></body>'
    text = pendulum(1.1).replace("</body></worldbody>", f"{long}</body></worldbody>")
    kinds = {fault.kind for fault in inertia_faults(mujoco.MjModel.from_xml_string(text))}
    assert "too_large" in kinds
    assert "beyond" not in kinds
