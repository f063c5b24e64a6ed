"""Costs of recording and of second passes: this checkout and another commit's take turns.

Run: python -m bench.in_turn CHECKOUT [--rounds 3] [--case NAME] [--no-second-pass]

CHECKOUT is the root of another checkout, such as `git worktree add` makes; it must run in this
environment. Each round of a case measures bare stepping and the sweeps by `bench.overhead` once
for each of both packages. The ratios are those of a run more. `bench.second_pass` follows.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path
from statistics import median

from bench import second_pass
from bench.cases import CASES
from bench.measuring import SWEEPS, Bench
from bench.processes import adopt_orphans

HERE = Path(__file__).parents[1]


def compare_case(bench: Bench, trees: list[Path], rounds: int) -> None:
    """Print the ratio of each kind of sweep to bare stepping: a column for each tree."""
    ratios: dict[tuple[str, Path], list[float]] = {}
    for number in range(rounds):
        for tree in trees if number % 2 == 0 else trees[::-1]:
            os.environ["PYTHONPATH"] = str(tree / "cli")
            lines = bench.round(())
            for kind in SWEEPS:
                ratio = lines[kind].each / lines["stepping"].each
                ratios.setdefault((kind, tree), []).append(ratio)
    for kind in SWEEPS:
        cells = (ratios[kind, tree] for tree in trees)
        shown = (f"{median(each):6.2f} ({min(each):.2f}..{max(each):.2f})" for each in cells)
        print(f"  {kind:10}{'  '.join(shown)}", flush=True)


def main() -> None:
    """Measure each case, then the second passes."""
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("checkout", type=Path)
    options.add_argument("--rounds", type=int, default=3)
    options.add_argument("--case", action="append", choices=[case.name for case in CASES])
    options.add_argument("--no-second-pass", action="store_true")
    request = options.parse_args()
    trees = [HERE, request.checkout.resolve()]
    adopt_orphans()
    for case in CASES:
        if case.name not in (request.case or [case.name]):
            continue
        print(f"{case.name}: sweep / bare stepping, this checkout and {request.checkout}")
        with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as folder:
            compare_case(Bench(case, Path(folder)), trees, request.rounds)
    if not request.no_second_pass:
        print("second pass in steps, this checkout, the other, and the least")
        sys.argv[1:] = [str(trees[1])]
        second_pass.main()


if __name__ == "__main__":
    main()
