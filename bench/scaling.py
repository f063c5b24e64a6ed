"""What more workers gain: sweeps with full traces on 1, 2, ... workers, beside bare stepping.

Run: python -m bench.scaling [rounds [part]]

With a part of 4, sweeps have a quarter of their runs; short ones end with idle workers.

The yardstick is the machine itself: the same runs stepped by as many processes that share nothing,
which already started. Processors that are shared, hot or short of memory bandwidth give less than
one process each. What is compared takes turns within each round; medians of the rounds' ratios are
shown, with the least and the most.

Speed-ups are of wall time, so they need a quiet machine. "Run more" is the difference of two sizes
of a sweep, without what happens once; "whole" is the command at the larger size, start-up
included. "CPU" is the CPU time of the whole command with so many workers over that with one.
"""

import multiprocessing
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

from bench.cases import CASES, Case
from bench.plain import PlainRun
from bench.processes import adopt_orphans, cpu_of
from bench.runs import plain_runs
from bench.stepping import step

ROUNDS = 3
NAMES = ("ball_drop", "box_stack, 5 boxes")


@dataclass(frozen=True)
class Taken:
    """What the sweep and the bare stepping took on so many workers.

    Attributes:
        whole: wall time of the larger sweep [s].
        each: wall time of one run more [s].
        cpu: CPU time of the larger sweep [s].
        bare: wall time of stepping the larger sweep's runs [s].
    """

    whole: float
    each: float
    cpu: float
    bare: float


class Scaling:
    """One case in a folder of its own."""

    def __init__(self, case: Case, folder: Path) -> None:
        self.case = case
        self._folder = folder
        self._sweep = folder / "sweep.yaml"
        self._sweep.write_text(f"{case.sweep}seeds: {case.seeds[0]}\n", encoding="utf-8")
        self._runs = plain_runs(self._sweep)

    def take(self, workers: int) -> Taken:
        """Measure everything once on so many workers."""
        (large, cpu), (small, _) = (self._swept(workers, seeds) for seeds in self.case.seeds)
        more = self.case.runs[0] - self.case.runs[1]
        return Taken(large, (large - small) / more, cpu, _stepped(workers, self._runs))

    def _swept(self, workers: int, seeds: int) -> tuple[float, float]:
        store = self._folder / "store"
        shutil.rmtree(store, ignore_errors=True)
        command = str(Path(sys.executable).with_name("contactlab"))
        changes = ["--set", "trace=all", "--set", f"seeds={seeds}", "--workers", str(workers)]
        start = time.perf_counter()
        cpu = cpu_of([command, "sweep", str(self._sweep), "-o", str(store), *changes])
        return time.perf_counter() - start, cpu


def _stepped(processes: int, runs: list[PlainRun]) -> float:
    """Return the wall time of stepping runs on processes that are ready [s]."""
    with multiprocessing.get_context("fork").Pool(processes) as pool:
        pool.map(step, runs[: 4 * processes], chunksize=1)
        start = time.perf_counter()
        pool.map(step, runs, chunksize=4)
        return time.perf_counter() - start


def show(case: Case, rounds: list[dict[int, Taken]]) -> None:
    """Print the table of one case."""
    print(f"\n{case.name}: {case.runs[0]} runs with traces, {len(rounds)} rounds")
    print(f"  {'workers':9}{'run more':24}{'whole':24}{'bare stepping':24}{'CPU':24}")
    for workers in list(rounds[0])[1:]:
        pairs = [(taken[1], taken[workers]) for taken in rounds]
        columns = (
            [one.each / many.each for one, many in pairs],
            [one.whole / many.whole for one, many in pairs],
            [one.bare / many.bare for one, many in pairs],
            [many.cpu / one.cpu for one, many in pairs],
        )
        print(f"  {workers:<9}" + "".join(f"{_spread(column):24}" for column in columns))


def _spread(values: Iterable[float]) -> str:
    found = sorted(values)
    return f"{median(found):.2f} ({found[0]:.2f}..{found[-1]:.2f})"


def _workers() -> list[int]:
    """Return 1, 2, 4, ... and all processors that this process may use."""
    most = len(os.sched_getaffinity(0))
    return sorted(
        {1, most, *(2**power for power in range(1, most.bit_length()) if 2**power < most)}
    )


def main() -> None:
    """Measure every case in every round, then print."""
    rounds, part = map(int, (*sys.argv[1:], *(str(ROUNDS), "1")[len(sys.argv) - 1 :]))
    adopt_orphans()
    with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as name:
        scalings: list[Scaling] = []
        for case in (each for each in CASES if each.name in NAMES):
            folder = Path(name) / str(len(scalings))
            folder.mkdir()
            large, small = case.seeds
            smaller = replace(case, seeds=(large // part, small // part))
            scalings.append(Scaling(smaller, folder))
        found: list[list[dict[int, Taken]]] = [[] for _ in scalings]
        for number in range(rounds):
            print(f"round {number + 1} of {rounds} ...", flush=True)
            for scaling, each in zip(scalings, found, strict=True):
                each.append({workers: scaling.take(workers) for workers in _workers()})
    for scaling, each in zip(scalings, found, strict=True):
        show(scaling.case, each)


if __name__ == "__main__":
    main()
