"""What a sweep costs beside the stepping itself, and beside what one would write instead.

Run: python -m bench.overhead [--rounds 3] [--minutes 3] [--quick] [--native] [--case NAME]

The rounds are not those of `contactlab.timing`: its clock is the CPU time of a thread, and a turn
here is a command with its workers, at two sizes.

Every figure is CPU time, user and system, of all processes: the command, the fork server and the
workers. What is compared takes turns within each round, so that the ratios of one round saw the
same machine; a round is printed as it ends, then the medians of the rounds' ratios, with the least
and the most.

Stepping is `mj_step(model, data, n)` of the same runs, models compiled without our sensors, the
compilation left out. Each is measured at two sizes. "With start-up" is the whole command at the
larger size, "500 runs" what the line through both makes of so many; "a run more" is the difference
of the two, what each further run costs. Second passes
are off: they simulate flagged runs again, which none of the others does.

The others are sixty lines with native rollouts and a table (`bench.sixty_lines`), a naive loop in
Python that keeps every contact, with a table (`bench.naive_loop`), and the straightforward harness,
which writes MCAP files of JSON (`bench.straightforward`). The loops in Python do a part of the
runs, and their line through two sizes is extended; `--native` leaves them out. Of a short
measurement (`--quick`: a quarter of the runs) the ratios of a run more are rough.

On a busy machine there are fewer rounds: none of a case begins that would take longer than is left
of the minutes, judged by the longest so far.
"""

import argparse
import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from statistics import median

from bench.cases import CASES, Case
from bench.measuring import HARNESSES, Bench, Round
from bench.processes import adopt_orphans
from bench.stepping import PROCESSES

RATIOS = {
    "sweep without traces / stepping": ("none", "stepping"),
    "sweep with traces / stepping": ("messages", "stepping"),
    "sweep with compact traces / stepping": ("compact", "stepping"),
    **{f"{name.replace('_', ' ')} / sweep without traces": (name, "none") for name in HARNESSES},
    "straightforward / sweep with traces": ("straightforward", "messages"),
}


RUNS = 500


def ratios(found: Round) -> dict[str, tuple[float, float, float]]:
    """Return each ratio of a round: with start-up, of `RUNS`, and of a run more."""
    pairs = {
        label: (found[one], found[other])
        for label, (one, other) in RATIOS.items()
        if {one, other} <= found.keys()
    }
    return {
        label: (
            one.at(other.runs) / other.whole,
            one.at(RUNS) / other.at(RUNS),
            one.each / other.each,
        )
        for label, (one, other) in pairs.items()
    }


def show(case: Case, rounds: list[Round]) -> None:
    """Print the table of one case."""
    large, _ = case.runs
    print(f"\n{case.name}: {large} runs, {PROCESSES} workers, {len(rounds)} rounds")
    print(f"  {'':42}{'with start-up':22}{f'{RUNS} runs':22}{'a run more'}")
    found = [ratios(each) for each in rounds]
    for label in found[0]:
        whole, many, each = (_spread(one[label][column] for one in found) for column in range(3))
        print(f"  {label:42}{whole:22}{many:22}{each}")
    stepping = median(each["stepping"].each for each in rounds)
    start = median(each["none"].at(0) for each in rounds)
    beside = median(each["none"].each - each["stepping"].each for each in rounds)
    print(
        f"  a run more: stepping {stepping * 1e3:.2f} ms, the sweep {beside * 1e3:.2f} ms beside "
        f"it; start-up {start:.2f} s of CPU in all"
    )


def _spread(values: Iterable[float]) -> str:
    found = sorted(values)
    return f"{median(found):.2f} ({found[0]:.2f}..{found[-1]:.2f})"


def _quick(case: Case) -> Case:
    (large, small), (most, least) = case.seeds, case.part
    return replace(case, seeds=(large // 4, small // 4), part=(most // 2, least // 2))


def main() -> None:
    """Measure cases in turn, round by round, while there is time; then print medians."""
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--rounds", type=int, default=3)
    options.add_argument("--minutes", type=float, default=3, help="at most")
    options.add_argument("--quick", action="store_true", help="a quarter of the runs")
    options.add_argument("--native", action="store_true", help="without the loops in Python")
    options.add_argument("--case", action="append", choices=[case.name for case in CASES])
    asked = options.parse_args()
    cases = [case for case in CASES if case.name in (asked.case or [case.name])]
    cases = [_quick(case) for case in cases] if asked.quick else cases
    harnesses = HARNESSES[:1] if asked.native else HARNESSES
    adopt_orphans()
    found = measured(cases, harnesses, asked.rounds, 60 * asked.minutes)
    for case, each in zip(cases, found, strict=True):
        if each:
            show(case, each)
        else:
            print(f"\n{case.name}: not measured in {asked.minutes:g} minutes; --minutes gives more")


def measured(
    cases: Sequence[Case], harnesses: Sequence[str], rounds: int, most: float
) -> list[list[Round]]:
    """Return the rounds of each case, at most so many, and as many as end within a time [s]."""
    found: list[list[Round]] = [[] for _ in cases]
    with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as name:
        benches: dict[int, Bench] = {}
        start, longest = time.monotonic(), 0.0
        for number, place in product(range(rounds), range(len(cases))):
            begin = time.monotonic()
            if begin - start + longest > most:
                break
            if place not in benches:
                folder = Path(name) / str(place)
                folder.mkdir()
                benches[place] = Bench(cases[place], folder)
                benches[place].check()
            found[place].append(benches[place].round(harnesses))
            shown = ", ".join(f"{more:.2f}" for *_, more in ratios(found[place][-1]).values())
            print(f"round {number + 1}, {cases[place].name}, a run more: {shown}", flush=True)
            longest = max(longest, time.monotonic() - begin)
    return found


if __name__ == "__main__":
    main()
