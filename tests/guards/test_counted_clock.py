"""Counted time depends on the steps that are made, and on nothing else."""

import threading
import time
from pathlib import Path

import mujoco
import pytest
from tests.guards.comparing import compare
from tests.guards.counted_clock import LOOK, OF_DOF, OF_ROW, STEP, counted_time
from tests.guards.records import Record
from tests.guards.written import written_items

from contactlab.engines.mujoco_batch import Batch

FALL = '<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
REST = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
<body pos="0 0 .099"><freejoint/><geom size=".1" /></body></worldbody></mujoco>"""
MODEL = Path(__file__).parents[2] / "models" / "stiff_joint" / "scene.xml"


def model_of(text: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


@pytest.mark.parametrize(("integrator", "stages"), [("Euler", 1), ("RK4", 4)])
@pytest.mark.parametrize("nstep", [1, 7])
def test_steps_take_the_time_of_their_stages(nstep: int, integrator: str, stages: int) -> None:
    model, data = model_of(FALL.replace("<world", f'<option integrator="{integrator}"/><world', 1))
    with counted_time():
        begin = time.thread_time()
        mujoco.mj_step(model, data, nstep=nstep)
        taken = time.thread_time() - begin
    assert taken == pytest.approx(nstep * stages * (STEP + 6 * OF_DOF) + LOOK, rel=1e-9)


def test_rows_of_constraints_take_time_by_the_iteration() -> None:
    model, data = model_of(REST)
    with counted_time() as clock:
        mujoco.mj_step(model, data)
    assert data.nefc == 4
    rows = 4 * (1 + int(data.solver_niter.sum()))
    assert clock.now == pytest.approx(STEP + 6 * OF_DOF + OF_ROW * rows, rel=1e-9)


def test_runs_of_a_batch_take_their_steps() -> None:
    model, _ = model_of(FALL)
    with counted_time() as clock:
        batch = Batch(model, 3, 1, persistent=False)
        batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        batch.rollout(10, record=[])
        batch.rollout(10, record=[], ids=[1])
    assert clock.now == pytest.approx(40 * (STEP + 6 * OF_DOF), rel=1e-9)


def test_all_clocks_are_one_and_work_that_is_not_counted_takes_no_time() -> None:
    with counted_time():
        begin = time.monotonic()
        sum(range(100_000))
        ends = time.process_time(), time.thread_time(), 1e-9 * time.thread_time_ns()
    assert [end - begin for end in ends] == pytest.approx([LOOK, 2 * LOOK, 3 * LOOK], abs=1e-9)


def test_looks_of_other_threads_take_no_time() -> None:
    with counted_time() as clock:
        begin = time.monotonic()
        other = threading.Thread(target=time.monotonic)
        other.start()
        other.join()
    assert clock.now == begin


def test_the_clocks_are_given_back() -> None:
    before = time.monotonic, time.process_time, time.thread_time, mujoco.mj_step
    with counted_time():
        pass
    assert (time.monotonic, time.process_time, time.thread_time, mujoco.mj_step) == before


@pytest.mark.long
def test_searches_write_the_same_files_however_slow_the_machine_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sleep in some looks at the clock stands for other processes that come and go."""
    records = list[Record]()
    for folder in (tmp_path / "idle", tmp_path / "busy"):
        folder.mkdir()
        monkeypatch.chdir(folder)
        records.append(Record({}, *written_items("stiff joint", MODEL)))
        slow_down(monkeypatch)
    assert records[0].results["written file"]
    assert not compare(*records)


def slow_down(monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.guards.counted_clock import CountedClock  # noqa: PLC0415 - as it is patched

    read, looks = CountedClock.read, iter(range(1_000_000))

    def slow(self: CountedClock) -> float:
        if next(looks) % 50 == 0:
            time.sleep(2e-3)
        return read(self)

    monkeypatch.setattr(CountedClock, "read", slow)
