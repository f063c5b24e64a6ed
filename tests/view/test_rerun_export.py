"""A Rerun recording, read back by Rerun, says what motion and trace say."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.written_traces import TraceExtras, write_trace

from contactlab.contact.trace_arrays import PairSeries, Trace
from contactlab.errors import OutputError
from contactlab.store.mcap.trace_reader import StoredTrace, read_trace
from contactlab.view.drawn_motion import BodyMotion, RunEvent

write_rrd = pytest.importorskip("contactlab.view.rerun_export").write_rrd
MakeTrace = Callable[..., tuple[Trace, list[PairSeries]]]
Columns = dict[str, dict[str, list[Any]]]

# Rerun keeps geometry in single precision.
SINGLE = 2.0**-23
EVENTS = (
    RunEvent(3, 0.003, "chatter", "often", is_severe=False),
    RunEvent(40, 0.04, "diverged", "at 1e9 m/s", is_severe=True),
)


def rows(path: Path) -> Columns:
    """Return the columns of a recording by entity path and name."""
    rerun = pytest.importorskip("rerun.chunk")
    found: Columns = {}
    for chunk in rerun.RrdReader(path).stream():
        batch = chunk.to_record_batch()
        entity = found.setdefault(chunk.entity_path.replace("\\", ""), {})
        for name in batch.schema.names:
            column = batch.column(name)
            whole = column.cast("int64") if name == "time" else column
            entity.setdefault(name, []).extend(whole.to_pylist())
    return found


@pytest.fixture
def exported(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    make_trace: MakeTrace,
    make_motion: Callable[..., BodyMotion],
    extras: TraceExtras,
) -> tuple[Columns, StoredTrace, BodyMotion]:
    monkeypatch.setenv("RERUN_ANALYTICS", "0")
    trace, series = make_trace(pairs=("a-b", "c d/e"), steps=40)
    write_trace(tmp_path / "plain.mcap", trace, 0, series, extras)
    stored = read_trace(tmp_path / "plain.mcap")
    motion = make_motion(trace, [0, 7, 8, 30, 40])
    write_rrd(tmp_path / "run.rrd", stored, motion, EVENTS)
    assert [each.name for each in tmp_path.glob("run*")] == ["run.rrd"]
    return rows(tmp_path / "run.rrd"), stored, motion


def test_poses_and_shapes(exported: tuple[Columns, StoredTrace, BodyMotion]) -> None:
    found, _, motion = exported
    for body, name in enumerate(motion.bodies[1:], start=1):
        poses = found[f"/space/bodies/{name}"]
        assert poses["time"] == [round(time * 1e9) for time in motion.time]
        places = np.array(poses["Transform3D:translation"])[:, 0]
        np.testing.assert_allclose(places, motion.positions[:, body], rtol=SINGLE)
        xyzw = np.array(poses["Transform3D:quaternion"])[:, 0]
        np.testing.assert_allclose(xyzw, motion.rotations[:, body][:, [1, 2, 3, 0]], rtol=SINGLE)
    for shape in motion.shapes:
        entity = found[f"/space/bodies/{motion.bodies[shape.body]}/{shape.name}"]
        if shape.form == "box":
            [[half]], [[centre]] = entity["Boxes3D:half_sizes"], entity["Boxes3D:centers"]
            np.testing.assert_allclose(half, shape.size / 2, rtol=SINGLE)
            np.testing.assert_allclose(centre, shape.position, rtol=SINGLE)
        if shape.form == "cylinder":
            assert entity["Cylinders3D:lengths"][0] == pytest.approx([shape.size[2]])
            assert entity["Cylinders3D:radii"][0] == pytest.approx([shape.size[0] / 2])
        if shape.form == "mesh":
            # Vertices are turned by the rotation matrix here, by cross products there.
            w, x, y, z = shape.rotation
            turn = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            matrix = np.eye(3) + 2 * w * turn + 2 * turn @ turn
            expected = shape.vertices @ matrix.T + shape.position
            [vertices] = entity["Mesh3D:vertex_positions"]
            np.testing.assert_allclose(vertices, expected, atol=1e-6)


def test_arrows_and_series(exported: tuple[Columns, StoredTrace, BodyMotion]) -> None:
    found, stored, motion = exported
    arrows = found["/space/contact_forces"]
    for frame, vectors in enumerate(arrows["Arrows3D:vectors"]):
        mine = motion.forces.frame == frame
        drawn = np.array(vectors or []).reshape(-1, 3)
        np.testing.assert_allclose(drawn, motion.arrows[mine], rtol=SINGLE)
    assert len(arrows["Arrows3D:vectors"]) == len(motion.rows)
    kinetic = np.array(found["/energy/kinetic"]["Scalars:scalars"])[:, 0]
    np.testing.assert_array_equal(kinetic, stored.kinetic)
    assert found["/energy/kinetic"]["time"] == [round(time * 1e9) for time in stored.time[:-1]]
    for pair in stored.pairs:
        force = np.array(found[f"/pairs/{pair.name}/normal_force"]["Scalars:scalars"])[:, 0]
        np.testing.assert_array_equal(force[pair.steps], pair.normal)
        assert not np.delete(force, pair.steps).any()


def test_events_and_joints_have_their_times(
    exported: tuple[Columns, StoredTrace, BodyMotion],
) -> None:
    found, _, motion = exported
    events = found["/events"]
    assert events["time"] == [3_000_000, 40_000_000]
    assert events["TextLog:text"] == [["chatter: often"], ["diverged: at 1e9 m/s"]]
    assert events["TextLog:level"] == [["WARN"], ["ERROR"]]
    for name, positions in zip(motion.joints.names, motion.joints.position.T, strict=True):
        series = found[f"/joints/{name}"]
        assert np.ravel(series["Scalars:scalars"]).tolist() == positions.tolist()
        assert series["time"] == [round(time * 1e9) for time in motion.time]


def test_every_view_of_the_blueprint_shows_what_the_recording_holds(
    tmp_path: Path, exported: tuple[Columns, StoredTrace, BodyMotion]
) -> None:
    found, stored, _ = exported
    reader = pytest.importorskip("rerun.chunk").RrdReader(tmp_path / "run.rrd")
    [blueprint] = reader.blueprints()
    views: dict[str, dict[str, list[str]]] = {}
    for chunk in reader.stream(store=blueprint):
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if name in {"ViewBlueprint:space_origin", "ViewContents:query"}:
                view = views.setdefault(chunk.entity_path.split("/")[2], {})
                view[name] = batch.column(name).to_pylist()[0]
    shown: list[str] = []
    for view in views.values():
        [origin] = view["ViewBlueprint:space_origin"]
        for query in view["ViewContents:query"]:
            path = query.replace("$origin", origin).removesuffix("/**").replace("\\", "")
            shown += [each for each in found if each.startswith(path)] or [f"nothing at {path}"]
    wanted = {f"/pairs/{pair.name}/normal_force" for pair in stored.pairs}
    assert wanted | {"/events", "/record", "/joints/hinge", "/space/contact_forces"} <= {*shown}
    assert {*shown} <= found.keys()


def test_what_cannot_be_written_is_named(
    tmp_path: Path, exported: tuple[Columns, StoredTrace, BodyMotion]
) -> None:
    _, stored, motion = exported
    with pytest.raises(OutputError, match=r"cannot write .*absent/run\.rrd: No such file"):
        write_rrd(tmp_path / "absent/run.rrd", stored, motion)
