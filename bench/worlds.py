"""How many worlds a launch takes to be worth it: warp's steps beside MuJoCo's batch on all cores.

Run: python -m bench.worlds [cpu|cuda [most [scene]]]

Worlds are runs of one sweep that differ in friction and stiffness, of a scene without controls, as
the engine makes them: through its process, sensors and all. MuJoCo's are `mujoco.rollout` with a
thread for each core. Shown are steps of one world for each second of wall time, once everything is
set up: the difference of a long and a short rollout; and what setting up took. Wall time needs a
quiet machine.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from mujoco import rollout

from contactlab.engines import ENGINES
from contactlab.engines.adapted_engine import AdaptedEngine
from contactlab.engines.engine import PreparedRuns
from contactlab.parts import register_parts
from contactlab.plan.overrides import Overrides
from contactlab.studies.parity.panel import Panel, roll_out

SWEEP = """\
version: 1
scene: SCENE
sample: {method: random, n: COUNT, seed: 1}
axes:
  friction.slide: {uniform: [0.2, 1.0]}
  solref.timeconst: {uniform: [0.01, 0.03]}
"""
SHORT, LONG, FAST = 5, 45, 200_000  # steps of each world; of all worlds together, by MuJoCo


def prepared(scene: str, count: int) -> Callable[[int], PreparedRuns]:
    """Return what prepares runs of so many steps."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "worlds.yaml"
        file.write_text(SWEEP.replace("SCENE", scene).replace("COUNT", str(count)))
        panel = Panel.read(file, "warp", Overrides(), (), None)
    runs = [each.ours for each in panel.runs]

    def of(steps: int) -> PreparedRuns:
        timed = [replace(each, duration=steps * each.timestep) for each in runs]
        return PreparedRuns.of(panel.scene, *timed)

    return of


def paces(
    step: Callable[[PreparedRuns], object], of: Callable[[int], PreparedRuns], most: int
) -> str:
    """Return steps of a world for each second, and what comes before them [s]."""
    taken: dict[int, float] = {}
    for steps in (SHORT, most):
        runs = of(steps)
        begin = time.perf_counter()
        step(runs)
        taken[steps] = time.perf_counter() - begin
    each = (taken[most] - taken[SHORT]) / (most - SHORT)
    return f"{len(runs.prepared) / each:12,.0f} /s {taken[SHORT] - SHORT * each:8.2f} s"


def by_mujoco(runs: PreparedRuns) -> None:
    """Step runs by MuJoCo's own batch, a thread for each core."""
    starts, first = runs.starts, runs.models[0]
    parts = [np.zeros((len(runs.prepared), 1)), starts.qpos, starts.qvel, starts.act]
    data = [mujoco.MjData(first) for _ in range(os.cpu_count() or 1)]
    rollout.rollout(runs.models, data, np.concatenate(parts, axis=1), nstep=runs.steps)


def main() -> None:
    """Measure 1, 4, 16, ... worlds by both."""
    device, most, scene = (*sys.argv[1:], *("cpu", "4096", "box_slide")[len(sys.argv) - 1 :])
    engine = ENGINES["warp"]
    assert isinstance(engine, AdaptedEngine)
    there = engine.on(device)
    roll_out(there, prepared(scene, 1)(SHORT))  # which compiles
    print(f"{scene}: {os.cpu_count()} cores, warp {engine.version} on {device}")
    print("worlds    mujoco: steps, set-up       warp: steps, set-up")
    count = 1
    while count <= int(most):
        of = prepared(scene, count)
        ours = paces(by_mujoco, of, max(LONG, FAST // count))
        theirs = paces(lambda runs: roll_out(there, runs), of, LONG)
        print(f"{count:6}", ours, theirs)
        count *= 4


if __name__ == "__main__":
    register_parts()
    main()
