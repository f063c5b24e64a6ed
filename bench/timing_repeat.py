"""Whether times can be trusted: two timing passes of one build, back to back.

Run: python -m bench.timing_repeat [SWEEP ...] [-- OPTION ...]

Each sweep, by default every shipped one for trade-offs, is run twice with a timing pass. What is
shown of two passes: how far the ratios between configurations differ, where a configuration is
one setting of all axes but seeds and scenarios, its time the mean over these; and whether
`contactlab tradeoff` recommends the same. Options are handed to `contactlab sweep`.
"""

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

from contactlab import resources
from contactlab.pareto.analysis import analyze_tradeoff
from contactlab.schema.tradeoff_report import TradeoffReport
from contactlab.store.finished_store import Store

TARGET = 0.05
_COMMAND = str(Path(sys.executable).with_name("contactlab"))


@dataclass(frozen=True)
class Passes:
    """Two timing passes of one sweep.

    Attributes:
        name: the sweep.
        ratios: (C,) second over first time of each configuration.
        first: what the first pass recommends, as JSON; null for nothing.
        second: the same of the second.
    """

    name: str
    ratios: np.ndarray
    first: str
    second: str

    @property
    def differences(self) -> np.ndarray:
        """(C,) how far each configuration's share of the whole differs between the passes."""
        return np.abs(self.ratios / median(self.ratios) - 1)


def run_twice(sweep: str, options: list[str], folder: Path) -> Passes:
    """Run a sweep twice and compare its times."""
    reports = [_run(sweep, options, folder / str(number)) for number in range(2)]
    first, second = (_times(report) for report in reports)
    ratios = np.array([second[name] / first[name] for name in first if name in second])
    recommended = [
        json.dumps(report.recommendation and report.recommendation.configuration)
        for report in reports
    ]
    return Passes(sweep, ratios, recommended[0], recommended[1])


def show(passes: Passes) -> None:
    """Print what came of a sweep."""
    found = passes.differences
    same = passes.first == passes.second
    print(
        f"{Path(passes.name).stem:20} {len(found):4} configurations  "
        f"median {np.median(found):6.2%}  90 % {np.quantile(found, 0.9):6.2%}  "
        f"most {found.max():6.2%}  all {median(passes.ratios) - 1:+.2%}  "
        f"recommendation {'the same' if same else 'DIFFERS'}"
    )
    for each in dict.fromkeys((passes.first, passes.second)):
        print(f"{'':20} {each}")


def main() -> None:
    """Run every sweep twice; fail if ratios differ by more than the target."""
    names, options = _arguments(sys.argv[1:])
    missed: list[str] = []
    for name in names:
        with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as folder:
            passes = run_twice(name, options, Path(folder))
        show(passes)
        if np.median(passes.differences) > TARGET:
            missed.append(name)
    if missed:
        raise SystemExit(f"ratios differ by more than {TARGET:.0%}: {', '.join(missed)}")


def _arguments(given: list[str]) -> tuple[list[str], list[str]]:
    names, options = given, list[str]()
    if "--" in given:
        place = given.index("--")
        names, options = given[:place], given[place + 1 :]
    every = sorted(path.stem for path in resources.SWEEPS.glob("tradeoff-*.yaml"))
    return names or every, options


def _run(sweep: str, options: list[str], store: Path) -> TradeoffReport:
    """Run a sweep into a store and weigh it; what it expects is of no matter here."""
    timed = [] if any(each.startswith("timing") for each in options) else ["timing.rounds=3"]
    assigned = [part for each in [*timed, "trace=none"] for part in ("--set", each)]
    command = [_COMMAND, "sweep", sweep, "-o", str(store), *assigned, *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if not (store / "manifest.json").is_file():
        raise RuntimeError(f"{' '.join(command)} failed:\n{done.stdout}{done.stderr}")
    return analyze_tradeoff(Store.open(store))


def _times(report: TradeoffReport) -> dict[str, float]:
    return {
        json.dumps(each.configuration): each.time
        for each in report.configurations
        if each.time is not None
    }


if __name__ == "__main__":
    main()
