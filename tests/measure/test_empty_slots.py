"""What is measured has the same bits with any number of slots that no contact fills.

The kernel keeps as many as some run of a job fills, sensors as many as are declared.
"""

from dataclasses import replace

import numpy as np
import pytest

from contactlab import resources
from contactlab.contact.trace_arrays import PairTrace, sum_of_slots
from contactlab.engines import Buffers, PreparedRuns
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.engines.rollout_trace import make_trace
from contactlab.measure import assess_runs
from contactlab.scene.run_setup import make_setup
from contactlab.scene.scene import Scene
from contactlab.store.control_tables import read_control_table

STEPS = 400
SEEDS = 4


def with_slots(pair: PairTrace, count: int) -> PairTrace:
    """Return a pair with so many slots; those that hold a contact come first."""
    slots = np.zeros((*pair.slots.shape[:2], count, pair.slots.shape[3]))
    kept = pair.slots[:, :, :count]
    slots[:, :, : kept.shape[2]] = kept
    return replace(pair, slots=slots)


@pytest.mark.long
@pytest.mark.parametrize("name", resources.scene_names())
def test_they_change_no_bit(name: str) -> None:
    scene = Scene.open(name, tables=read_control_table)
    duration = min(scene.duration, STEPS * scene.resolve({}, 0, None).timestep)
    resolved = [scene.resolve({}, seed, duration) for seed in range(SEEDS)]
    runs = PreparedRuns.of(scene, *resolved)
    trace = make_trace(runs.base, runs.prepared, MujocoEngine().roll_out(runs, Buffers()))
    setup = make_setup(runs.base, scene.source.manifest, resolved, runs.models, {})
    filled = [int(max(1, each.touching.sum(axis=2).max(initial=0))) for each in trace.pairs]
    few, *others = [
        assess_runs(replace(trace, pairs=tuple(map(with_slots, trace.pairs, counts))), setup)
        for counts in (filled, [each + 1 for each in filled], [each + 20 for each in filled])
    ]
    for other in others:
        assert few.labels == other.labels
        for key, value in few.metrics.items():
            assert value.tobytes() == other.metrics[key].tobytes(), key


def test_sums_are_those_of_a_loop() -> None:
    values = np.random.default_rng(0).standard_normal((3, 5, 17, 2))
    total = np.zeros((3, 5, 2))
    for slot in range(17):
        total += values[:, :, slot]
    assert sum_of_slots(values, axis=2).tobytes() == total.tobytes()
