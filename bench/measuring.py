"""One case: its sweep, its runs without contactlab, and what each way of running them takes."""

import json
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from bench.cases import Case
from bench.plain import load, save
from bench.processes import cpu_of
from bench.reading_contacts import write_columns
from bench.runs import plain_runs
from bench.stepping import PROCESSES

from contactlab.store.finished_store import Store


@dataclass(frozen=True)
class Line:
    """CPU time over runs, from two sizes.

    Attributes:
        whole: of the larger size [s].
        each: of one run more [s].
        runs: the larger size.
    """

    whole: float
    each: float
    runs: int

    @classmethod
    def through(cls, large: tuple[int, float], small: tuple[int, float]) -> "Line":
        """Return the line through two measured sizes (runs, seconds)."""
        slope = (large[1] - small[1]) / (large[0] - small[0])
        return cls(large[1], slope, large[0])

    def at(self, runs: int) -> float:
        """Return the time of another number of runs [s]."""
        return self.whole + (runs - self.runs) * self.each


HARNESSES = ("sixty_lines", "naive_loop", "straightforward")
"""Modules of what one would write instead."""
SWEEPS = {
    "none": ("trace=none",),
    "messages": ("trace=all",),
    "compact": ("trace=all", "trace_format=compact"),
}
"""What is set in sweeps, by the traces that they write."""
Round = dict[str, Line]
"""What each way took in a round: `stepping`, the sweeps, the harnesses."""


class Bench:
    """One case in a folder of its own."""

    def __init__(self, case: Case, folder: Path) -> None:
        large, small = case.seeds
        self._case = case
        self._folder = folder
        write_columns(folder / "columns")
        self._sweep = folder / "sweep.yaml"
        self._sweep.write_text(f"{case.sweep}seeds: {large}\n", encoding="utf-8")
        self._runs = folder / "runs.json"
        runs = plain_runs(self._sweep)
        save(runs, self._runs)
        # Seeds advance fastest, so the smaller size is the start of each row.
        self._small = [place for place in range(len(runs)) if place % large < small]
        assert (len(runs), len(self._small)) == case.runs
        for count in (*case.part, *case.runs):
            save(runs[:: len(runs) // count][:count], self._part(count))

    def round(self, harnesses: Sequence[str] = HARNESSES) -> Round:
        """Measure everything once, or of the harnesses these, one after the other."""
        found = {"stepping": self._stepping()} | {name: self._swept(name) for name in SWEEPS}
        return found | {name: self._harness(name) for name in harnesses}

    def check(self) -> None:
        """Check that the stepping ended where the sweep with traces did, bit for bit."""
        self._sweep_once("messages", self._case.seeds[1])
        store = Store.open(self._folder / "store")
        runs = load(self._runs)
        for record in store.records():
            run = runs[self._small[record.index]]
            model, data = run.start()
            mujoco.mj_step(model, data, run.steps)
            stored = store.trace(record)
            assert np.array_equal(stored.qpos[-1], data.qpos), f"run {record.index} differs"
            assert np.array_equal(stored.qvel[-1], data.qvel), f"run {record.index} differs"

    def _stepping(self) -> Line:
        result = self._folder / "stepping.json"
        cpu_of(_python("bench.stepping", self._runs, result))
        seconds = [float(each[0]) for each in json.loads(result.read_text(encoding="utf-8"))]
        large, small = self._case.runs
        of_small = sum(seconds[place] for place in self._small)
        return Line.through((large, sum(seconds)), (small, of_small))

    def _swept(self, traces: str) -> Line:
        large, small = (self._sweep_once(traces, seeds) for seeds in self._case.seeds)
        return Line.through((self._case.runs[0], large), (self._case.runs[1], small))

    def _sweep_once(self, traces: str, seeds: int) -> float:
        changes = (*SWEEPS[traces], f"seeds={seeds}")
        options = [part for each in changes for part in ("--set", each)]
        options += ["--workers", str(PROCESSES)]
        store = self._folder / "store"
        # The store of the last one is removed here, so that no sweep pays for another's files.
        shutil.rmtree(store, ignore_errors=True)
        command = str(Path(sys.executable).with_name("contactlab"))
        return cpu_of([command, "sweep", str(self._sweep), "-o", str(store), *options])

    def _harness(self, name: str) -> Line:
        # Native rollouts are as fast as sweeps: they get as many runs.
        sizes = self._case.runs if name == "sixty_lines" else self._case.part
        large, small = (self._harness_once(name, runs) for runs in sizes)
        return Line.through((sizes[0], large), (sizes[1], small))

    def _harness_once(self, name: str, runs: int) -> float:
        return cpu_of(_python(f"bench.{name}", self._part(runs), self._folder / f"{name}.out"))

    def _part(self, runs: int) -> Path:
        return self._folder / f"part{runs}.json"


def _python(module: str, *arguments: object) -> list[str]:
    return [sys.executable, "-m", module, *map(str, arguments)]
