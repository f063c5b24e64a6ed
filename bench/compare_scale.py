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
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from contactlab.compare import as_junit, as_markdown, as_text, compare
from contactlab.evidence import Store, sha256_of
from contactlab.measure import LABELS, METRICS
from contactlab.schema import ComparePolicy, StoreManifest

SIZES = (10_000, 1_000_000)
SWEEP = "box_slide"
_CHUNK = 100_000
Rows = NDArray[np.int64]


def main() -> None:
    """Make stores and measure each size in a process of its own, or be that process."""
    if sys.argv[1:2] == ["--one"]:
        measure(Path(sys.argv[2]), Path(sys.argv[3]), sys.argv[4])
        return
    sizes = [int(each) for each in sys.argv[1:]] or SIZES
    print(f"{'runs':>9}  {'matched by':10}  {'CPU [s]':>8}  {'wall [s]':>8}  {'peak [MB]':>9}")
    for runs in sizes:
        with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as name:
            template = real_store(Path(name) / "real")
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
    report = compare(baseline, candidate, policy)
    for render in (as_text, as_markdown, as_junit):
        render(report)
    spent = time.process_time() - cpu, time.perf_counter() - wall
    assert report.pairs.missing == report.pairs.new == 0
    assert any(check.verdict == "worse" for check in report.checks)
    print(json.dumps([*spent, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024]))


def real_store(folder: Path) -> Store:
    """Return a store of a real sweep, whose schema the made-up ones have."""
    sweep = folder.with_suffix(".yaml")
    sweep.write_text(f"version: 1\nscene: {SWEEP}\naxes: {{timestep: [1e-3, 2e-3]}}\ntrace: none\n")
    program = str(Path(sys.executable).with_name("contactlab"))
    command = [program, "sweep", str(sweep), "-o", str(folder), "--workers", "0"]
    subprocess.run(command, capture_output=True, check=True)
    return Store.open(folder)


def make_store(path: Path, runs: int, template: Store) -> Path:
    """Write a store of made-up runs; called `new`, it is in another order and worse in places."""
    path.mkdir()
    schema = template.table.schema
    with pq.ParquetWriter(path / "runs.parquet", schema, compression="zstd") as writer:
        for chunk in chunks(runs, template, worse=path.name == "new"):
            writer.write_table(chunk)
    identity = template.manifest.sweep.model_copy(update={"runs_asked": runs})
    (path / "sweep.json").write_text(identity.model_dump_json())
    labels = pq.read_table(path / "runs.parquet", columns=["label"])["label"].value_counts()
    now = datetime.now(UTC).isoformat()
    manifest = StoreManifest(
        sweep=identity,
        provenance=template.manifest.provenance,
        runs=runs,
        labels={each["values"]: each["counts"] for each in labels.to_pylist()},
        statuses={"ok": runs},
        traces=0,
        expectations={"none": runs},
        files={name: sha256_of(path / name) for name in ("runs.parquet", "sweep.json")},
        started=now,
        finished=now,
    )
    (path / "manifest.json").write_text(manifest.model_dump_json())
    return path


def chunks(runs: int, template: Store, *, worse: bool) -> Iterator[pa.Table]:
    """Yield the table of made-up runs in parts."""
    first = template.table.slice(0, 1)
    starts = range(0, runs, _CHUNK)
    for start in reversed(starts) if worse else starts:
        size = min(_CHUNK, runs - start)
        made = made_up(np.arange(start, start + size), np.random.default_rng(start), worse=worse)
        columns = [
            made[name]
            if name in made
            else pa.chunked_array([[value[0].as_py()] * size], value.type)
            for name, value in zip(first.column_names, first.columns, strict=True)
        ]
        yield pa.Table.from_arrays(
            [column.cast(field.type) for column, field in zip(columns, first.schema, strict=True)],
            schema=first.schema,
        )


def made_up(
    index: NDArray[np.int64], rng: np.random.Generator, *, worse: bool
) -> dict[str, pa.Array]:
    """Return the columns of runs (n,) that differ from run to run."""
    ids = [f"{number * 0x9E3779B97F4A7C15 % 2**64:016x}" for number in index.tolist()]
    labels = rng.choice(list(LABELS)[-4:], len(index)).tolist()
    made: dict[str, pa.Array] = {
        "run_id": pa.array(ids),
        "index": pa.array(index),
        "seed": pa.array(index % 1000),
        "timestep": pa.array(1e-5 * (1 + index // 1000)),
        "label": pa.array(labels),
        "labels": pa.array([[label] for label in labels]),
        "trajectory_hash": pa.array([f"{run}{worse:x}{run}" for run in ids]),
    }
    for number, name in enumerate(METRICS):
        values = np.exp(rng.normal(size=len(index)))
        absent = rng.random(len(index)) < (0.2 if number % 5 == 0 else 0)
        bad = rng.random(len(index)) < 1e-3
        made[name] = pa.array(np.where(bad & worse, 2 * values, values), mask=absent)
    return made


if __name__ == "__main__":
    main()
