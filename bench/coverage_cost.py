"""What it costs to find out what runs exercised, as a share of bare stepping.

Run: python -m bench.coverage_cost [scene ...]

CPU time of this thread, the least of several rounds. Coverage is what `coverages` takes for eight
runs; loads of equalities, from states along the runs, are a column of their own.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

import mujoco

from contactlab.engines import ENGINES, Buffers, PreparedRuns
from contactlab.engines.rollout_trace import make_trace
from contactlab.engines.sampled_loads import with_loads
from contactlab.measure import context_of
from contactlab.measure.coverage import run_coverages
from contactlab.parts import register_parts
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.run_setup import make_setup

RUNS, ROUNDS = 8, 7
SCENES = {"box_stack": {"boxes": 5}, "ball_drop": {}, "box_slide": {}}


def least(work: Callable[[], object]) -> float:
    """Return the least CPU time of several rounds [s]."""
    times: list[float] = []
    for _ in range(ROUNDS):
        begin = time.thread_time()
        work()
        times.append(time.thread_time() - begin)
    return min(times)


def measure(reference: str, values: dict[str, object]) -> None:
    """Print the shares of one scene."""
    scene = SceneLoader(Path()).open(reference).with_effects("all")
    resolved = [scene.resolve(values, seed, None) for seed in range(RUNS)]
    runs = PreparedRuns.of(scene, *resolved)
    rollout = ENGINES["mujoco"].roll_out(runs, Buffers())
    trace = make_trace(runs.base, runs.prepared, rollout)
    setup = make_setup(runs.base, scene.source.manifest, resolved, runs.models, {})
    context, start = context_of(trace, setup), runs.starts.select_run(0)

    def step() -> None:
        data = mujoco.MjData(runs.models[0])
        data.qpos[:], data.qvel[:], data.ctrl[:] = start.qpos[0], start.qvel[0], start.ctrl[0]
        mujoco.mj_step(runs.models[0], data, runs.steps)

    bare = least(step) * RUNS
    shares = (least(lambda: run_coverages(context)), least(lambda: with_loads(runs, rollout)))
    print(f"{reference}: coverage {shares[0] / bare:.2%}, loads {shares[1] / bare:.2%} of stepping")


def main() -> None:
    """Measure the scenes that are named, or some of each kind."""
    for reference in sys.argv[1:] or SCENES:
        measure(reference, dict(SCENES.get(reference, {})))


if __name__ == "__main__":
    register_parts()
    main()
