"""What a sweep costs beside the stepping itself, and beside a straightforward harness.

Run: python -m bench.overhead [rounds]

Every figure is CPU time, user and system, of all processes: the command, the fork server and the
workers. What is compared takes turns within each round, so that the ratios of one round saw the
same machine; medians of the rounds' ratios are shown, with the least and the most.

Stepping is `mj_step(model, data, n)` of the same runs, models compiled without our sensors, the
compilation left out. Each is measured at two sizes. "With start-up" is the whole command at the
larger size; "a run more" is the difference of the two, what each further run costs. The
straightforward harness does a part of the runs, and its line through two sizes is extended.
Second passes are off: they simulate flagged runs again, which neither of the others does.
"""

import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from statistics import median

from bench.cases import CASES, Case
from bench.measuring import Bench, Round
from bench.processes import adopt_orphans
from bench.stepping import PROCESSES

ROUNDS = 3
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
