"""What recording runs costs beside bare stepping: contacts from sensors, and from the kernel.

Run: python -m bench.reading_contacts [--rounds N] [--quick]

Each figure is the CPU time of this thread for all that the engine does with the runs of one job,
over that of `mj_step(model, data, n)` of the same runs on models without sensors. The three take
turns; medians of the rounds' ratios are shown, with the least and the most.
"""

import argparse
import copy
import itertools
import os
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import mujoco

from contactlab.engines import ENGINES, Buffers, PreparedRuns
from contactlab.scene.scene import Scene

_COLUMNS = 10  # of boxes
_HEIGHT = 5  # boxes in each


@dataclass(frozen=True)
class Case:
    """Runs of a scene, of a structure, so many of so long [s]; those of all effects."""

    name: str
    scene: str
    values: Mapping[str, object]
    runs: int
    seconds: float

    def prepare(self) -> PreparedRuns:
        """Compile the models, and find where the runs start."""
        scene = Scene.open(self.scene).with_effects("all")
        resolved = [scene.resolve(self.values, seed, self.seconds) for seed in range(self.runs)]
        return PreparedRuns.of(scene, *resolved)


def write_columns(folder: Path) -> None:
    """Write a scene of 50 boxes in columns, every pair of which is monitored."""
    folder.mkdir(exist_ok=True)
    count = _COLUMNS * _HEIGHT
    names = [f"box{number}" for number in range(count)]
    places = [(number // _HEIGHT, number % _HEIGHT) for number in range(count)]
    bodies = "".join(
        f'<body name="{name}" pos="{0.15 * column} 0 {0.05 + 0.1 * row}"><freejoint/>'
        f'<geom name="{name}" type="box" size=".05 .05 .05" mass="1"/></body>'
        for name, (column, row) in zip(names, places, strict=True)
    )
    floor = '<geom name="floor" type="plane" size="5 5 .1"/>'
    model = f'<mujoco><option timestep="0.002"/><worldbody>{floor}{bodies}</worldbody></mujoco>'
    (folder / "scene.xml").write_text(model, encoding="utf-8")
    pairs = "".join(f"  - {{geoms: [{a}, {b}]}}\n" for a, b in itertools.combinations(names, 2))
    head = "version: 1\ntitle: Columns\ndescription: Fifty boxes\nduration: 0.2\npairs:\n"
    (folder / "scene.yaml").write_text(head + pairs, encoding="utf-8")


def step_bare(runs: PreparedRuns) -> Callable[[], None]:
    """Return what steps the runs, and records nothing."""
    bare = [copy.copy(runs.scene.written_model(run)) for run in runs.resolved]

    def step() -> None:
        for run, model in enumerate(bare):
            data = mujoco.MjData(model)
            data.qpos[:], data.qvel[:] = runs.starts.qpos[run], runs.starts.qvel[run]
            mujoco.mj_step(model, data, runs.steps)

    return step


def record(runs: PreparedRuns, kernel: str) -> Callable[[], None]:
    """Return what rolls the runs out with the kernel on or off."""
    buffers = Buffers()

    def roll_out() -> None:
        os.environ["CONTACTLAB_KERNEL"] = kernel
        ENGINES["mujoco"].roll_out(runs, buffers)

    return roll_out


def measure(case: Case, rounds: int) -> None:
    """Print the line of one case."""
    runs = case.prepare()
    ways = {"bare": step_bare(runs), "off": record(runs, "off"), "on": record(runs, "on")}
    taken: dict[str, list[float]] = {name: [] for name in ways}
    for number in range(rounds + 1):
        for name, run in ways.items():
            begin = time.thread_time()
            run()
            # The first round compiles, and touches memory for the first time.
            taken[name] += [time.thread_time() - begin] if number else []
    step = median(taken["bare"]) / (case.runs * runs.steps)
    cells = (_spread(taken[name], taken["bare"]) for name in ("off", "on"))
    print(f"  {case.name:28}{step * 1e6:9.2f}  " + "".join(f"{cell:22}" for cell in cells))


def _spread(taken: list[float], bare: list[float]) -> str:
    ratios = sorted(one / other for one, other in zip(taken, bare, strict=True))
    return f"{median(ratios):.2f} ({ratios[0]:.2f}..{ratios[-1]:.2f})"


def main() -> None:
    """Measure every case."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--quick", action="store_true", help="a fifth of the rounds")
    options = parser.parse_args()
    rounds = max(1, options.rounds // 5) if options.quick else options.rounds
    with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as name:
        write_columns(Path(name))
        cases = (
            Case("ball, 1 pair", "ball_drop", {}, 8, 3.0),
            Case("five boxes, 5 pairs", "box_stack", {"boxes": 5}, 4, 3.0),
            Case("pile, 19 pairs", "pile", {}, 2, 1.0),
            Case("free fall, no pair", "free_fall", {}, 16, 2.0),
            Case("50 boxes, all 1,225 pairs", name, {}, 1, 0.2),
        )
        print(f"  {'':28}{'us a step':>9}  {'sensors / bare':22}{'kernel / bare':22}")
        for case in cases:
            measure(case, rounds)


if __name__ == "__main__":
    main()
