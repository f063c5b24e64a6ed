"""Work is what a plain loop counts, and what is timed is the run itself, part by part."""

import mujoco
import numpy as np
import pytest

from contactlab.engines import Buffers, Segments, Work, roll_out
from contactlab.engines.step_timing import count_work, time_segments, time_steps
from contactlab.scene.scene import Scene, compile_without_sensors, prepare_without_sensors

STEPS = 100


class Timed:
    """A run of the mixed model as it is timed."""

    def __init__(self, scene: Scene, integrator: str) -> None:
        self.run = scene.resolve({"integrator": integrator}, 1, None)
        self.start = scene.starts([self.run])
        self.recorded = scene.prepare(self.run, self.start).model
        compiled = compile_without_sensors(scene, self.run)
        self.model = prepare_without_sensors(scene, self.run, self.start, compiled)
        work = count_work(self.model, self.start, STEPS)
        assert work is not None
        self.work: Work = work

    @property
    def segments(self) -> Segments:
        return Segments(self.model, self.start, self.work.places, self.work.states, STEPS)

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


def test_twice_the_steps_take_twice_the_time(timed: Timed) -> None:
    """CPU time of a thread spreads by a tenth; the least of some is compared."""
    ones = min(time_segments(timed.segments, STEPS, 2)[0] for _ in range(9))
    twos = min(time_segments(timed.segments, STEPS, 4)[0] for _ in range(9))
    assert twos / ones == pytest.approx(2, rel=0.25)


def test_single_steps_add_up_to_the_whole(timed: Timed) -> None:
    """A step of ten microseconds and more pays one for the call from Python; the rest is noise."""
    single = min(float(np.sum(time_steps(timed.segments, STEPS))) for _ in range(9))
    whole = min(time_segments(timed.segments, STEPS, 1)[0] for _ in range(9))
    assert 0.7 * whole < single < 1.6 * whole
