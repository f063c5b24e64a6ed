"""What a sweep costs beside the stepping itself, and beside a straightforward harness.

Run: python -m bench.overhead [rounds]

Every figure is CPU time, user and system, of all processes: the command, the fork server and the
workers. What is compared takes turns within each round, so that the ratios of one round saw the
same machine; medians of the rounds' ratios are shown, with the least and the most.

Stepping is `mj_step(model, data, n)` of the same runs, models compiled without our sensors, the
compilation left out. Each is measured at two sizes. "With start-up" is the whole command at the
larger size; "a run more" is the difference of the two, what each further run costs. The
straightforward harness does a part of the runs, and its line through two sizes is extended.
"""

import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import mujoco
import numpy as np
from bench.plain import load, save
from bench.processes import adopt_orphans, cpu_of
from bench.runs import plain_runs
from bench.stepping import PROCESSES

from contactlab.evidence import Store

ROUNDS = 3


@dataclass(frozen=True)
class Case:
    """A sweep to measure.

    Attributes:
        name: what the table calls it.
        sweep: the sweep file's text.
        runs: how many it has, and how many the smaller size takes.
        part: the two sizes of the straightforward harness.
        targets: of the three lines of the table, in words.
    """

    name: str
    sweep: str
    runs: tuple[int, int]
    part: tuple[int, int]
    targets: tuple[str, str, str]


BALL = """\
version: 1
scene: ball_drop
axes:
  restitution: {values: [0.2, 0.6, 0.9], role: scenario}
  drop_height: {values: [0.5, 0.75, 1.0, 2.0], role: scenario}
seeds: 256
"""
STACK = """\
version: 1
scene: box_stack
axes:
  boxes: [BOXES]
seeds: SEEDS
"""
STACK_TARGETS = ("<= 1.7", "<= 1.25", ">= 8")
CASES = (
    Case("ball_drop", BALL, (3072, 768), (48, 16), ("<= 2.0", "<= 1.25", ">= 8")),
    Case(
        "box_stack, 5 boxes",
        STACK.replace("BOXES", "5").replace("SEEDS", "128"),
        (128, 32),
        (12, 4),
        STACK_TARGETS,
    ),
    Case(
        "box_stack, 10 boxes",
        STACK.replace("BOXES", "10").replace("SEEDS", "64"),
        (64, 16),
        (8, 4),
        STACK_TARGETS,
    ),
)


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


@dataclass(frozen=True)
class Round:
    """What one round took."""

    stepping: Line
    traces: Line
    none: Line
    straightforward: Line

    def ratios(self) -> tuple[tuple[float, float], ...]:
        """Return for each line of the table the ratio with start-up and the marginal one."""
        return (
            _ratio(self.traces, self.stepping),
            _ratio(self.none, self.stepping),
            _ratio(self.straightforward, self.traces),
        )


def _ratio(one: Line, other: Line) -> tuple[float, float]:
    return one.at(other.runs) / other.whole, one.each / other.each


class Bench:
    """One case in a folder of its own."""

    def __init__(self, case: Case, folder: Path) -> None:
        self._case = case
        self._folder = folder
        self._sweep = folder / "sweep.yaml"
        self._sweep.write_text(case.sweep, encoding="utf-8")
        self._runs = folder / "runs.json"
        save(plain_runs(self._sweep), self._runs)
        runs = load(self._runs)
        assert len(runs) == case.runs[0]
        for count in case.part:
            save(runs[:: len(runs) // count][:count], self._part(count))

    def round(self) -> Round:
        """Measure everything once, one after the other."""
        return Round(
            stepping=self._stepping(),
            traces=self._swept("all"),
            none=self._swept("none"),
            straightforward=self._straightforward(),
        )

    def check(self) -> None:
        """Check that the stepping ended where the sweep with traces did, bit for bit."""
        self._sweep_once("all", self._case.part[1])
        store = Store.open(self._folder / "store")
        runs = load(self._runs)
        for record in store.records():
            run = runs[record.index]
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
        return Line.through((large, sum(seconds)), (small, sum(seconds[:small])))

    def _swept(self, trace: str) -> Line:
        large, small = self._case.runs
        return Line.through(
            (large, self._sweep_once(trace, large)), (small, self._sweep_once(trace, small))
        )

    def _sweep_once(self, trace: str, runs: int) -> float:
        options = ["--set", f"trace={trace}", "--limit", str(runs), "--workers", str(PROCESSES)]
        store = self._folder / "store"
        # The store of the last one is removed here, so that no sweep pays for another's files.
        shutil.rmtree(store, ignore_errors=True)
        command = str(Path(sys.executable).with_name("contactlab"))
        return cpu_of([command, "sweep", str(self._sweep), "-o", str(store), *options])

    def _straightforward(self) -> Line:
        large, small = self._case.part
        return Line.through(
            (large, self._straightforward_once(large)), (small, self._straightforward_once(small))
        )

    def _straightforward_once(self, runs: int) -> float:
        folder = self._folder / "straightforward"
        return cpu_of(_python("bench.straightforward", self._part(runs), folder))

    def _part(self, runs: int) -> Path:
        return self._folder / f"part{runs}.json"


def _python(module: str, *arguments: object) -> list[str]:
    return [sys.executable, "-m", module, *map(str, arguments)]


LABELS = (
    "sweep / stepping, trace: all",
    "sweep / stepping, trace: none",
    "straightforward / sweep, traces",
)


def show(case: Case, rounds: list[Round]) -> None:
    """Print the table of one case."""
    large, _ = case.runs
    print(f"\n{case.name}: {large} runs, {PROCESSES} workers, {len(rounds)} rounds")
    print(f"  {'':33}{'with start-up':22}{'a run more':22}target")
    ratios = [each.ratios() for each in rounds]
    for line, (label, target) in enumerate(zip(LABELS, case.targets, strict=True)):
        whole, each = (_spread(found[line][column] for found in ratios) for column in (0, 1))
        print(f"  {label:33}{whole:22}{each:22}{target}")
    stepping = median(each.stepping.each for each in rounds)
    start = median(each.none.at(0) for each in rounds)
    print(f"  stepping takes {stepping * 1e3:.2f} ms a run, start-up {start:.2f} s of CPU in all")


def _spread(values: Iterable[float]) -> str:
    found = sorted(values)
    return f"{median(found):.2f} ({found[0]:.2f}..{found[-1]:.2f})"


def main() -> None:
    """Measure every case in every round, then print."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else ROUNDS
    adopt_orphans()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as name:
        benches: list[Bench] = []
        for number, case in enumerate(CASES):
            folder = Path(name) / str(number)
            folder.mkdir()
            benches.append(Bench(case, folder))
            benches[-1].check()
        found: list[list[Round]] = [[] for _ in CASES]
        for number in range(rounds):
            print(f"round {number + 1} of {rounds} ...", flush=True)
            for bench, each in zip(benches, found, strict=True):
                each.append(bench.round())
    for case, each in zip(CASES, found, strict=True):
        show(case, each)


if __name__ == "__main__":
    main()
