"""Work is what a plain loop counts, and what is timed is the run itself, part by part."""

from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.engines import mujoco_batch
from contactlab.engines.engine import SEGMENTS, Buffers, Segments, Work
from contactlab.engines.mujoco_batch import roll_out
from contactlab.engines.single_run import count_work, time_segments, time_steps
from contactlab.scene.scene import Scene

STEPS = 100


class Timed:
    """A run of the mixed model as it is timed."""

    def __init__(self, scene: Scene, integrator: str) -> None:
        self.run = scene.resolve({"integrator": integrator}, 1, None)
        self.start = scene.initial_states([self.run])
        self.recorded = scene.prepare(self.run, self.start).model
        compiled = scene.written_model(self.run)
        self.model = scene.prepare(self.run, self.start, compiled).model
        work = count_work(self.model, self.start, STEPS)
        assert work is not None
        self.work: Work = work

    @property
    def segments(self) -> Segments:
        return Segments(self.model, self.start, self.work)

    def data(self) -> mujoco.MjData:
        data = mujoco.MjData(self.model)
        data.qpos[:], data.qvel[:] = self.start.qpos[0], self.start.qvel[0]
        data.ctrl[:] = self.start.ctrl[0]
        return data


@pytest.fixture(scope="module", params=["Euler", "RK4"])
def timed(mixed: Scene, request: pytest.FixtureRequest) -> Timed:
    return Timed(mixed, request.param)


def test_it_is_the_model_without_what_records(timed: Timed) -> None:
    assert timed.model.nsensor == 0 < timed.recorded.nsensor
    assert not timed.model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_ENERGY
    rollouts = [
        roll_out([model], timed.start, STEPS, Buffers()).state.tobytes()
        for model in (timed.model, timed.recorded)
    ]
    assert rollouts[0] == rollouts[1]


def test_work_is_what_a_plain_loop_counts(timed: Timed) -> None:
    data, counts = timed.data(), np.zeros(3, int)
    for _ in range(STEPS):
        mujoco.mj_step(timed.model, data)
        counts += [int(data.solver_niter[: timed.model.ntree].sum()), data.ncon, data.nefc]
    work = timed.work
    assert work.steps == STEPS
    assert [work.iterations, work.contacts, work.rows] == counts.tolist()
    assert min(counts) > 0


def test_places_lie_along_the_run(timed: Timed) -> None:
    """Each kept state is all of that before its step: going on from it makes the same steps."""
    assert timed.work.places == (0, 12, 25, 37, 50, 62, 75, 87)
    spec = int(mujoco.mjtState.mjSTATE_INTEGRATION)
    data = timed.data()
    done = 0
    for place, state in zip(timed.work.places, timed.work.states, strict=True):
        mujoco.mj_step(timed.model, data, place - done)
        done = place
        here = np.zeros_like(state)
        mujoco.mj_getState(timed.model, data, here, spec)
        assert here.tobytes() == state.tobytes()


@pytest.mark.parametrize(("most", "steps"), [(5, 40), (STEPS, STEPS)])
def test_steps_are_counted_as_made(timed: Timed, most: int, steps: int) -> None:
    seconds, made = time_segments(timed.segments, most, 3)
    assert made == 3 * steps
    assert seconds > 0
    assert len(time_steps(timed.segments, most)) == steps


class Clock:
    """A clock by which a step takes a microsecond, reading it a tenth, and all else an hour."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.nanoseconds = 0
        advance = self.advance
        monkeypatch.setattr("time.thread_time_ns", lambda: advance(100))
        monkeypatch.setattr("time.thread_time", lambda: 1e-9 * advance(100))

        class Batch(mujoco_batch.Batch):
            def reset(self, *args: Any, **rest: Any) -> None:
                super().reset(*args, **rest)
                advance(3600 * 10**9)

            def rollout(self, nstep: int, *args: Any, **rest: Any) -> Any:
                end = advance(1000 * nstep)
                result = super().rollout(nstep, *args, **rest)
                advance(end - advance(0))
                return result

        step = mujoco.mj_step
        monkeypatch.setattr(mujoco_batch, "Batch", Batch)
        monkeypatch.setattr("mujoco.mj_step", lambda *both: (step(*both), advance(1000)))

    def advance(self, nanoseconds: int) -> int:
        self.nanoseconds += nanoseconds
        return self.nanoseconds


def test_steps_are_timed_and_nothing_else(timed: Timed, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of the eight segments reads the clock once more than it counts: a tenth of a step."""
    Clock(monkeypatch)
    for repeats in (1, 2, 4):
        seconds, steps = time_segments(timed.segments, STEPS, repeats)
        assert seconds == pytest.approx((steps + 0.1 * repeats * SEGMENTS) * 1e-6, rel=1e-3)
    assert time_steps(timed.segments, STEPS) == pytest.approx(np.full(STEPS, 1e-6), rel=1e-9)
