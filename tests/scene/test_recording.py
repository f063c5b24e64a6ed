"""Recordings: units and frames, starts by rule, and all that is wrong told at once."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from ruamel.yaml import YAML

from contactlab.contact.rotations import multiply_rotations, rotate_vectors, rotate_vectors_back
from contactlab.engines import Buffers, PreparedRuns, find_engine
from contactlab.errors import SceneError
from contactlab.scene.scene import Scene
from contactlab.store.control_tables import read_control_table

RATE, STEP = 200.0, 0.001
BRICK = f"""<mujoco><option timestep="{STEP}"/><worldbody>
<geom name="floor" type="plane" size="3 3 .1"/>
<body name="brick" pos="0 0 .5"><freejoint name="brick"/>
<geom type="box" size=".06 .04 .03"/></body>
</worldbody></mujoco>"""
ARM = """<mujoco><option timestep="0.002"/><worldbody>
<body pos="0 0 1"><joint name="turn" axis="0 1 0" range="-120 120"/>
<geom type="capsule" size=".03" fromto="0 0 0 .5 0 0" mass="1"/></body></worldbody>
<actuator><position name="servo" joint="turn" kp="100" kv="3"/></actuator></mujoco>"""
POSE = [f"brick.{each}" for each in ("x", "y", "z", "qw", "qx", "qy", "qz")]
RATES = [f"brick.{each}" for each in ("vx", "vy", "vz", "wx", "wy", "wz")]
UNITS = {"length": "m", "angle": "rad", "time": "s"}
Columns = dict[str, np.ndarray]


def thrown(seed: int = 0, frames: int = 300) -> Columns:
    """Return frames of a brick that MuJoCo throws, in the columns of coordinates."""
    model = mujoco.MjModel.from_xml_string(BRICK)
    data = mujoco.MjData(model)
    data.qvel[:] = np.random.default_rng(seed).normal(size=6) * [0.5, 0.5, 0.5, 4, 4, 4]
    rows = [np.concatenate([data.qpos, data.qvel])]
    for _ in range(frames - 1):
        mujoco.mj_step(model, data, nstep=round(1 / RATE / STEP))
        rows.append(np.concatenate([data.qpos, data.qvel]))
    columns = dict(zip([*POSE, *RATES], np.array(rows).T, strict=True))
    return {"time": np.arange(frames) / RATE, **columns}


def written(folder: Path, table: Mapping[str, Any], xml: str = BRICK, **recording: object) -> Scene:
    """Write a scene with a recording, and open it."""
    (folder / "scene.xml").write_text(xml)
    pq.write_table(pa.table(dict(table)), folder / "motion.parquet")
    manifest = {"version": 1, "title": "t", "description": "d", "duration": 2.0}
    entry = {"file": "motion.parquet", "units": UNITS, **recording}
    with (folder / "scene.yaml").open("w") as file:
        YAML().dump({**manifest, "recording": entry}, file)
    return Scene.open(f"{folder}/", tables=read_control_table)


def start_of(scene: Scene, **values: object) -> tuple[np.ndarray, np.ndarray]:
    starts = scene.initial_states([scene.resolve(values, 0, None)])
    return starts.qpos[0], starts.qvel[0]


def refusal(folder: Path, table: Mapping[str, Any], xml: str = BRICK, **recording: object) -> str:
    with pytest.raises(SceneError) as raised:
        written(folder, table, xml, **recording)
    return str(raised.value)


def test_units_and_frames_are_those_that_are_declared(tmp_path: Path) -> None:
    """In millimetres, degrees and milliseconds, in a turned frame, it is the same motion."""
    columns = thrown()
    turn = np.array([0.6, 0.0, 0.8, 0.0])
    shift = np.array([0.1, -0.2, 0.3])
    pose, rates = (np.stack([columns[x] for x in names], axis=1) for names in (POSE, RATES))
    back = turn * [1, -1, -1, -1]
    other = dict(columns, time=columns["time"] * 1e3)
    spin = rotate_vectors_back(turn, rotate_vectors(pose[:, 3:], rates[:, 3:]))
    parts = (
        (POSE[:3], rotate_vectors_back(turn, pose[:, :3] - shift) * 1e3),
        (POSE[3:], multiply_rotations(back, pose[:, 3:])),
        (RATES[:3], rotate_vectors_back(turn, rates[:, :3]) * 1e3),
        (RATES[3:], np.degrees(spin)),
    )
    for names, values in parts:
        other |= dict(zip(names, values.T, strict=True))
    scene = written(
        tmp_path,
        other,
        units={"length": "mm", "angle": "deg", "time": "ms"},
        frame={"position": shift.tolist(), "quaternion": turn.tolist()},
        turning="world",
    )
    motion = scene.recorded_motion([scene.resolve({}, 0, None)])
    assert motion is not None
    # Rounding only: a thousand times the resolution of a metre.
    assert motion.qpos[0] == pytest.approx(pose, abs=1e-12)
    assert motion.qvel[0] == pytest.approx(rates, abs=1e-11)
    assert motion.times[0] == pytest.approx(columns["time"])


@pytest.mark.parametrize("seed", range(3))
def test_a_simulation_repeats_its_own_recording(tmp_path: Path, seed: int) -> None:
    """Started as recorded, every frame is reproduced to the rounding of one normalisation."""
    scene = written(tmp_path, thrown(seed))
    run = scene.resolve({}, 0, None)
    assert run.duration == pytest.approx(1.5)
    state = find_engine("mujoco").roll_out(PreparedRuns.of(scene, run), Buffers()).state[0]
    motion = scene.recorded_motion([run])
    assert motion is not None
    assert state[: 5 * 300 : 5, 1:8] == pytest.approx(motion.qpos[0], abs=1e-7)


def test_energy_that_the_first_contact_takes(tmp_path: Path) -> None:
    """It is that of weight, motion and turning between the rows around the touch, 50 ms apart."""
    scene, columns = written(tmp_path, thrown()), thrown()
    motion, model = scene.recorded_motion([scene.resolve({}, 0, None)]), scene.base({}).model
    assert motion is not None
    before, after = motion.impact[0]
    assert columns["time"][before] < motion.touched[0] <= columns["time"][before + 1]
    assert 0.05 <= columns["time"][after] - motion.touched[0] < 0.05 + 1 / RATE
    mass, inertia = model.body_mass[1], model.body_inertia[1]
    speed, spin = (np.array([columns[x] for x in RATES[k : k + 3]]) for k in (0, 3))
    energy = mass * (9.81 * columns["brick.z"] + (speed**2).sum(axis=0) / 2)
    energy += inertia @ spin**2 / 2
    assert motion.lost[0] == pytest.approx(energy[before] - energy[after], rel=1e-9)


def test_velocities_are_those_of_the_poses_where_none_are_recorded(tmp_path: Path) -> None:
    """In free fall the mean of two differences is exact but for rotation, to second order."""
    columns = thrown()
    scene = written(
        tmp_path, {name: columns[name] for name in ("time", *POSE)}, start={"time": 0.1}
    )
    _, qvel = start_of(scene)
    row = round(0.1 * RATE)
    expected = np.array([columns[name][row] for name in RATES])
    # Semi-implicit steps lag by g h / 2; rates that change by 30 rad/s^2 do so by .15 in a frame.
    assert qvel[:3] == pytest.approx(expected[:3], abs=9.81 * STEP)
    assert qvel[3:] == pytest.approx(expected[3:], abs=0.15)


def test_runs_start_before_contact_with_the_velocity_of_their_flight(tmp_path: Path) -> None:
    """Noise of 1 mm and recorded velocities that are off do not matter: the flight is fitted."""
    rng, frames = np.random.default_rng(3), 60
    time = np.arange(frames) / RATE
    height = 0.6 - 0.4 * time - 9.81 / 2 * time**2
    spin = 3.0
    columns = {
        "t": time,
        "x": 0.7 * time + rng.normal(size=frames) * 1e-3,
        "y": np.zeros(frames),
        "z": height + rng.normal(size=frames) * 1e-3,
        "qw": np.cos(spin * time / 2),
        "qx": np.zeros(frames),
        "qy": np.sin(spin * time / 2),
        "qz": np.zeros(frames),
    }
    names = {f"brick.{name}": name for name in columns if name != "t"}
    scene = written(tmp_path, columns, time="t", columns=names, start={"before_contact": 2})
    qpos, qvel = start_of(scene)
    reach = np.linalg.norm([0.06, 0.04, 0.03])
    first = int(np.flatnonzero(columns["z"] <= reach)[0]) - 2
    assert qpos[2] == columns["z"][first]
    # Of a line through n points over T, the slope has the error sigma sqrt(12 / n) / T; 4 of them.
    tolerance = 4 * 1e-3 * np.sqrt(12 / first) / time[first]
    assert qvel[:3] == pytest.approx([0.7, 0, -0.4 - 9.81 * time[first]], abs=tolerance)
    assert qvel[3:] == pytest.approx([0, spin, 0], abs=1e-9)


def test_all_mistakes_are_told_at_once(tmp_path: Path) -> None:
    columns = thrown()
    runs = np.repeat([4.0, 7.0, 8.0], 100)
    time = np.tile(np.arange(100) / RATE, 3)
    time[30:100] += 0.02  # frames are lost
    time[150] = time[149]
    columns |= {"time": time, "run": runs}
    columns["brick.qw"] = columns["brick.qw"].copy()
    columns["brick.qw"][220] += 0.5
    text = refusal(tmp_path, columns, run="run")
    for part in (
        "rows are missing (others are 5 ms apart) after: row 30 (run 4)",
        "time does not increase after: row 150 (run 7)",
        "the quaternion of brick does not have the norm 1: row 221 (run 8)",
    ):
        assert part in text
    # Without the runs that are wrong, the rest is used.
    columns["run"] = np.repeat([4.0, 5.0, 7.0, 8.0], [30, 70, 100, 100])
    scene = written(tmp_path, columns, run="run", leave_out=[7, 8])
    assert scene.recorded
    assert scene.recorded.numbers == (4, 5)


def test_mistakes_of_every_kind_are_told_at_once(tmp_path: Path) -> None:
    """Names, cells, norms, times, a row elsewhere, and how other runs rest, in one report."""
    runs = [thrown(seed, 600) for seed in range(4)]
    columns = {name: np.concatenate([run[name] for run in runs]) for name in runs[0]}
    columns["run"] = np.repeat([0, 1, 2, 3], 600)
    columns["brick.y"][5] = np.inf
    columns["brick.qw"][700] *= 1.5
    columns["time"][801:1200] += 0.1
    columns["brick.x"][1250] += 0.3
    columns["brick.z"][1800:] += 0.1
    names = {name: name for name in [*POSE, *RATES]} | {"brick.v": "speed"}
    text = refusal(tmp_path, columns, run="run", columns=names, leave_out=[7])
    for part in (
        "no column `speed`",
        "column `brick.v` is not an actuator, joint or body",
        "no run to leave out: 7",
        "no finite number in column `brick.y`: row 6 (run 0)",
        "the quaternion of brick does not have the norm 1: row 701 (run 1)",
        "rows are missing (others are 5 ms apart) after: row 801 (run 1)",
        "brick jumps in one row only: row 1251 (run 2)",
        "brick rests above the geoms it may touch; check body, unit and frame: row 2400 (run 3)",
        "check unit and frame, or remove it; largest after: row 1250 (run 2)",
    ):
        assert part in text
    assert len(text.splitlines()) == 1 + 9


def test_what_is_left_out_may_have_any_mistake(tmp_path: Path) -> None:
    columns = thrown()
    columns["run"] = np.repeat([0, 1], 150)
    for name in ("time", "brick.x", "brick.qw", "brick.wx"):
        columns[name] = np.where(np.arange(300) == 17, np.nan, columns[name])
    scene = written(tmp_path, columns, run="run", leave_out=[0])
    assert scene.recorded
    assert scene.recorded.numbers == (1,)


def test_a_bounce_is_no_row_elsewhere(tmp_path: Path) -> None:
    """A ball that comes 6 cm nearer from row to row, and goes back as fast, is where it was."""
    away = np.abs(np.arange(-60, 60)) * 0.06 + 0.05
    columns = {"time": np.arange(120) / RATE, "brick.x": away, "brick.y": 0 * away}
    scene = written(tmp_path, columns | {"brick.z": 0 * away + 9}, start={"time": 0.0})
    assert scene.recorded


def test_names_and_cells_are_told_at_once(tmp_path: Path) -> None:
    columns = thrown()
    columns["brick.x"] = np.where(np.arange(300) == 17, np.nan, columns["brick.x"])
    names = {**{name: name for name in POSE}, "cube.vx": "brick.vx", "brick.vy": "vy"}
    text = refusal(tmp_path, columns, columns=names)
    for part in ("in column `brick.x`: row 18", "column `cube.vx` is not", "no column `vy`"):
        assert part in text


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"units": {**UNITS, "length": "mm"}}, "overlaps the geoms it may touch; check body, unit"),
        ({"units": {**UNITS, "length": "cm"}}, "check"),
        ({"units": {**UNITS, "time": "ms"}}, "jumps"),
        ({"turning": "world"}, "angular velocity differs .* check unit and frame"),
        ({"units": {**UNITS, "angle": "deg"}}, "angular velocity differs .* check unit and frame"),
    ],
)
def test_other_units_and_frames_are_noticed(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    text = refusal(tmp_path, thrown(), **changes)
    assert re.search(message, text)


def flights(length: float = 1.0, time: float = 1.0) -> Columns:
    """Return six flights with 0.1 mm of noise, of which lengths and times are off by factors."""
    rng, seconds = np.random.default_rng(7), np.arange(72) / RATE
    runs = list[Columns]()
    for number, speed in enumerate(np.linspace(-0.3, 0.1, 6)):
        height = 0.55 + speed * seconds - 9.81 / 2 * seconds**2
        flown = height > 0.05
        pose = np.zeros((len(seconds), 7))
        pose[:, 2], pose[:, 3] = height, 1.0
        pose[:, :3] += rng.normal(size=(len(seconds), 3)) * 1e-4
        pose[:, :3] *= length
        columns = dict(zip(POSE, pose[flown].T, strict=True))
        columns |= {"time": time * seconds[flown], "run": np.full(flown.sum(), float(number))}
        runs.append(columns)
    return {name: np.concatenate([run[name] for run in runs]) for name in runs[0]}


FLOWN: dict[str, Any] = {"run": "run", "start": {"before_contact": 2}}


@pytest.mark.parametrize(
    ("factors", "falls"), [((1.1, 1.0), "1.1"), ((1.0, 1.05), "0.907"), ((0.9, 1.0), "0.9")]
)
def test_a_recording_that_is_off_in_all_alike_falls_otherwise(
    tmp_path: Path, factors: tuple[float, float], falls: str
) -> None:
    """What a length times g is off by: the factor of length over the square of that of time."""
    text = refusal(tmp_path, flights(*factors), **FLOWN)
    assert f"brick falls {falls} times as fast as in the model's gravity" in text


@pytest.mark.parametrize("length", [0.97, 1.0, 1.03])
def test_a_few_percent_may_be_air(tmp_path: Path, length: float) -> None:
    assert written(tmp_path, flights(length), **FLOWN).recorded


def test_where_the_model_has_air_itself_flight_tells_less(tmp_path: Path) -> None:
    xml = BRICK.replace("<option ", '<option density="1.2" ')
    assert written(tmp_path, flights(0.9), xml, **FLOWN).recorded


@pytest.mark.parametrize("factor", [0.5, 1.6])
def test_another_body_is_noticed_where_it_rests(tmp_path: Path, factor: float) -> None:
    """A brick of another size rests at another height than the recorded one."""
    sizes = " ".join(str(factor * each) for each in (0.06, 0.04, 0.03))
    text = refusal(tmp_path, thrown(frames=600), BRICK.replace(".06 .04 .03", sizes))
    assert "check body, unit and frame" in text


def test_joints_and_commands_of_an_arm(tmp_path: Path) -> None:
    """Angles in degrees and a command: the simulation follows its own recording."""
    model = mujoco.MjModel.from_xml_string(ARM)
    data = mujoco.MjData(model)
    rows: list[tuple[float, ...]] = []
    for step in range(500):
        data.ctrl[0] = np.sin(5e-3 * step)
        rows.append((data.time, np.degrees(data.qpos[0]), data.ctrl[0], 7.0))
        mujoco.mj_step(model, data)
    names = ("timestamp", "observation.state", "action", "frame_index")
    columns: Columns = dict(zip(names, np.array(rows).T, strict=True))
    pictures = [{"path": "top.mp4", "timestamp": 0.1}] * len(rows)
    unused = {"task": ["swing"] * len(rows), "top": pictures, "some": [[1], [1, 2]] * 250}
    scene = written(
        tmp_path,
        columns | unused,
        ARM,
        time="timestamp",
        columns={"turn": "observation.state", "servo": "action"},
        units={**UNITS, "angle": "deg"},
    )
    run = scene.resolve({}, 0, 0.99)
    state = find_engine("mujoco").roll_out(PreparedRuns.of(scene, run), Buffers()).state[0]
    # The start's velocity is a mean over two steps: off by h a / 2, with a below 100 rad/s^2.
    assert state[:, 1] == pytest.approx(np.radians(columns["observation.state"][:496]), abs=3e-3)
    shifted = dict(columns, **{"observation.state": columns["observation.state"] + 90})
    names = {"turn": "observation.state"}
    text = refusal(
        tmp_path, shifted, ARM, time="timestamp", columns=names, units={**UNITS, "angle": "deg"}
    )
    assert "turn is beyond its range of -2.09 to 2.09: row" in text
