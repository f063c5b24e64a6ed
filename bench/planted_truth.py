"""How often the intervals of a fit have the settings that recordings were made with.

Run: python -m bench.planted_truth [FIRST CASES]

Half of the cases slide a puck, which tells friction only; the others toss it, which tells a little
of the time constant too. Settings are drawn by the number of the case.
"""

import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np
from tests.planted_recordings import plant

from contactlab.studies.fit import FitRequest, run
from contactlab.studies.session import Session

FREE = ("friction.slide", "solref.timeconst=0.005:0.06")


def fitted(case: int, folder: Path) -> dict[str, tuple[bool, float, bool]]:
    """Return of each setting whether its interval has the truth, its ratio, and if identified."""
    rng = np.random.default_rng([case, 1])
    truth = [float(np.exp(rng.uniform(*np.log(each)))) for each in ((0.1, 0.6), (0.008, 0.03))]
    friction, timeconst = truth
    tossed = case % 2 == 1
    scene = plant(folder / "puck", friction, case, timeconst=timeconst, tossed=tossed, trials=12)
    report = run(FitRequest(scene, FREE, fitted=8), Session(folder / "fit"))
    found = dict[str, tuple[bool, float, bool]]()
    for true, each in zip(truth, report.settings, strict=True):
        assert each.interval is not None
        low, high = each.interval
        found[each.name] = low <= true <= high, high / low, each.identified
        print(case, each.name, f"{true:.4g} {each.value:.4g} {low:.4g} {high:.4g}", flush=True)
    return found


def main(first: int = 0, cases: int = 100) -> None:
    """Print how often each setting was within its interval."""
    kept = defaultdict[str, list[tuple[bool, float, bool]]](list)
    for case in range(first, first + cases):
        with tempfile.TemporaryDirectory() as folder:
            for name, each in fitted(case, Path(folder)).items():
                kept[f"{('slid', 'tossed')[case % 2]} {name}"].append(each)
    for name, every in kept.items():
        within, ratios, known = map(np.array, zip(*every, strict=True))
        print(
            f"{name}: {within.sum()} of {len(every)} within, highest over lowest "
            f"{np.median(ratios):.3f}, identified in {known.sum()}"
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
