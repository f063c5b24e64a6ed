"""CPU time of whole commands, interleaved with another checkout's.

Run: python -m bench.commands [--rounds 9] [--tree CHECKOUT] [MODEL]

`lint` reads MODEL, or a shipped scene. CHECKOUT is the root of another commit. Its package must run
with the libraries that are installed here. Each line has the median CPU time of a command and of
all processes that it starts, user and system, with the least and the most. The ratio is the median
over rounds, to the other checkout.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median

from bench.processes import adopt_orphans, cpu_of

HERE = Path(__file__).parents[1]


def command_seconds(tree: Path, words: list[str]) -> float:
    """Return the CPU time of a command of a checkout [s]."""
    os.environ["PYTHONPATH"] = str(tree / "cli")
    # A model with mistakes, or a sweep that misses its expectations, ends with 1.
    return cpu_of([sys.executable, "-m", "contactlab", *words], expected=(0, 1))


def measure_rounds(
    trees: Sequence[Path], words: list[str], rounds: int, folder: Path
) -> list[list[float]]:
    """Return the CPU times of a command by round, in each of the checkouts [s].

    Words that end with `-o` get a new folder each time.
    """
    times = list[list[float]]()
    for number in range(rounds):
        outputs = [folder / f"{number}-{place}" for place in range(len(trees))]
        lines = [[*words, *([str(output)] if words[-1] == "-o" else [])] for output in outputs]
        times.append([command_seconds(*each) for each in zip(trees, lines, strict=True)])
    return times


def main() -> None:
    """Print a line for each command."""
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--rounds", type=int, default=9)
    options.add_argument("--tree", type=Path)
    options.add_argument("model", nargs="?", default="grasp_mug")
    arguments = options.parse_args()
    trees = [HERE, *([arguments.tree] if arguments.tree else [])]
    adopt_orphans()
    with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as name:
        store = str(Path(name) / "shown")
        command_seconds(HERE, ["sweep", "bounce", "-o", store])
        commands = {
            "--help": ["--help"],
            "lint": ["lint", arguments.model],
            "show": ["show", store],
            "sweep bounce": ["sweep", "bounce", "-o"],
        }
        for label, words in commands.items():
            times = measure_rounds(trees, words, arguments.rounds, Path(name))
            own = sorted(seconds[0] for seconds in times)
            line = f"{label:14}{median(own):7.3f} s ({own[0]:.3f}..{own[-1]:.3f})"
            if arguments.tree:
                ratios = sorted(seconds[0] / seconds[1] for seconds in times)
                line += f"  ratio {median(ratios):.2f} ({ratios[0]:.2f}..{ratios[-1]:.2f})"
            print(line, flush=True)


if __name__ == "__main__":
    main()
