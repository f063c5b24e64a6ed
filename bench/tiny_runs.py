"""What a million tiny runs cost, from fewer: time, memory of every process, and disk.

Run: python -m bench.tiny_runs [--runs 20000] [--trace none]

A ball falls for ten steps, which take some microseconds: what is measured is what a run costs
beside its physics. CPU time is that of the whole process tree, user and system. Memory is what a
process has to itself, sampled as the runs finish; its growth is a line through the second half of
the samples. The start of the command, measured with a few runs, is taken off before the rest is
scaled up to a million.
"""

import argparse
import os
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from bench.processes import adopt_orphans, cpu_of
from bench.tree_memory import Memory, TreeMemory

MILLION = 1_000_000
FEW = 500
STEPS = 10
SWEEP = """\
version: 1
scene: ball_drop
duration: {duration}
seeds: {seeds}
trace: {trace}
checks: none
axes:
  timestep: [1.0e-3]
  drop_height: [0.005, 0.01, 0.02, 0.05]
"""
ROWS = 4


class Journal:
    """Counts the lines of a journal as it grows.

    Attributes:
        lines: how many there are.
        size: of them all [bytes].
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.lines = self.size = 0

    def count(self) -> int:
        """Return how many lines there are by now."""
        if self._path.exists():
            with self._path.open("rb") as file:
                file.seek(self.size)
                part = file.read()
            self.lines += part.count(b"\n")
            self.size += len(part)
        return self.lines


@dataclass(frozen=True)
class Taken:
    """What one sweep took.

    Attributes:
        runs: how many runs it had.
        cpu: of all processes [s].
        wall: time that passed [s].
        memory: of each process.
        row: bytes of a run in the journal.
        table: bytes of the table.
        traces: bytes of all traces.
    """

    runs: int
    cpu: float
    wall: float
    memory: list[Memory]
    row: float
    table: int
    traces: int


def sweep(folder: Path, runs: int, trace: str, workers: int) -> Taken:
    """Run a sweep of so many runs and return what it took."""
    file, store = folder / "tiny.yaml", folder / "store"
    shutil.rmtree(store, ignore_errors=True)
    text = SWEEP.format(duration=STEPS * 1e-3, seeds=-(-runs // ROWS), trace=trace)
    file.write_text(text, encoding="utf-8")
    journal = Journal(store / "journal.jsonl")
    command = [str(Path(sys.executable).with_name("contactlab")), "sweep", str(file), "--yes"]
    begin = time.monotonic()
    with TreeMemory(journal.count) as memory:
        cpu = cpu_of([*command, "-o", str(store), "--workers", str(workers)])
    return Taken(
        runs=-(-runs // ROWS) * ROWS,
        cpu=cpu,
        wall=time.monotonic() - begin,
        memory=list(memory.found.values()),
        row=journal.size / max(1, journal.lines),
        table=(store / "runs.parquet").stat().st_size,
        traces=sum(path.stat().st_size for path in store.glob("traces/*/*.mcap")),
    )


def show(few: Taken, many: Taken) -> None:
    """Print what was measured, and what a million runs come to."""
    more = many.runs - few.runs
    cpu, wall = (many.cpu - few.cpu) / more, (many.wall - few.wall) / more
    print(f"{many.runs:,} runs: {many.wall:.1f} s, {many.cpu:.1f} s of CPU; start {few.wall:.1f} s")
    print(f"a run: {wall * 1e3:.3f} ms ({1 / wall:,.0f} a second), {cpu * 1e3:.3f} ms of CPU")
    print(f"a million: {MILLION * wall / 3600:.2f} h, {MILLION * cpu / 3600:.2f} h of CPU")
    table = (many.table - few.table) / more
    traces = many.traces / many.runs
    print(f"disk, a run: {many.row:,.0f} B journal, {table:,.0f} B table, {traces:,.0f} B trace")
    gigabytes = [MILLION * each / 1e9 for each in (many.row, table, traces)]
    print(
        "disk, a million: {:.1f} GB journal, {:.2f} GB table, {:.1f} GB traces".format(*gigabytes)
    )
    print(f"{'process':14}{'largest':>12}{'growth a run':>16}")
    for memory in sorted(many.memory, key=lambda each: each.role):
        print(f"{memory.role:14}{memory.largest / 2**20:8.1f} MiB{memory.slope(many.runs):14.1f} B")


def main() -> None:
    """Measure a small sweep and a large one, then print."""
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--runs", type=int, default=20_000)
    options.add_argument("--trace", default="none", choices=["none", "all", "flagged"])
    options.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    asked = options.parse_args()
    adopt_orphans()
    with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as name:
        few, many = (
            sweep(Path(name), runs, asked.trace, asked.workers) for runs in (FEW, asked.runs)
        )
    show(few, many)


if __name__ == "__main__":
    main()
