"""What a second pass costs: CPU time that `checks: all` adds to a sweep, over bare stepping.

Run: python -m bench.second_pass [TREE ...]

Each TREE is the root of another checkout, whose package is measured beside this one, interleaved;
it must run with what is installed here. Shown are medians over rounds.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from statistics import median

import mujoco

from contactlab.engines import PreparedRuns
from contactlab.engines.mujoco_batch import driven_inputs, start_batch
from contactlab.scene.scene import Scene

SCENES = ("ball_drop", "box_stack", "gripping_pad", "grasp_mug")
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
        shares = "  ".join(f"{median(times) / median(bare):6.2f}" for times in found)
        print(f"{scene:14}{shares}", flush=True)


if __name__ == "__main__":
    main()
