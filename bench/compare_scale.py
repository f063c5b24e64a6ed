"""What comparing costs: two made-up stores of 10,000 and of 1,000,000 runs.

Run: python -m bench.compare_scale [runs]...

The stores have every column of a real one, by the schema that sweeps write: metrics drawn from log
normal numbers, every fifth of them null in some runs, labels, axes and hashes. In the candidate one
run in a thousand is worse, and its runs are in another order. Each comparison is a process of its
own; CPU time counts from when everything is imported, and memory is the process's peak.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
from bench.made_up import Rows, ids_of, parts_of, real_store, tables, write_store
from pyarrow.compute import call_function

from contactlab.comparison.compare_stores import compare_stores
from contactlab.comparison.report import report_of
from contactlab.measure import LABELS, METRICS
from contactlab.parts import register_parts
from contactlab.schema.comparison import ComparePolicy
from contactlab.store.finished_store import Store
from contactlab.writers import as_junit, as_markdown, as_text

SIZES = (10_000, 1_000_000)
SWEEP = "{version: 1, scene: box_slide, axes: {timestep: [1e-3, 2e-3]}, trace: none}"


def main() -> None:
    """Make stores and measure each size in a process of its own, or be that process."""
    if sys.argv[1:2] == ["--one"]:
        measure(Path(sys.argv[2]), Path(sys.argv[3]), sys.argv[4])
        return
    sizes = [int(each) for each in sys.argv[1:]] or SIZES
    print(f"{'runs':>9}  {'matched by':10}  {'CPU [s]':>8}  {'wall [s]':>8}  {'peak [MB]':>9}")
    for runs in sizes:
        with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as name:
            template = real_store(Path(name) / "real", SWEEP)
            stores = [make_store(Path(name) / each, runs, template) for each in ("old", "new")]
            for match in ("id", "axes"):
                command = [sys.executable, "-m", "bench.compare_scale", "--one"]
                done = subprocess.run(
                    [*command, *map(str, stores), match], capture_output=True, text=True, check=True
                )
                cpu, wall, peak = json.loads(done.stdout)
                print(f"{runs:>9,}  {match:10}  {cpu:8.2f}  {wall:8.2f}  {peak / 1e6:9,.0f}")


def measure(baseline: Path, candidate: Path, match: str) -> None:
    """Compare two stores and print CPU time [s], wall time [s] and peak memory [B]."""
    policy = ComparePolicy.model_validate({"version": 1, "match": match})
    cpu, wall = time.process_time(), time.perf_counter()
    report = compare_stores(baseline, candidate, policy)
    for render in (as_text, as_markdown, as_junit):
        render(report_of(report))
    spent = time.process_time() - cpu, time.perf_counter() - wall
    assert report.pairs.missing == report.pairs.new == 0
    assert any(check.verdict == "worse" for check in report.findings)
    print(json.dumps([*spent, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024]))


def make_store(path: Path, runs: int, template: Store) -> Path:
    """Write a store of made-up runs; called `new`, it is in another order and worse in places."""
    worse = path.name == "new"
    parts = parts_of(runs)[:: -1 if worse else 1]
    last = runs if worse else None
    return write_store(path, runs, template, tables(parts, template, partial(made_up, last=last)))


def made_up(index: Rows, *, last: int | None) -> dict[str, pa.Array]:
    """Return the columns of runs (n,) that differ from run to run.

    Of the worse store, in whose plan they stand the other way round, the last one is given.
    """
    worse = last is not None
    places = index if last is None else last - 1 - index[::-1]
    rng = np.random.default_rng(index[0])
    ids = ids_of(index)
    labels = rng.choice(list(LABELS)[-4:], len(index)).tolist()
    made: dict[str, pa.Array] = {
        "run_id": ids,
        "index": pa.array(places),
        "seed": pa.array(index % 1000),
        "timestep": pa.array(1e-5 * (1 + index // 1000)),
        "label": pa.array(labels),
        "labels": pa.array([[label] for label in labels]),
        "trajectory_hash": call_function(
            "binary_join_element_wise", [ids, ids, pa.scalar(f"{worse:x}")]
        ),
    }
    for number, name in enumerate(METRICS):
        values = np.exp(rng.normal(size=len(index)))
        absent = rng.random(len(index)) < (0.2 if number % 5 == 0 else 0)
        bad = rng.random(len(index)) < 1e-3
        made[name] = pa.array(np.where(bad & worse, 2 * values, values), mask=absent)
    return made


if __name__ == "__main__":
    register_parts()
    main()
