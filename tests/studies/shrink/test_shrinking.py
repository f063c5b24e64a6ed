"""The smallest model that fails: what was planted stays, and what stands by goes."""

import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull

import contactlab
from contactlab.contact.trace_arrays import RecordedControls
from contactlab.errors import StoreError
from contactlab.run.stored_runs import prepare_replay
from contactlab.scene.mesh_hulls import hull_vertices
from contactlab.store.finished_store import Store
from contactlab.studies.shrink.failing_model import FailingModel, Start, as_one_file, file_hull
from contactlab.studies.shrink.shrinking import ShrinkRequest, shrink_run

# A ball of 20 mm is thrown through a plate of 4 mm, or up: at 8 m/s it moves 80 mm in a step.
# Around it are a motor's arm, a hinged flap of a mesh, and boxes in free fall, of which one touches
# nothing, and a cord slides over a drum that touches nothing either.
SCENE = """<mujoco>
  <option timestep="0.01"/>
  <default><default class="parts"><geom rgba="1 0 0 1"/><default class="thin"><geom margin=".001"/>
    </default><default class="thick"><geom margin=".002"/></default></default>
    <default class="limbs"><joint armature=".01"/></default></default>
  <asset><mesh name="wedge" vertex="0 0 0  .1 0 0  0 .1 0  0 0 .1  .02 .02 .02"/>
    <texture name="sky" type="skybox" builtin="flat" width="8" height="8"/></asset>
  <worldbody>
    <light pos="0 0 3"/><geom name="floor" type="plane" size="3 3 .1" pos="0 0 -9"/>
    <body name="plate" pos="0 0 .5"><geom name="plate" type="box" size=".2 .2 .002"/></body>
    <body name="ball" pos="0 0 .9"><freejoint/><geom size=".02" name="ball" class="thin"/></body>
    <body name="upper" pos="1 0 0"><joint name="shoulder" axis="0 1 0" damping="1"/>
      <geom type="capsule" size=".03" fromto="0 0 0 .2 0 0"/>
      <body name="lower" pos=".2 0 0"><joint name="elbow" axis="0 1 0" damping="1" class="limbs"/>
        <geom type="capsule" size=".02" fromto="0 0 0 .2 0 0"/></body></body>
    <body name="flap" pos="-1 0 0"><joint name="hinge" damping="1"/>
      <geom type="mesh" mesh="wedge"/></body>
    {boxes}
    <geom name="drum" type="cylinder" size=".02 .1" pos="0 1 .5" contype="0" conaffinity="0"/>
    <site name="hook" pos="-.2 1 .5"/>
  </worldbody>
  <tendon><spatial name="cord"><site site="hook"/><geom geom="drum"/><site site="eye"/></spatial>
  </tendon>
  <actuator><motor name="motor" joint="elbow"/></actuator>
  <sensor><jointpos joint="elbow"/></sensor>
  <keyframe><key name="down" qvel="0 0 -8 {rest}"/><key name="up" qvel="0 0 3 {rest}"/></keyframe>
</mujoco>""".format(
    rest=" ".join("0" * (3 + 3 + 6 * 6)),
    boxes="".join(
        f'<body name="box{n}" pos="{n / 5} 1 0"><freejoint/>'
        f'<geom type="box" size=".05 .05 .05"{more}</body>'
        for n in range(6)
        for more in ["/>" if n else ' contype="0" conaffinity="0"/><site name="eye"/>']
    ),
)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    folder = tmp_path_factory.mktemp("shrink")
    (folder / "scene.xml").write_text(SCENE)
    sweep = {"version": 1, "scene": "scene.xml", "duration": 0.5, "drive": "none",
             "axes": {"keyframe": ["down", "up"]}}  # fmt: skip
    (folder / "sweep.yaml").write_text(json.dumps(sweep))
    return contactlab.sweep(folder / "sweep.yaml", output=folder / "store", workers=0)


def the_run(store: Store, keyframe: str) -> str:
    (found,) = (each for each in store.records() if each.axes["keyframe"] == keyframe)
    return found.run_id


@pytest.fixture(scope="module")
def small(store: Store, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("small") / "ball"
    report = shrink_run(ShrinkRequest(store, the_run(store, "down"), folder, 600))
    assert report.finished
    assert (report.label, set(report.bodies)) == ("tunneling", {"ball"})
    assert report.duration < report.stored_duration
    return folder


def names(model: mujoco.MjModel, kind: str, count: int) -> set[str]:
    return {getattr(model, kind)(index).name for index in range(count)}


@pytest.mark.long
def test_what_was_planted_is_left(small: Path) -> None:
    """Two geoms that meet, and one joint: nothing of it can go, since nothing would pass."""
    model = mujoco.MjModel.from_xml_path(str(small / "model.xml"))
    assert names(model, "geom", model.ngeom) == {"ball", "plate"}
    assert (model.njnt, model.nu, model.nsensor, model.nmesh, model.nsite) == (1, 0, 0, 0, 0)


@pytest.mark.long
def test_classes_of_what_went_are_gone_and_those_above_one_that_is_used_are_not(
    small: Path,
) -> None:
    root = ET.parse(small / "model.xml").getroot()  # noqa: S314 - contactlab wrote it
    used = {part.get("class") for part in root.iterfind("worldbody//")} - {None}
    written = {part.get("class") for part in root.iterfind("default//default")}
    assert used <= written <= {*used, "main", "parts"}


@pytest.mark.long
def test_it_fails_by_itself_and_in_plain_mujoco(small: Path) -> None:
    """The sweep beside it expects the label; the issue's script runs as it stands."""
    again = contactlab.sweep(small / "sweep.yaml", output=small / "again", workers=0)
    (record,) = again.records()
    assert record.expectation_met
    issue = (small / "issue.md").read_text()
    script = issue.partition("```python\n")[2].partition("```")[0]
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=small, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    height = float(done.stdout.partition("end: [")[2].split()[2].rstrip("]"))
    assert height < 0.5 - 0.002


def test_without_time_the_whole_model_is_written(store: Store, tmp_path: Path) -> None:
    report = shrink_run(ShrinkRequest(store, the_run(store, "down"), tmp_path / "new", 0))
    assert not report.finished
    assert report.after == report.before
    assert report.before["bodies"] == 11
    written = mujoco.MjModel.from_xml_path(str(tmp_path / "new" / "model.xml"))
    meant = mujoco.MjModel.from_xml_string(SCENE)
    assert written.ngeom == meant.ngeom - 1  # the box that touches nothing; the drum leads the cord
    assert written.body_mass.tolist() == meant.body_mass.tolist()


def test_a_stable_run_is_refused(store: Store, tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="is stable"):
        shrink_run(ShrinkRequest(store, the_run(store, "up"), tmp_path / "new"))
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("scale", [(1, 1, 1), (0.5, 2, 1)])
def test_a_hull_has_the_corners_of_the_file(scale: Sequence[float]) -> None:
    """Of random points, those are the vertices of SciPy's hull, to MuJoCo's single precision."""
    points = np.random.default_rng(0).normal(size=(40, 3))
    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(name="cloud")
    mesh.uservert, mesh.scale = points.ravel(), np.array(scale)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="cloud")
    found = file_hull(spec.compile(), 0)
    scaled = points * scale
    wanted = scaled[ConvexHull(scaled).vertices]
    apart = np.linalg.norm(found[:, None] - wanted, axis=-1)
    assert len(found) == len(wanted)
    assert apart.min(axis=0).max() < 1e-5


# A wedge without its hull's fourth side, whose centre of mass is not that of its hull.
NOTCHED = """<mujoco><asset><mesh name="notched" vertex="0 0 0  .3 0 0  0 .3 0  0 0 .3  .06 .06 .06"
  face="0 2 1  0 1 3  0 3 2  1 2 4  2 3 4  3 1 4"/></asset>
  <worldbody><body name="own" pos="0 0 1"><freejoint/><frame pos=".2 0 .1" euler="0 0 30">
    <geom name="hull" type="mesh" mesh="notched" pos=".01 .02 .03" euler="10 20 30"/>
    <geom name="fitted" type="box" mesh="notched"/></frame></body></worldbody></mujoco>"""


@pytest.mark.parametrize("axes", [{}, {"geom_pos[hull,1]": [0.05], "body_gravcomp[own]": [0.5]}])
def test_hulls_and_what_is_fitted_to_a_mesh_stand_in_one_file_where_they_stood(
    axes: dict[str, list[float]], tmp_path: Path
) -> None:
    """To the single precision in which MuJoCo has vertices."""
    (tmp_path / "notched.xml").write_text(NOTCHED)
    sweep = {"version": 1, "scene": "notched.xml", "duration": 0.002, "drive": "none", "axes": axes}
    (tmp_path / "sweep.yaml").write_text(json.dumps(sweep))
    store = contactlab.sweep(tmp_path / "sweep.yaml", output=tmp_path / "store", workers=0)
    runs = prepare_replay(store, next(iter(store.records())).run_id).runs
    written = mujoco.MjModel.from_xml_string(as_one_file(runs.scene, runs.resolved[0], runs.starts))
    places = list[list[np.ndarray]]()
    for model in (written, runs.models[0]):
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        turns = data.geom_xmat.reshape(-1, 3, 3)
        corners = hull_vertices(model, 0) @ turns[0].T + data.geom_xpos[0]
        places += [
            [
                corners[np.lexsort(corners.round(4).T)].ravel(),
                data.geom_xpos[1],
                np.abs(turns[1]).ravel(),
                model.geom_size[1],
                model.body_gravcomp,
                model.body_mass,
                model.body_inertia.ravel(),
            ]
        ]
    own, meant = map(np.concatenate, places)
    assert own == pytest.approx(meant, abs=1e-6)


@pytest.mark.parametrize("steps", [1, 7, 20])
def test_a_run_that_begins_later_ends_where_the_whole_one_does(steps: int) -> None:
    """Nothing touches, so that no solver starts from what a keyframe cannot hold: to rounding."""
    text = """<mujoco><worldbody><body name="upper"><joint name="hip" axis="0 1 0"/>
      <geom name="thigh" size=".05" pos=".3 0 0"/></body></worldbody>
      <actuator><motor name="motor" joint="hip"/></actuator></mujoco>"""
    rows = np.random.default_rng(0).normal(size=(31, 2))
    controls = RecordedControls(
        np.array([0.002 * place for place in range(31)]), rows, places=(0, 1 + 6 + 2)
    )
    start = Start(
        {"hip": np.array([0.3])}, {"hip": np.array([-1.0])}, {"motor": np.empty(0)},
        {"motor": np.zeros(1)}, {}, controls, ("motor", "upper.fz"),
    )  # fmt: skip
    whole = FailingModel(text, start, 0.06)
    later = whole.start_later(steps)
    assert (later.start_time, later.duration) == pytest.approx(
        (steps * 0.002, 0.06 - steps * 0.002)
    )
    assert played(later) == pytest.approx(played(whole), abs=1e-12)


def played(model: FailingModel) -> list[float]:
    """Return where plain MuJoCo ends, driven as the table beside the model says."""
    own = mujoco.MjModel.from_xml_string(model.whole_text())
    data = mujoco.MjData(own)
    mujoco.mj_resetDataKeyframe(own, data, 0)
    names, *lines = model.start.input_table(own, model.duration).split()
    assert names == "time,motor,upper.fz"
    rows = np.array([[float(value) for value in line.split(",")] for line in lines])
    for _ in range(round(model.duration / own.opt.timestep)):
        _, data.ctrl[0], data.body("upper").xfrc_applied[2] = rows[rows[:, 0] <= data.time + 1e-9][
            -1
        ]
        mujoco.mj_step(own, data)
    return [*data.qpos, *data.qvel]
