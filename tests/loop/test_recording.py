"""What a recording notices of a loop, and what it refuses; its store is sound whatever happens."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

import contactlab
from contactlab.errors import ContactlabError, OutputError, SceneError
from contactlab.loop.recording import Recording
from contactlab.run.recomputed_runs import recomputed_problems
from contactlab.run.stored_runs import replay_run
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.verify_store import find_problems

BALL = """
<mujoco><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="2 2 .1"/>
  <body name="ball" pos="0 0 .1"><freejoint/><geom name="shell" size=".1" mass="1"/></body>
  <body name="brick" pos="1 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>
  <body name="ghost" pos="2 0 .1"><freejoint/><geom size=".1" contype="0" conaffinity="0"/></body>
</worldbody></mujoco>"""


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(BALL)


@pytest.fixture
def data(model: mujoco.MjModel) -> mujoco.MjData:
    return mujoco.MjData(model)


Start = Callable[..., Recording]


@pytest.fixture
def start(model: mujoco.MjModel, data: mujoco.MjData, tmp_path: Path) -> Start:
    return lambda **how: contactlab.record(model, data, tmp_path / "mine", **how)


def _records(folder: Path) -> list[EvidenceRecord]:
    """Return the records of a store, which is sound."""
    assert find_problems(folder / "mine") == []
    store = contactlab.open(folder / "mine")
    assert list(recomputed_problems(store)) == []
    return list(store.records())


def test_steps_are_those_of_mujoco(
    model: mujoco.MjModel, data: mujoco.MjData, start: Start
) -> None:
    twin = mujoco.MjData(model)
    with start() as recording:
        recording.step(7)
        recording.mj_step(model, data, nstep=3)
        mujoco.mj_step(model, twin, 10)
        for name in ("time", "qpos", "qvel", "qacc_warmstart", "energy", "sensordata"):
            mine, own = (np.asarray(getattr(each, name)) for each in (data, twin))
            assert mine.tobytes() == own.tobytes(), name


def test_each_reset_begins_an_episode(
    model: mujoco.MjModel, data: mujoco.MjData, start: Start, tmp_path: Path
) -> None:
    with start() as recording:
        recording.step(20)
        mujoco.mj_resetData(model, data)
        recording.step(30)
        recording.reset(success=True, total_reward=2.5)
        recording.step(40)
        recording.reset()
        recording.reset()
    first, second, third = _records(tmp_path)
    assert [each.steps for each in (first, second, third)] == [20, 30, 40]
    assert [each.seed for each in (first, second, third)] == [0, 1, 2]
    assert (second.success, second.total_reward) == (True, 2.5)
    assert first.success is None
    assert {each.status for each in (first, second, third)} == {"ok"}
    # The third goes on where the second ended.
    assert third.initial.qpos != first.initial.qpos
    table = contactlab.open(tmp_path / "mine").table.to_pylist()
    assert [row["success"] for row in table] == [None, True, None]


@pytest.mark.long
def test_what_is_done_to_state_and_model_is_said(
    model: mujoco.MjModel, data: mujoco.MjData, start: Start, tmp_path: Path
) -> None:
    with start() as recording:
        recording.step(10)
        data.qpos[0] += 0.1
        recording.step(10)
        recording.reset()
        model.geom_friction[0, 0] = 0.3
        model.geom_rgba[0] = 0.5
        recording.step(10)
        model.opt.gravity[2] = -5
        recording.step(10)
    first, second = (each.loop for each in _records(tmp_path))
    assert first
    assert second
    assert (first.state_set, first.changed, first.changed_under_way) == ((10,), (), ())
    assert (second.changed, second.changed_under_way) == (("geom_friction",), ("opt.gravity",))
    assert "backward errors" in first.unchecked
    assert _records(tmp_path)[1].pairs["floor-shell"].friction[0] == 1.0
    assert _records(tmp_path)[1].pairs["floor-geom[2]"].friction[0] == 1.0


def test_steps_that_others_made_are_noticed_or_heard(
    model: mujoco.MjModel, data: mujoco.MjData, start: Start, tmp_path: Path
) -> None:
    with start() as recording:
        recording.step(5)
        mujoco.mj_step(model, data)
        with recording.listening():
            mujoco.mj_step(model, data, nstep=6)
            mujoco.mj_step1(model, data)
            mujoco.mj_step2(model, data)
            mujoco.mj_step(model, mujoco.MjData(model))
    first, second = _records(tmp_path)
    assert first.status == "stopped"
    assert first.status_reason == "cut after 5 steps: the data was stepped without the recording"
    assert (second.status, second.steps) == ("ok", 7)


def test_a_simulation_that_diverges_stops_its_record(
    data: mujoco.MjData, start: Start, tmp_path: Path
) -> None:
    with start() as recording:
        recording.step(5)
        data.qvel[0] = np.nan
        recording.step(5)
    (record,) = _records(tmp_path)
    assert record.status == "stopped"
    assert record.warnings


def test_an_exception_cuts_the_episode(start: Start, tmp_path: Path) -> None:
    def loop() -> None:
        with start() as recording:
            recording.step(12)
            raise ZeroDivisionError("no more")

    with pytest.raises(ZeroDivisionError):
        loop()
    (record,) = _records(tmp_path)
    assert record.status == "stopped"
    assert record.status_reason
    assert record.status_reason.startswith("cut after 12 steps: the loop ended by ")
    assert "ZeroDivisionError: no more" in record.status_reason


def test_closing_twice_is_closing_once(start: Start, tmp_path: Path) -> None:
    recording = start()
    recording.step()
    recording.close()
    recording.close()
    assert len(_records(tmp_path)) == 1
    with pytest.raises(OutputError, match="is closed"):
        recording.step()


def test_without_steps_there_is_no_store(start: Start, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="nothing was recorded"), start():
        pass
    assert not (tmp_path / "mine" / "sweep.json").exists()
    with start() as recording:
        recording.step()
    assert len(_records(tmp_path)) == 1


def test_a_finished_recording_is_not_touched(start: Start, tmp_path: Path) -> None:
    with start() as recording:
        recording.step()
    with pytest.raises(OutputError, match="finished recording"):
        start()
    with start(fresh=True) as recording:
        recording.step(2)
    assert [each.steps for each in _records(tmp_path)] == [2]


def test_a_store_has_one_writer(start: Start, tmp_path: Path) -> None:
    with start() as recording:
        recording.step()
        with pytest.raises(OutputError, match="in use"):
            start()
        recording.step()
    assert [each.steps for each in _records(tmp_path)] == [2]


def test_data_of_another_model_is_refused(model: mujoco.MjModel, tmp_path: Path) -> None:
    other = mujoco.MjData(mujoco.MjModel.from_xml_string(BALL))
    with pytest.raises(SceneError, match="not of this model"):
        contactlab.record(model, other, tmp_path / "mine")
    assert not (tmp_path / "mine").exists()


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"monitor": ["ghost"]}, "no geom or body 'ghost' can touch"),
        ({"monitor": ["nobody"]}, "no geom or body 'nobody' can touch"),
        ({"monitor": [("floor", "nobody")]}, "no body 'floor' in the model"),
        ({"monitor": [("shell", "geom[3]")]}, "filters exclude contacts of shell-geom"),
        ({"monitor": [{"geoms": ["shell"]}]}, "geoms"),
        ({"scene": {"subject": "nobody"}}, "subject 'nobody' is not a body"),
        ({"scene": {"holds": 1}}, "holds"),
        ({"trace": "some"}, "trace"),
    ],
)
def test_what_cannot_be_monitored_is_refused(
    start: Start, tmp_path: Path, how: dict[str, object], message: str
) -> None:
    with pytest.raises(ContactlabError, match=message.replace("[", r"\[")):
        start(**how)
    assert not (tmp_path / "mine" / "sweep.json").exists()


def test_what_never_touches_is_refused(tmp_path: Path) -> None:
    text = '<mujoco><worldbody><body><freejoint/><geom size="1"/></body></worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(text)
    with pytest.raises(SceneError, match="no two geoms of the model can touch"):
        contactlab.record(model, mujoco.MjData(model), tmp_path / "mine")


@pytest.mark.long
@pytest.mark.parametrize(
    ("monitor", "pairs"),
    [
        (None, {"floor-shell", "floor-geom[2]", "shell-geom[2]"}),
        (["ball"], {"floor-shell", "shell-geom[2]"}),
        (["geom[2]"], {"floor-geom[2]", "shell-geom[2]"}),
        ([("shell", "floor")], {"shell-floor"}),
        ([("ball", "brick")], {"ball-brick"}),
        ([{"bodies": ["world", "brick"], "slots": 3}], {"world-brick"}),
    ],
)
def test_pairs_are_named_as_scenes_name_them(
    start: Start, tmp_path: Path, monitor: object, pairs: set[str]
) -> None:
    with start(monitor=monitor) as recording:
        recording.step(3)
    (record,) = _records(tmp_path)
    assert set(record.pairs) == pairs


KILLED = """
import mujoco, os, sys
import contactlab
model = mujoco.MjModel.from_xml_string(sys.argv[1])
recording = contactlab.record(model, mujoco.MjData(model), sys.argv[2])
for steps in (3, 4, 5):
    recording.step(steps)
    if steps < 5:
        recording.reset()
os._exit(9)
"""


@pytest.mark.long
def test_a_killed_recording_goes_on(start: Start, tmp_path: Path) -> None:
    command = [sys.executable, "-c", KILLED, BALL, str(tmp_path / "mine")]
    assert subprocess.run(command, check=False).returncode == 9
    with start() as recording:
        assert recording.episodes == 2
        recording.step(6)
    assert [each.steps for each in _records(tmp_path)] == [3, 4, 6]


def test_its_code_is_not_here_to_replay(start: Start, tmp_path: Path) -> None:
    with start() as recording:
        recording.step(3)
    store = contactlab.open(tmp_path / "mine")
    with pytest.raises(SceneError, match="so it cannot be repeated"):
        replay_run(store, next(iter(store.records())).run_id)


@pytest.mark.parametrize("name", ["qpos", "xfrc_applied", "geom_friction"])
def test_no_episode_begins_with_what_is_no_number(
    model: mujoco.MjModel, start: Start, tmp_path: Path, name: str
) -> None:
    recording = start()
    recording.step(3)
    recording.reset(total_reward=float("nan"))
    mujoco.mj_resetData(model, recording.data)
    getattr(model if hasattr(model, name) else recording.data, name)[:] = np.nan
    with pytest.raises(SceneError, match=f"{name} is not finite at the start of an episode"):
        recording.step()
    recording.close()
    (record,) = _records(tmp_path)
    assert record.total_reward is None
    assert not find_problems(tmp_path / "mine")


def test_the_loop_of_the_page_runs(
    model: mujoco.MjModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    page = Path(__file__).parents[2] / "docs/how-to/recording.md"
    text = page.read_text(encoding="utf-8")
    (code,) = re.findall(r"^(with contactlab\.record.*?)```", text, re.DOTALL | re.MULTILINE)
    names: dict[str, object] = {
        "contactlab": contactlab,
        "mujoco": mujoco,
        "model": model,
        "data": mujoco.MjData(model),
        "policy": lambda _: 0.0,
    }
    changed = {"mug": "ball", "gripper": "ball", "500": "5", "> 0.1": "> -1"}
    for shown, run in changed.items():
        code = code.replace(shown, run)
    exec(code, names)  # noqa: S102 - our own
    records = list(contactlab.open(tmp_path / "results/mine").records())
    assert [each.success for each in records] == [True] * 10


def test_damping_may_begin_after_the_recording_does(
    model: mujoco.MjModel, start: Start, tmp_path: Path
) -> None:
    with start() as recording:
        model.dof_damping[:] = 0.1
        recording.step(20)
    (record,) = _records(tmp_path)
    assert record.loop is not None
    assert record.loop.changed == ("dof_damping",)


def test_its_end_says_what_was_recorded_and_what_reads_it(
    start: Start, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with start() as recording:
        recording.step(20)
        recording.reset()
        assert repr(recording) == f"<recording, 1 episode in {tmp_path / 'mine'}: 1 stable>"
    store = tmp_path / "mine"
    said = f"1 episode in {store}: 1 stable\nnext: contactlab report {store}"
    assert (repr(recording), capsys.readouterr()) == (said, ("", f"{said}\n"))
