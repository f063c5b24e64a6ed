"""Sweeps with a policy: what it did is stored, and whatever comes later needs it no more."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.cart_pole import cart_pole

from contactlab import foreign_code
from contactlab.errors import SceneError, StoreError
from contactlab.plan.diagnostics import SweepMistakesError
from contactlab.rendering.text import render_text
from contactlab.reporting.store_document import describe_store
from contactlab.run.forecast import forecast_sweep
from contactlab.run.stored_runs import replay_run, timed_run
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.schema.drive import PolicyDrive
from contactlab.schema.evidence import StoreManifest
from contactlab.store.finished_store import Store
from contactlab.store.row_journal import write_journal
from contactlab.store.verify_store import find_problems, write_baseline

CART_POLE = cart_pole(0.004, more='<keyframe><key name="tilted" qpos="0 0.1"/></keyframe>')
POLICY = """
import os
import numpy as np

class Balance:
    def __init__(self, model):
        self.actuators = model.nu

    def __call__(self, time, qpos, qvel, sensordata):
        place, tilt = qpos.T
        speed, turning = qvel.T
        wanted = 50.0 * tilt + 8.0 * turning + 2.0 * place + 4.0 * speed
        {middle}
        return wanted[:, None]
"""

COUNTED = "with open('calls', 'a') as file: file.write('x')"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "cart.xml").write_text(CART_POLE)
    write_policy(tmp_path)
    return tmp_path


def write_policy(folder: Path, middle: str = "") -> None:
    (folder / "balance.py").write_text(POLICY.format(middle=middle))


def swept(
    folder: Path,
    name: str = "store",
    *,
    allow_code: bool = True,
    workers: int = 0,
    policy: str = "balance.py:Balance",
    drive: dict[str, Any] | None = None,
    **keys: Any,
) -> StoreManifest:
    sweep = {"version": 1, "scene": "cart.xml", "duration": 0.4, "trace": "none", **keys}
    sweep["drive"] = {"policy": policy, **(drive or {})}
    ask = read_request(sweep, "policy", folder / name, folder=folder, workers=workers)
    ask = replace(ask, allow_code=allow_code)
    return run_sweep(ask, lambda *_: None, lambda _finished: None)


def rows(folder: Path, name: str = "store") -> list[dict[str, Any]]:
    return pq.read_table(folder / name / "runs.parquet").to_pylist()


def test_a_policy_runs_only_where_the_user_allows_it(folder: Path) -> None:
    write_policy(folder, "open('ran', 'w')")
    with pytest.raises(SceneError, match=r"balance.py is Python code.*--allow-code"):
        swept(folder, allow_code=False)
    assert not (folder / "store").exists()
    assert not Path("ran").exists()


@pytest.mark.parametrize("factor", [1.0, 0.0])
def test_an_upright_pole_does_not_stay_under_a_policy_that_pushes_nothing(
    folder: Path, factor: float
) -> None:
    """Seed 0 starts off rest too; without the perturbation it stays in an unstable equilibrium."""
    write_policy(folder, "wanted = 0 * wanted")
    swept(folder, axes={"perturbation": [factor], "keyframe": ["qpos0"]}, duration=2.0, trace="all")
    store = Store.open(folder / "store")
    tilt = store.trace(store.record(rows(folder)[0]["run_id"])).qpos[:, 1]
    assert bool(np.abs(tilt).max() > 0.05) == bool(factor)


@pytest.mark.long
def test_runs_repeat_from_their_store_without_the_policy(folder: Path) -> None:
    keys: dict[str, Any] = {"axes": {"drive.latency": [0.0, 0.02]}, "seeds": 2, "checks": "all"}
    swept(folder, knife_edge=True, drive={"noise": {"qpos": 1e-3}}, **keys)
    (folder / "balance.py").unlink()
    for code in (folder / "store" / "scenes").rglob("*.py"):
        code.write_text("raise SystemExit('a store runs no code')")
    # The file is not what it was, so that the run's identity could not be trusted.
    with pytest.raises(SceneError, match="has changed"):
        replay_run(Store.open(folder / "store"), rows(folder)[0]["run_id"])


@pytest.mark.long
def test_replays_run_no_code(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_policy(folder, COUNTED)
    monkeypatch.chdir(folder)
    swept(folder, axes={"drive.latency": [0.0, 0.02]}, seeds=2, checks="all", knife_edge=True)
    calls = (folder / "calls").stat().st_size
    (folder / "balance.py").unlink()
    store = Store.open(folder / "store")
    for row in rows(folder):
        assert row["label"] == "stable"
        assert row["repeats"] == 1
        assert row["knife_edge"] is False
        assert replay_run(store, row["run_id"]).equal
        _, segments = timed_run(store, row["run_id"])
        assert segments.work.steps == row["steps"]
    assert find_problems(folder / "store") == []
    assert (folder / "calls").stat().st_size == calls


@pytest.mark.long
def test_equal_controls_are_stored_once(folder: Path) -> None:
    write_policy(folder, "wanted = 0 * wanted")
    swept(folder, seeds=4)
    names = {row["controls"] for row in rows(folder)}
    assert len(names) == 1
    (file,) = (folder / "store" / "controls").rglob("*.arrow")
    assert file.stem in names
    table = pa.ipc.open_file(file).read_all()
    assert table.column_names == ["time", "push"]
    assert table["time"].to_pylist() == pytest.approx(np.arange(21) * 0.02)


def test_records_say_what_acted(folder: Path) -> None:
    swept(folder, drive={"rate": 40.0, "latency": "25%", "noise": {"qvel": 0.1}})
    record = Store.open(folder / "store").record(rows(folder)[0]["run_id"])
    assert isinstance(record.drive, PolicyDrive)
    assert record.drive.policy == "balance.py:Balance"
    stored = next((folder / "store" / "scenes").rglob("balance.py"))
    assert stored.read_bytes() == (folder / "balance.py").read_bytes()
    assert record.settings["drive.latency"] == 0.25 / 40
    assert record.settings["drive.noise.qvel"] == 0.1
    assert record.cost is not None
    assert record.cost.cpu_s > 0
    assert "cost" not in Store.open(folder / "store").manifest.sweep.lacking


@pytest.mark.long
def test_its_file_is_part_of_what_runs_are(folder: Path) -> None:
    swept(folder, "first")
    swept(folder, "again")
    write_policy(folder, "wanted = 2 * wanted")
    swept(folder, "other")
    ids = [rows(folder, name)[0]["run_id"] for name in ("first", "again", "other")]
    assert ids[0] == ids[1] != ids[2]
    with pytest.raises(StoreError, match="holds another sweep"):
        swept(folder, "first")


def test_files_that_it_reads_are_part_of_it(folder: Path) -> None:
    (folder / "gains.txt").write_text("1.0")
    swept(folder, "first", drive={"files": ["gains.txt"]})
    (folder / "gains.txt").write_text("2.0")
    swept(folder, "other", drive={"files": ["gains.txt"]})
    assert rows(folder, "first")[0]["run_id"] != rows(folder, "other")[0]["run_id"]
    assert list((folder / "other" / "scenes").rglob("gains.txt"))
    with pytest.raises(SweepMistakesError, match=r"no file .*absent(.|\n)*drive\.files"):
        swept(folder, drive={"files": ["absent"]})


@pytest.mark.long
def test_latency_in_periods_is_that_in_seconds(folder: Path) -> None:
    swept(folder, "share", axes={"drive.latency": ["50%"], "drive.rate": [25.0, 50.0]})
    swept(folder, "seconds", axes={"drive.latency": [0.02, 0.01]})
    share, seconds = rows(folder, "share"), rows(folder, "seconds")
    assert share[1]["trajectory_hash"] == seconds[1]["trajectory_hash"]
    assert share[0]["trajectory_hash"] != seconds[0]["trajectory_hash"]
    assert [row["settings"]["drive.latency"] for row in share] == [0.02, 0.01]


@pytest.mark.long
def test_an_interrupted_sweep_goes_on(folder: Path) -> None:
    swept(folder, "whole", seeds=4)
    swept(folder, seeds=4)
    store = folder / "store"
    shutil.copytree(store, folder / "copy")
    (folder / "copy" / "manifest.json").unlink()
    write_journal(folder / "copy" / "journal.jsonl", rows(folder)[:2])
    shutil.rmtree(folder / "copy" / "controls")
    shutil.copytree(store / "controls", folder / "copy" / "controls")
    swept(folder, "copy", seeds=4)
    hashes = [[row["trajectory_hash"] for row in rows(folder, each)] for each in ("whole", "copy")]
    assert hashes[0] == hashes[1]
    assert find_problems(folder / "copy") == []


def test_a_damaged_or_lost_control_is_found(folder: Path) -> None:
    swept(folder, seeds=2)
    one, other = (folder / "store" / "controls").rglob("*.arrow")
    one.write_bytes(other.read_bytes())
    assert [text.split("/")[-1] for text in find_problems(folder / "store")] == [
        f"{one.name} changed since it was written"
    ]
    one.unlink()
    assert "is missing" in find_problems(folder / "store")[0]


@pytest.mark.long
def test_a_baseline_keeps_them(folder: Path) -> None:
    swept(folder)
    write_baseline(folder / "store", folder / "baseline")
    (folder / "balance.py").unlink()
    assert find_problems(folder / "baseline") == []
    assert replay_run(Store.open(folder / "baseline"), rows(folder)[0]["run_id"]).equal


@pytest.mark.long
def test_errors_and_times_are_those_of_recorded_controls(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_policy(folder, COUNTED)
    monkeypatch.chdir(folder)
    keys: dict[str, Any] = {"axes": {"timestep": [0.002, 0.004]}, "duration": 0.2}
    swept(folder, "plain", **keys)
    calls = (folder / "calls").stat().st_size
    swept(folder, accuracy={"error": "trajectory", "refine": 4}, timing={"rounds": 3}, **keys)
    assert (folder / "calls").stat().st_size == 2 * calls
    for row in rows(folder):
        assert 0 < row["error_peak"] < 1e-2
        assert row["time_min"] > 0


BAD = {
    "raise": ("raise ValueError('lost')", "line 13 of balance.py: ValueError: lost"),
    "nan": ("wanted = wanted * np.nan", "returned nan for push at 0 s"),
    "shape": ("wanted = wanted[:0]", "returned an array of shape"),
    "exit": ("raise SystemExit(3)", "SystemExit: 3"),
}


def test_one_that_is_never_made_ends_at_a_limit(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also without workers, whose runs have a limit of their own."""
    monkeypatch.setattr(foreign_code, "SECONDS", 0.5)
    (folder / "hangs.py").write_text(
        "class Hangs:\n    def __init__(self, model):\n        while True: pass\n"
    )
    swept(folder, policy="hangs.py:Hangs")
    (row,) = rows(folder)
    assert row["label"] == "invalid"
    assert "policy Hangs: line 3 of hangs.py: " in row["status_reason"]
    assert "did not return within 0.5 s" in row["status_reason"]


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_policy_is_one_line_in_the_record(folder: Path, kind: str) -> None:
    middle, message = BAD[kind]
    write_policy(folder, f"if tilt.max() > 0.3: {middle}")
    (folder / "scene.yaml").write_text(
        "version: 1\ntitle: t\ndescription: d\nduration: 0.4\nmodel: cart.xml\n"
        "pairs: [{geoms: [floor, cart]}]\n"
        "initial: {tilt: {default: 0.1, unit: rad, description: t, sets: {hinge: tilt}}}\n"
    )
    swept(folder, scene="./", axes={"tilt": [0.1, 0.5, -0.1]})
    good, bad, other = rows(folder)
    assert [row["status"] for row in (good, bad, other)] == ["ok", "error", "ok"]
    assert message in bad["status_reason"]
    assert "\n" not in bad["status_reason"]
    assert bad["label"] == "invalid"
    assert bad["controls"] is None
    with pytest.raises(StoreError, match="no recorded controls"):
        replay_run(Store.open(folder / "store"), bad["run_id"])


@pytest.mark.night
def test_a_policy_that_kills_its_process_or_hangs_costs_its_runs_alone(folder: Path) -> None:
    write_policy(
        folder,
        "if time[0] > 0.1 and tilt.max() > 0.2: os._exit(3)\n"
        "        while time[0] > 0.1 and tilt.min() < -0.2: pass",
    )
    (folder / "scene.yaml").write_text(
        "version: 1\ntitle: t\ndescription: d\nduration: 0.4\nmodel: cart.xml\n"
        "pairs: [{geoms: [floor, cart]}]\n"
        "initial: {tilt: {default: 0.1, unit: rad, description: t, sets: {hinge: tilt}}}\n"
    )
    axes = {"tilt": [0.05, 0.8, -0.8]}
    swept(folder, scene="./", axes=axes, workers=1, timeout=2.0)
    good, ended, hung = rows(folder)
    assert [row["status"] for row in (good, ended, hung)] == ["ok", "crashed", "timeout"]
    assert "exited with code 3" in ended["status_reason"]
    assert "balance.py" in hung["status_reason"]


@pytest.mark.long
def test_a_policy_that_is_never_made_costs_its_runs_alone(folder: Path) -> None:
    (folder / "slow.py").write_text(
        "class Slow:\n    def __init__(self, model):\n        while True: pass\n"
    )
    swept(folder, policy="slow.py:Slow", workers=1, timeout=0.5)
    (hung,) = rows(folder)
    assert hung["status"] == "timeout"
    assert "slow.py" in hung["status_reason"]


@pytest.mark.parametrize(
    ("text", "policy", "message"),
    [
        ("import nothing_of_this_name", "balance.py:Balance", "line 1 .*ModuleNotFoundError"),
        ("class Other: pass", "balance.py:Balance", "no class Balance; write one of Other"),
        ("def broken(:", "balance.py:Balance", "SyntaxError"),
        ("", "absent.py:Balance", "no file .*absent.py"),
    ],
)
def test_what_cannot_be_loaded_is_said_at_once(
    folder: Path, text: str, policy: str, message: str
) -> None:
    (folder / "balance.py").write_text(text)
    with pytest.raises((SceneError, SweepMistakesError), match=message) as caught:
        swept(folder, policy=policy)
    said = str(caught.value)
    assert ("\n" not in said) == isinstance(caught.value, SceneError)
    assert not (folder / "store").exists()


def test_a_rate_above_that_of_the_steps_costs_those_runs_alone(folder: Path) -> None:
    swept(folder, axes={"timestep": [0.004, 0.03]})
    good, bad = rows(folder)
    assert good["status"] == "ok"
    assert "steps of 0.03 s have a rate of 33.3333 Hz" in bad["status_reason"]
    store = Store.open(folder / "store")
    summary = render_text(describe_store(store))
    assert "1 runs are invalid: the policy should act at 50 Hz" in " ".join(summary.split())
    assert "look at the start" not in summary


def test_a_plan_counts_the_runs_that_are_too_slow_for_a_policy(folder: Path) -> None:
    sweep = {
        "version": 1,
        "scene": "cart.xml",
        "drive": {"kp": 1, "rate": 125},
        "axes": {"timestep": [0.004, 0.008, 0.009], "drive.rate": [100, 125]},
    }
    ask = read_request(sweep, "s", folder / "store", folder=folder, workers=0)
    (warning,) = (each for each in forecast_sweep(ask).warnings if "period" in each)
    assert warning.startswith("in 1 of 6 runs")


def test_a_drive_without_files_leaves_a_store_sound(folder: Path) -> None:
    swept(folder, drive={"kp": 1.0, "policy": "pd"})
    store = Store.open(folder / "store")
    assert find_problems(folder / "store") == []
    assert [each.name for each in (folder / "store" / "scenes").iterdir()] == [
        store.manifest.sweep.scene_hash
    ]


def test_what_no_drive_has_is_no_axis(folder: Path) -> None:
    sweep = {"version": 1, "scene": "cart.xml", "axes": {"drive.latency": [0.1]}}
    ask = read_request(sweep, "s", folder / "store", folder=folder, workers=0)
    with pytest.raises(SceneError, match=r"drive\.latency: the drive auto has no such number"):
        run_sweep(ask, lambda *_: None, lambda _finished: None)


def test_a_scene_may_name_its_policy(folder: Path) -> None:
    (folder / "scene.yaml").write_text(
        "version: 1\ntitle: t\ndescription: d\nduration: 0.2\nmodel: cart.xml\n"
        "pairs: [{geoms: [floor, cart]}]\ndrive: {policy: 'balance.py:Balance'}\n"
    )
    sweep = {"version": 1, "scene": "./", "trace": "none"}
    ask = read_request(sweep, "s", folder / "store", folder=folder, workers=0)
    with pytest.raises(SceneError, match="--allow-code"):
        run_sweep(ask, lambda *_: None, lambda _finished: None)
    ask = replace(ask, allow_code=True)
    run_sweep(ask, lambda *_: None, lambda _finished: None)
    (folder / "balance.py").unlink()
    assert replay_run(Store.open(folder / "store"), rows(folder)[0]["run_id"]).equal


@pytest.mark.long
def test_recorded_controls_drive_a_sweep_as_the_policy_did(folder: Path) -> None:
    swept(folder, drive={"latency": 0.01}, axes={"perturbation": [0]})
    (controls,) = (folder / "store" / "controls").rglob("*.arrow")
    sweep = {"version": 1, "scene": "cart.xml", "duration": 0.4}
    drive = {"file": str(controls), "interpolation": "hold"}
    ask = read_request({**sweep, "drive": drive}, "s", folder / "again", folder=folder, workers=0)
    run_sweep(ask, lambda *_: None, lambda _finished: None)
    assert rows(folder, "again")[0]["trajectory_hash"] == rows(folder)[0]["trajectory_hash"]


def test_other_engines_run_no_policy(folder: Path) -> None:
    with pytest.raises(SceneError, match="the impulse engine cannot run policies"):
        swept(folder, axes={"engine": ["impulse"]})


ARM = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" damping=".5"/>
      <geom type="capsule" fromto="0 0 0 .4 0 0" size=".03" mass="2"/>
      <body name="lower" pos=".4 0 0">
        <joint name="elbow" axis="0 1 0" damping=".5"/>
        <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
      </body>
    </body>
  </worldbody>
  <keyframe><key name="out" qpos="0.3 -0.5"/></keyframe>
  <actuator><motor joint="shoulder"/><motor joint="elbow"/></actuator>
</mujoco>
"""
HOLD = """
import mujoco
import numpy as np

class Hold:
    def __init__(self, model):
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        mujoco.mj_forward(model, data)
        self.place, self.weight = data.qpos.copy(), data.qfrc_bias.copy()

    def __call__(self, time, qpos, qvel, sensordata):
        return self.weight + 20.0 * (self.place - qpos) - 1.0 * qvel
"""


def test_a_policy_holds_an_arm(folder: Path) -> None:
    """Gravity compensated at the posture leaves feedback only the perturbed start to correct."""
    (folder / "arm.xml").write_text(ARM)
    (folder / "hold.py").write_text(HOLD)
    keys: dict[str, Any] = {"scene": "arm.xml", "duration": 3.0, "seeds": 2, "trace": "all"}
    swept(folder, policy="hold.py:Hold", drive={"rate": 250.0}, **keys)
    store = Store.open(folder / "store")
    for row in rows(folder):
        qpos = store.trace(row["run_id"]).qpos
        assert np.abs(qpos[-1] - [0.3, -0.5]).max() < 1e-6
        assert np.abs(qpos - [0.3, -0.5]).max() < 1e-3


UNSEEDED = "wanted = wanted + np.random.default_rng().random()"
OF_ITS_PROCESS = {
    "hash": "wanted = wanted + hash('word') % 1000 / 1000",
    "process": "import os; wanted = wanted + os.getpid() % 1000 / 1000",
    "shared generator": "wanted = wanted + np.random.random()",
}


@pytest.mark.long
@pytest.mark.parametrize("name", OF_ITS_PROCESS)
def test_a_policy_of_its_process_is_noticed(folder: Path, name: str) -> None:
    """Strings have other hashes in another process, which each resumed sweep is."""
    write_policy(folder, OF_ITS_PROCESS[name])
    manifest = swept(folder, workers=1)
    assert manifest.unrepeatable == tuple(row["run_id"] for row in rows(folder))


@pytest.mark.parametrize(("middle", "repeats"), [("", True), (UNSEEDED, False)])
def test_a_policy_that_does_not_repeat_is_noticed(
    folder: Path, middle: str, repeats: bool, caplog: pytest.LogCaptureFixture
) -> None:
    write_policy(folder, middle)
    manifest = swept(folder)
    (run_id,) = [row["run_id"] for row in rows(folder)]
    assert manifest.unrepeatable == (() if repeats else (run_id,))
    assert (f"run {run_id} does not repeat" in caplog.text) is not repeats
    assert find_problems(folder / "store") == []
