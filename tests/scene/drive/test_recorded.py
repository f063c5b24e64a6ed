"""A table of recorded inputs repeats a run to the bit, and its mistakes are named."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.writer import Writer

from contactlab.engines import Buffers, PreparedRuns, find_engine
from contactlab.errors import SceneError
from contactlab.scene.scene import Scene
from contactlab.schema.drive import FileDrive, NoiseDrive
from contactlab.store.control_tables import read_control_table

ARM = """<mujoco><option timestep="0.002"/><worldbody><geom type="plane" size="2 2 .1"/>
<body name="hand" mocap="true" pos="0 0 1"><geom size=".02" contype="0" conaffinity="0"/></body>
<body name="box" pos="0 1 .1"><freejoint name="box"/><geom size=".1"/></body>
<body pos="0 0 1"><joint name="turn" axis="0 1 0"/>
<geom type="capsule" size=".03" fromto="0 0 0 .5 0 0" mass="1"/>
<body pos=".5 0 0"><joint name="bend" axis="0 1 0"/>
<geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" mass=".5"/></body></body></worldbody>
<actuator><position name="servo" joint="turn" kp="100" kv="3"/>
<position name="elbow" joint="bend" kp="50" kv="1"/></actuator></mujoco>"""


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    """An arm with two servos, a free box and a mocap body."""
    (tmp_path / "arm.xml").write_text(ARM)
    return Scene.open(str(tmp_path / "arm.xml"), tables=read_control_table)


def driven(scene: Scene, folder: Path, text: str, *, hold: bool = False) -> Scene:
    """Return the scene with a .csv file of this text."""
    (folder / "controls.csv").write_text(text)
    drive = FileDrive(file="controls.csv", interpolation="hold" if hold else "linear")
    return scene.with_drive(drive, folder)


def states_of(scene: Scene, seconds: float | None = 0.2) -> np.ndarray:
    """Return (N + 1, nstate) the states of a run."""
    runs = PreparedRuns.of(scene, scene.resolve({}, 4, seconds))
    return find_engine("mujoco").roll_out(runs, Buffers()).state[0].copy()


@pytest.mark.parametrize("suffix", ["csv", "npz", "parquet", "mcap"])
@pytest.mark.parametrize("hold", [False, True])
def test_a_file_repeats_a_run_to_the_bit(
    scene: Scene, tmp_path: Path, suffix: str, hold: bool
) -> None:
    """Its rows have the clock that MuJoCo adds up, which is off from k h by its rounding."""
    noisy = scene.with_drive(NoiseDrive(noise=0.5, rate=20.0), tmp_path)
    run = noisy.resolve({}, 4, 0.2)
    inputs = noisy.initial_states([run]).input_rows(0, 0.002, np.arange(101))
    recorded = states_of(noisy)
    assert recorded[-1, 0] != 100 * 0.002
    columns = {"time": recorded[:, 0], "servo": inputs[:, 0], "elbow": inputs[:, 1]}
    path = tmp_path / f"controls.{suffix}"
    write(path, columns)
    drive = FileDrive(file=path.name, interpolation="hold" if hold else "linear")
    again = states_of(scene.with_drive(drive, tmp_path))
    assert again.tobytes() == recorded.tobytes()


def write(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns as a table of the format that the path's suffix names."""
    if path.suffix == ".csv":
        rows = zip(*[values.tolist() for values in columns.values()], strict=True)
        lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
        path.write_text("\n".join(lines) + "\n")
    elif path.suffix == ".npz":
        names = ("servo", "elbow")
        ctrl = np.stack([columns[name] for name in names], axis=1)
        np.savez(path, time=columns["time"], ctrl=ctrl)
    elif path.suffix == ".parquet":
        pq.write_table(pa.table(dict(columns)), path)
    else:
        write_mcap(path, columns)


def write_mcap(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write a row a message, as JSON."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("row", "jsonschema", b"{}")
        channel = writer.register_channel("/controls", "json", schema)
        for k in range(len(columns["time"])):
            row = {name: float(values[k]) for name, values in columns.items()}
            writer.add_message(channel, k, json.dumps(row).encode(), k)
        writer.finish()


@pytest.mark.parametrize("named", [False, True])
def test_the_log_time_of_a_message_counts_if_it_has_no_other(tmp_path: Path, named: bool) -> None:
    """Log times are in nanoseconds; a message is a number by name, or lists as of joint states."""
    path, times, levels = tmp_path / "log.mcap", (0.0, 0.25, 1.5), (0.1, -0.2, 0.3)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("row", "jsonschema", b"{}")
        channel = writer.register_channel("/controls", "json", schema)
        for time, level in zip(times, levels, strict=True):
            row = {"servo": level} if named else {"name": ["servo"], "position": [level]}
            log_time = round(time * 1e9)
            writer.add_message(channel, log_time, json.dumps(row).encode(), log_time)
        writer.finish()
    found = read_control_table(path)
    assert found["time"] == pytest.approx(times, abs=1e-12)
    assert found["servo"] == pytest.approx(levels)


@pytest.mark.parametrize("kept", [0, 8, 11, 16, 60, -1])
def test_a_cut_log_is_named_with_a_remedy(tmp_path: Path, kept: int) -> None:
    path = tmp_path / "log.mcap"
    write_mcap(path, {"time": np.arange(9.0), "servo": np.arange(9.0)})
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(SceneError, match=r"log\.mcap: it is cut, or .*; record or copy it again"):
        read_control_table(path)


def test_columns_name_actuators_joints_and_bodies(scene: Scene, tmp_path: Path) -> None:
    text = "time,turn,elbow.ctrl,box.fz,hand.x,hand.qw,box.z,bend.qpos\n"
    text += "5,.1,.2,3,1,1,.5,-.4\n6,.3,.2,3,2,1,9,9\n"
    found = driven(scene, tmp_path, text)
    run = found.resolve({}, 0, 1.0)
    start = found.initial_states([run])
    inputs = start.input_rows(0, 0.5, np.arange(3))
    model = found.base({}).model
    assert inputs[:, 0] == pytest.approx([0.1, 0.2, 0.3])
    assert inputs[:, 1] == pytest.approx(0.2)
    assert inputs[:, model.nu + 6 * model.body("box").id + 2] == pytest.approx(3)
    assert inputs[:, model.nu + 6 * model.nbody] == pytest.approx([1, 1.5, 2])
    assert start.qpos[0, 2] == 0.5
    assert start.qpos[0, model.joint("bend").qposadr[0]] == -0.4
    assert found.duration == 1


def test_mocap_bodies_follow(scene: Scene, tmp_path: Path) -> None:
    """Whether a hand is elsewhere shows in contacts only; here it pushes the box away."""
    (tmp_path / "arm.xml").write_text(ARM.replace(' contype="0" conaffinity="0"', ""))
    scene = Scene.open(str(tmp_path / "arm.xml"), tables=read_control_table)
    text = "time,hand.x,hand.y,hand.z\n0,0,.8,.1\n0.2,0,1.2,.1\n"
    pushed = states_of(driven(scene, tmp_path, text))
    assert pushed[-1, 1 + 1] > 1.1
    assert states_of(scene.with_drive("none", tmp_path))[-1, 1 + 1] < 1.01


def test_what_has_no_column_is_held(scene: Scene, tmp_path: Path) -> None:
    found = driven(scene, tmp_path, "time,servo\n0,.1\n2,.1\n")
    held = scene.with_drive("hold", tmp_path)
    starts = [each.initial_states([each.resolve({}, 0, 1.0)]).ctrl[0] for each in (found, held)]
    assert starts[0][0] == 0.1
    assert starts[0][1] == starts[1][1] == 0


MISTAKES = {
    "a name": ("time,servo,shoulder\n0,1,1\n1,1,1\n", "column `shoulder` is not an actuator"),
    "a near name": ("time,servp\n0,1\n1,1\n", "did you mean 'servo'"),
    "no number": ("time,servo\n0,1\n1,x\n", "row 2 of column `servo` is not a finite number"),
    "nan": ("time,servo\n0,1\n1,nan\n", "row 2 of column `servo` is not a finite number"),
    "time": ("time,servo\n0,1\n1,1\n.5,1\n", "`time` decreases in row 3; sort the rows by time"),
    "no time": ("servo\n1\n", "no column `time`"),
    "no rows": ("time,servo\n", "no rows"),
    "empty": ("", "no column `time`"),
    "no input": ("time,box.z\n0,1\n1,1\n", "no column is an actuator"),
    "a short row": ("time,servo\n0\n1,1\n", "row 1 has 1 cells, not 2"),
    "twice": ("time,servo,servo\n0,1,1\n", "column `servo` occurs twice"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_mistakes_are_named_in_one_line(scene: Scene, tmp_path: Path, case: str) -> None:
    text, message = MISTAKES[case]
    with pytest.raises(SceneError) as error:
        driven(scene, tmp_path, text)
    assert message in str(error.value)
    assert "controls.csv" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_too_short_says_what_to_write(scene: Scene, tmp_path: Path) -> None:
    short = driven(scene, tmp_path, "time,servo\n0,1\n.5,1\n")
    with pytest.raises(SceneError, match=r"last row is at 0\.5 s of column `time`, but runs take"):
        short.initial_states([short.resolve({}, 0, 0.6)])


def test_other_files_are_refused(scene: Scene, tmp_path: Path) -> None:
    (tmp_path / "controls.txt").write_text("time,servo\n")
    (tmp_path / "bad.npz").write_bytes(b"nothing")
    np.savez(tmp_path / "lengths.npz", time=np.arange(3.0), servo=np.arange(2.0))
    for name, message in (
        ("controls.txt", r"write a file \.csv, \.parquet, "),
        ("bad.npz", "cannot read"),
        ("lengths.npz", "column `servo` has 2 rows, but `time` has 3"),
        ("none.csv", "no file .*none.csv"),
    ):
        with pytest.raises(SceneError, match=message):
            scene.with_drive(FileDrive(file=name), tmp_path)
