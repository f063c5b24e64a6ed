"""Memory of rollouts is reused, without any effect on them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactlab.engines.engine import Buffers, bytes_of_run
from contactlab.engines.mujoco_batch import roll_out
from contactlab.engines.rollout_trace import trajectory_hash
from contactlab.scene.scene import Scene


@pytest.mark.long
@given(
    calls=st.lists(
        st.tuples(st.integers(1, 3), st.integers(1, 40), st.integers(1, 3)), min_size=2, max_size=5
    )
)
@settings(max_examples=15)
def test_later_calls_equal_those_with_fresh_memory(calls: list[tuple[int, int, int]]) -> None:
    scene, buffers = Scene.open("box_stack"), Buffers()
    for boxes, steps, runs in calls:
        resolved = [scene.resolve({"boxes": boxes}, seed, None) for seed in range(runs)]
        base = scene.base(resolved[0].structure)
        models = [base.prepare(run.list_edits()).model for run in resolved]
        starts = scene.initial_states(resolved)
        used = roll_out(models, starts, steps, buffers)
        fresh = roll_out(models, starts, steps, Buffers())
        assert np.array_equal(used.state, fresh.state)
        assert np.array_equal(used.sensors, fresh.sensors)
        assert np.array_equal(used.iterations, fresh.iterations)


def test_memory_of_a_smaller_call_is_that_of_the_last() -> None:
    model, buffers = Scene.open("ball_drop").base({}).model, Buffers()
    large = buffers.arrays(model, 4, 100)
    small = buffers.arrays(model, 2, 50)
    assert np.shares_memory(large.state, small.state)
    assert not np.shares_memory(small.state, small.sensors)


@pytest.mark.parametrize("name", ["ball_drop", "box_stack"])
def test_bytes_of_run_is_what_a_run_takes(name: str) -> None:
    model = Scene.open(name).base({}).model
    arrays = Buffers().arrays(model, 1, 1000)
    taken = arrays.state.nbytes + arrays.sensors.nbytes + arrays.iterations.nbytes
    assert bytes_of_run(model, 1000) == pytest.approx(taken, rel=2e-3)


def test_the_hash_depends_on_the_last_bit(roll: Any) -> None:
    rollout = roll(Scene.open("ball_drop"), [{}, {}, {"cone": "elliptic"}], 50).rollout
    hashes = [trajectory_hash(rollout, run) for run in range(3)]
    again = roll(Scene.open("ball_drop"), [{}, {}], 50).rollout
    # Seeds 0 and 1 start apart; the cone does not matter to a ball in the air, but the seed does.
    assert len(set(hashes)) == 3
    assert [trajectory_hash(again, run) for run in range(2)] == hashes[:2]
    for row in (0, 30, -1):
        own = rollout.state[0, row, 3]
        rollout.state[0, row, 3] = np.nextafter(own, np.inf)
        assert trajectory_hash(rollout, 0) != hashes[0]
        rollout.state[0, row, 3] = own
    assert trajectory_hash(rollout, 0) == hashes[0]


def test_the_hash_ends_where_the_run_did(roll: Any) -> None:
    rollout = roll(Scene.open("ball_drop"), [{}], 50).rollout
    short = replace(rollout, steps=(20,))
    own = trajectory_hash(short, 0)
    assert own != trajectory_hash(rollout, 0)
    rollout.state[0, 21:] = np.nan
    assert trajectory_hash(short, 0) == own
