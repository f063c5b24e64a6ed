"""Repeats runs with a policy: it may draw from a generator without a seed, or read a clock."""

import multiprocessing
from dataclasses import replace
from pathlib import Path

from pydantic_core import from_json

from contactlab.run.tasks import CrashedJob, Stop, Task
from contactlab.run.worker_pool import LocalPool
from contactlab.scene.run_spec import RunSpec
from contactlab.temporary_folders import temporary_folder

_COMPARED = ("status", "steps", "trajectory_hash", "controls")


def find_unrepeatable(task: Task, runs: list[RunSpec], workers: int, stop: Stop) -> tuple[str, ...]:
    """Return the ids of those of some runs that differ when they are simulated again, alone.

    A run is simulated twice in one worker process and, unless all runs are in this process, in one
    that is not forked: there strings have other hashes. Nothing of it is kept. A run that ends its
    worker is left out.
    """
    pools = [(LocalPool(min(workers, 1)), 2)]
    if workers:
        pools.append((LocalPool(1, multiprocessing.get_context("spawn")), 1))
    unrepeatable: list[str] = []
    with temporary_folder() as folder:
        sweep = task.sweep.model_copy(update={"trace": "none", "checks": "none"})
        own = replace(task, sweep=sweep, store=Path(folder))
        for run in runs:
            rows = list[object]()
            for pool, repeats in pools:
                for result in pool.run(own, [(run,)] * repeats, stop):
                    if not isinstance(result, CrashedJob):
                        run_rows = [from_json(each.row) for each in result]
                        rows += [[row.get(name) for name in _COMPARED] for row in run_rows]
            if any(row != rows[0] for row in rows):
                unrepeatable.append(run.run_id)
    return tuple(unrepeatable)
