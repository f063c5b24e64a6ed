"""What a worker takes for runs beside bare stepping: all that it does, without and with traces.

Run: python -m bench.worker_cost [--rounds 5] [--quick]

Each figure is the CPU time of one thread for the jobs of a sweep, from their plans to the rows and
traces, over that of `mj_step(model, data, n)` of the same runs on models without sensors. Start-up
and the sweep's own process are left out: `bench.overhead` has them. All ways take turns; medians of
the rounds' ratios are shown, with the least and the most.
"""

import argparse
import copy
import tempfile
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from statistics import median
from unittest.mock import patch

import mujoco
from bench.cases import BALL, COLUMNS, FALL, STACK
from bench.measuring import SWEEPS
from bench.reading_contacts import write_columns

from contactlab.accuracy.reference import PlannedModel
from contactlab.errors import StoppedError
from contactlab.parts import register_parts
from contactlab.plan.overrides import Overrides
from contactlab.run import sweep_runner
from contactlab.run.planned_runs import Preparer
from contactlab.run.sweep_request import read_request
from contactlab.run.tasks import FinishedRun, Job, Task
from contactlab.run.worker import Worker
from contactlab.scene.scene import Scene

CASES = {
    "ball": (BALL, 16),
    "five boxes": (STACK.replace("BOXES", "5"), 32),
    "free fall": (FALL, 192),
    "50 boxes, all pairs": (COLUMNS, 4),
}


def jobs_of(sweep: Path, store: Path, changes: Iterable[str]) -> tuple[Task, list[Job]]:
    """Return the task of a sweep, and the jobs that its workers would be given."""
    asked: list[tuple[Task, list[Job]]] = []

    def keep(task: Task, jobs: Iterable[Job], *_: object) -> list[list[FinishedRun]]:
        asked.append((task, list(jobs)))
        raise StoppedError("asked for jobs alone")

    overrides = Overrides(tuple(changes))
    folder = sweep.parent
    request = read_request(sweep, sweep.stem, store, folder=folder, workers=2, overrides=overrides)
    with patch.object(sweep_runner, "run_all_jobs", keep), suppress(StoppedError):
        sweep_runner.run_sweep(request, lambda *_: None, lambda *_: None)
    return asked[0]


def stepped(scene: Scene, plans: Iterable[PlannedModel]) -> float:
    """Return what bare steps of runs take [s]."""
    seconds = 0.0
    for plan in plans:
        model = copy.copy(scene.written_model(plan.run))
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = plan.start.qpos[0], plan.start.qvel[0]
        begin = time.thread_time()
        mujoco.mj_step(model, data, plan.run.steps)
        seconds += time.thread_time() - begin
    return seconds


def worked(worker: Worker, jobs: Iterable[Job]) -> float:
    """Return what a worker takes for jobs [s]."""
    begin = time.thread_time()
    for job in jobs:
        worker.run(job)
    return time.thread_time() - begin


def measure(name: str, folder: Path, rounds: int) -> None:
    """Print the line of one case."""
    text, seeds = CASES[name]
    sweep = folder / "sweep.yaml"
    sweep.write_text(f"{text}seeds: {seeds}\n", encoding="utf-8")
    asked = {way: jobs_of(sweep, folder / way, changes) for way, changes in SWEEPS.items()}
    ways = {way: (Worker(task, None), jobs) for way, (task, jobs) in asked.items()}
    task, jobs = asked["none"]
    preparer = Preparer(task, None)
    plans = [plan for job in jobs for plan in preparer.plan_job(job)]
    found: dict[str, list[float]] = {way: [] for way in ways}
    bare: list[float] = []
    for number in range(rounds + 1):
        own = stepped(preparer.scene, plans)
        taken = {way: worked(*each) for way, each in ways.items()}
        # The first round touches memory and looks things up for the first time.
        bare += [own] if number else []
        for way, seconds in taken.items():
            found[way] += [seconds / own] if number else []
    cells = (f"{median(each):.2f} ({min(each):.2f}..{max(each):.2f})" for each in found.values())
    print(
        f"  {name:22}{median(bare) / len(plans) * 1e3:9.2f}  " + "".join(f"{c:22}" for c in cells)
    )


def main() -> None:
    """Measure every case."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="one round")
    options = parser.parse_args()
    print(f"  {'':22}{'ms a run':>9}  " + "".join(f"{way:22}" for way in SWEEPS))
    for name in CASES:
        with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as folder:
            write_columns(Path(folder) / "columns")
            measure(name, Path(folder), 1 if options.quick else options.rounds)


if __name__ == "__main__":
    register_parts()
    main()
