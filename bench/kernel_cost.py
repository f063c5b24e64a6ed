"""What the kernel in C saves of whole sweeps.

Run: python -m bench.kernel_cost [rounds] [sweep ...]

Each sweep takes turns with itself without the kernel, in one process. Figures are CPU times, user
and system, of the whole command; ratios are medians of the rounds'. What stays in C has to save a
tenth of some shipped sweep.
"""

import os
import sys
import tempfile
from pathlib import Path
from statistics import median

from bench.processes import cpu_of

SWEEPS = ("bounce", "stack", "slide", "impact", "grasp")


def main() -> None:
    """Print what each sweep takes with the kernel, and how many times that without."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 7
    for name in sys.argv[2:] or SWEEPS:
        _sweep(name, kernel=True)  # compiles it
        found = [(_sweep(name, kernel=True), _sweep(name, kernel=False)) for _ in range(rounds)]
        taken = median(there for there, _ in found)
        ratio = median(without / there for there, without in found)
        print(f"{name:10} {taken:6.2f} s, without the kernel {ratio:.2f} times that", flush=True)


def _sweep(name: str, *, kernel: bool) -> float:
    """Return the CPU time of a sweep [s]."""
    os.environ["CONTACTLAB_KERNEL"] = "on" if kernel else "off"
    with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as folder:
        store = str(Path(folder) / "store")
        sweep = [sys.executable, "-m", "contactlab", "sweep", name, "-o", store]
        return cpu_of([*sweep, "--workers", "0"])


if __name__ == "__main__":
    main()
