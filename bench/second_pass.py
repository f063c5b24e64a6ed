"""What a second pass costs: CPU time that `checks: all` adds to a sweep, over bare stepping.

Run: python -m bench.second_pass [TREE ...]

Each TREE is the root of another checkout, whose package is measured beside this one, interleaved;
it must run with what is installed here. Shown are medians over rounds, with least and most, and
the number of steps that it must make for one of the run.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from statistics import median

import mujoco

from contactlab.budget.measuring import FINER, WINDOW
from contactlab.budget.motion import motion_of_run
from contactlab.budget.windows import cut_windows
from contactlab.engines import PreparedRuns
from contactlab.engines.mujoco_batch import driven_inputs, start_batch
from contactlab.scene.scene import Scene

SCENES = ("mug_drop", "grasp_mug", "box_stack", "ball_drop", "gripping_pad")
SEEDS, ROUNDS, REPEATS = 2, 3, 3
HERE = Path(__file__).parents[1]
_CHILD = """
import json, sys, tempfile, time
import contactlab
sweep = json.loads(sys.argv[1])
def seconds(checks):
    with tempfile.TemporaryDirectory() as folder:
        begin = time.process_time()
        contactlab.sweep(sweep | {"checks": checks}, output=folder + "/store", workers=0)
        return time.process_time() - begin
seconds("all")
print(json.dumps([seconds("all") - seconds("none") for _ in range(int(sys.argv[2]))]))
"""


def sweep_of(scene: str) -> dict[str, object]:
    """Return a sweep of a scene as it is."""
    return {"version": 1, "scene": scene, "axes": {}, "trace": "none", "seeds": SEEDS}


def second_passes(tree: Path, scene: str) -> list[float]:
    """Return CPU times of second passes over a scene's runs by a tree's package [s]."""
    command = [sys.executable, "-c", _CHILD, json.dumps(sweep_of(scene)), str(REPEATS)]
    environment = os.environ | {"PYTHONPATH": str(tree / "cli")}
    told = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    return json.loads(told.stdout.splitlines()[-1])


def bare_steps(scene: str) -> float:
    """Return the CPU time of the same runs' steps alone, with no sensor [s]."""
    loaded = Scene.open(scene)
    assert loaded.source.manifest is not None
    duration = loaded.source.manifest.duration
    runs = PreparedRuns.of(loaded, *(loaded.resolve({}, seed, duration) for seed in range(SEEDS)))
    spent = 0.0
    for run, model in enumerate(runs.models):
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
        start = runs.starts.select_run(run)
        batch, inputs = start_batch([model], start), driven_inputs(model, start, 0, runs.steps)
        begin = time.process_time()
        batch.rollout(runs.steps, record=[], **inputs)
        spent += time.process_time() - begin
    return spent


def least_steps(scene: str) -> float:
    """Return how many steps a second pass cannot do without, for one of the run.

    It makes the run again, and in each window a reference at a quarter of the step, which goes on
    for one step of the run.
    """
    loaded = Scene.open(scene)
    assert loaded.source.manifest is not None
    runs = PreparedRuns.of(loaded, loaded.resolve({}, 0, loaded.source.manifest.duration))
    length, begins = cut_windows(motion_of_run(runs.models[0], runs.starts, 0, runs.steps), WINDOW)
    return 1 + FINER * (length + 1) * len(begins) / runs.steps


def main() -> None:
    """Print a line for each scene: a column for each tree, this one first."""
    trees = [HERE, *map(Path, sys.argv[1:])]
    for scene in SCENES:
        found: list[list[float]] = [[] for _ in trees]
        bare = list[float]()
        for _ in range(ROUNDS):
            bare.append(bare_steps(scene))
            for times, tree in zip(found, trees, strict=True):
                times.extend(second_passes(tree, scene))
        one = median(bare)
        shares = (
            f"{median(times) / one:6.2f} ({min(times) / one:.2f}..{max(times) / one:.2f})"
            for times in found
        )
        print(f"{scene:14}{'  '.join(shares)}  least {least_steps(scene):.2f} steps", flush=True)


if __name__ == "__main__":
    main()
