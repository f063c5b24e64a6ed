"""What a budget costs: of gymnasium's humanoid, 2 s, 3 seeds, 12 rows; and of a scene.

Run: python -m bench.budget [FOLDER]

FOLDER has gymnasium's models (gymnasium/envs/mujoco/assets); without one, what is installed is
used. Times are of the wall and of all cores' work, beside what the run itself takes.
"""

import sys
import time
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np

from contactlab.budget import Motion, budget_report, error_budget, judge, motion_of_run
from contactlab.budget.motion import INTEGRATION
from contactlab.engines import PreparedRuns
from contactlab.modifications.catalogue import list_rows
from contactlab.parts import register_parts
from contactlab.rendering.text import render_text
from contactlab.reporting.budget_document import describe_budget
from contactlab.run.sweep_request import SceneLoader

_TWELVE = (
    "step",
    "solver",
    "cone",
    "impratio",
    "noslip",
    "contact softness",
    "limit softness",
    "condim 1",
    "damping",
    "limits",
    "gravity",
    "friction 10 %",
)


def assets() -> Path:
    """Return the folder of gymnasium's models."""
    if len(sys.argv) > 1:
        return Path(sys.argv[1])
    spec = find_spec("gymnasium")
    if spec is None or spec.origin is None:
        sys.exit("gymnasium is not installed: name a folder of its models")
    return Path(spec.origin).parent / "envs/mujoco/assets"


def driven_by_sines(model: mujoco.MjModel, seconds: float, seeds: int) -> Motion:
    """Return a motion under sines of .5 to 1.5 Hz within 70 % of the control ranges."""
    data, steps = mujoco.MjData(model), round(seconds / model.opt.timestep)
    start = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_getState(model, data, start, INTEGRATION)
    low, high = model.actuator_ctrlrange.T
    random = np.random.default_rng(0)
    hertz, phase = random.uniform(0.5, 1.5, (seeds, 1, model.nu)), random.uniform(0, 6, model.nu)
    times = np.arange(steps)[:, None] * model.opt.timestep
    wave = np.sin(2 * np.pi * hertz * times + phase)
    return Motion(model, np.tile(start, (seeds, 1)), (low + high) / 2 + 0.35 * (high - low) * wave)


def measure(name: str, motion: Motion, rows: tuple[str, ...] | None, most: float) -> None:
    """Print a budget, and what it took."""
    begin, cpu = time.perf_counter(), time.process_time()
    budget = error_budget([motion], rows=rows)
    wall, cpu = time.perf_counter() - begin, time.process_time() - cpu
    print(render_text(describe_budget(budget_report(budget, judge(budget)))))
    print(f"{name}: {wall:.1f} s, {cpu:.1f} s of CPU; {most:g} s are meant on two cores\n")


def main() -> None:
    """Measure both."""
    humanoid = mujoco.MjModel.from_xml_path(str(assets() / "humanoid.xml"))
    measure("humanoid", driven_by_sines(humanoid, 2.0, 3), _TWELVE, 15.0)
    scene = SceneLoader(Path()).open("box_slide").with_effects("all")
    runs = PreparedRuns.of(scene, scene.resolve({}, 0, None))
    motion = motion_of_run(runs.models[0], runs.starts, 0, runs.steps)
    measure("box_slide", motion, tuple(row.name for row in list_rows()), 3.0)


if __name__ == "__main__":
    register_parts()
    main()
