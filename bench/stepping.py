"""Bare native stepping: `mj_step(model, data, n)` and nothing else, the yardstick of the bench.

Run: python -m bench.stepping RUNS.json RESULT.json
"""

import json
import multiprocessing
import sys
import time
from pathlib import Path

import mujoco
from bench.plain import PlainRun, load

PROCESSES = 2


def step(run: PlainRun) -> tuple[float, list[float]]:
    """Return the thread CPU time of stepping [s], without compiling, and the last qpos."""
    model, data = run.start()
    start = time.thread_time()
    mujoco.mj_step(model, data, run.steps)
    return time.thread_time() - start, data.qpos.tolist()


def main() -> None:
    """Step every run, on as many processes as the sweep has workers, so that the load is alike."""
    runs = load(Path(sys.argv[1]))
    with multiprocessing.Pool(PROCESSES) as pool:
        results = pool.map(step, runs, chunksize=4)
    Path(sys.argv[2]).write_text(json.dumps(results), encoding="utf-8")


if __name__ == "__main__":
    main()
