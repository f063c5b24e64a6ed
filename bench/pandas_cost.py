"""What it costs a sweep that pandas is installed, which contactlab has no use for.

Run in an environment with pandas: python -m bench.pandas_cost [rounds]

`contactlab sweep bounce` takes turns with itself where pandas cannot be imported. Figures are CPU
times, user and system, of all processes; the ratio is the median of the rounds'.
"""

import importlib.util
import os
import shutil
import sys
import tempfile
from pathlib import Path
from statistics import median

from bench.processes import adopt_orphans, cpu_of

_WITHOUT = 'raise ImportError("hidden, to measure what it costs")\n'


def main() -> None:
    """Print what the sweep takes with pandas, and without."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 7
    if importlib.util.find_spec("pandas") is None:
        raise SystemExit("there is no pandas here: pip install pandas")
    adopt_orphans()
    found = list[tuple[float, float]]()
    with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as name:
        folder = Path(name)
        (folder / "pandas.py").write_text(_WITHOUT, encoding="utf-8")
        for _ in range(rounds):
            found.append((_sweep(folder), _sweep(folder, hidden=True)))
            print("with pandas {:.2f} s, without {:.2f} s".format(*found[-1]), flush=True)
    ratio = median(there / hidden for there, hidden in found)
    print(f"with pandas it takes {ratio:.3f} times the CPU time")


def _sweep(folder: Path, *, hidden: bool = False) -> float:
    """Return the CPU time of a sweep [s]."""
    shutil.rmtree(folder / "store", ignore_errors=True)
    command = [sys.executable, "-m", "contactlab", "sweep", "bounce", "-o", str(folder / "store")]
    before = os.environ.get("PYTHONPATH")
    path = [str(folder)] if hidden else []
    os.environ["PYTHONPATH"] = os.pathsep.join([*path, *filter(None, [before])])
    try:
        return cpu_of([*command, "--workers", "1"])
    finally:
        os.environ["PYTHONPATH"] = before or ""


if __name__ == "__main__":
    main()
