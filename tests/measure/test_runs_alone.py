"""What is measured of a run does not depend on the runs that are measured with it."""

import pytest

from contactlab import resources
from contactlab.engines import Buffers, PreparedRuns
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.engines.rollout_trace import make_trace
from contactlab.measure import assess_runs
from contactlab.scene.run_setup import make_setup
from contactlab.scene.scene import Scene
from contactlab.store.control_tables import read_control_table

pytestmark = pytest.mark.long

RUNS, STEPS, SECONDS = 3, 150, 0.3


@pytest.mark.parametrize("name", resources.scene_names())
def test_metrics_and_labels_are_those_of_the_run_alone(name: str) -> None:
    scene = Scene.open(name, tables=read_control_table)
    timestep = scene.resolve({}, 0, None).timestep
    resolved = [scene.resolve({}, seed, min(SECONDS, STEPS * timestep)) for seed in range(RUNS)]
    runs = PreparedRuns.of(scene, *resolved)
    rollout = MujocoEngine().roll_out(runs, Buffers())
    trace = make_trace(runs.base, runs.prepared, rollout)
    manifest = scene.source.manifest
    setup = make_setup(runs.base, manifest, resolved, runs.models, {}, [])
    together = assess_runs(trace, setup)
    for run in range(RUNS):
        alone = assess_runs(trace.select([run]), setup.select([run]))
        assert alone.labels[0] == together.labels[run]
        for metric, values in together.metrics.items():
            assert alone.metrics[metric].tobytes() == values[run : run + 1].tobytes(), metric
