"""What the search of `tune` finds in grids that were run in full, and with how many of their runs.

Run: python -m bench.tune_search STORE ...

The stores are of tradeoff sweeps, such as `contactlab tradeoff tradeoff-ball` makes. The search
starts from the model as written, and looks up what the grid has measured; a configuration that is
not in the grid cannot be chosen. A configuration counts with all its runs, of every seed.
"""

import math
import sys
from collections.abc import Sequence
from pathlib import Path

from contactlab.pareto.analysis import analyse
from contactlab.run.planned_runs import stored_sweep_scene
from contactlab.schema.tradeoff_report import Configuration, TradeoffReport
from contactlab.store.finished_store import Store
from contactlab.studies.session import Values
from contactlab.studies.tune.knobs import integrators_of
from contactlab.studies.tune.search import Knob, Search, Space, key_of


def excess(each: Configuration, tolerances: dict[str, float]) -> float:
    """Return by what factor a configuration exceeds its limits; infinite if its runs fail."""
    sizes = [(each.worst[name], limit) for name, limit in tolerances.items()]
    worst = max(math.inf if size is None else size / limit for size, limit in sizes)
    return worst if each.feasible or worst > 1 else math.inf


def space_of(store: Store, report: TradeoffReport, written: Values) -> Space:
    """Return the knobs of a grid; those that it changes together are one."""
    blocks = [tuple(block) for block in store.manifest.sweep.resolved.get("zip", ())]
    single = set(report.knobs) - {name for block in blocks for name in block}
    blocks += [(name,) for name in sorted(single - {"timestep", "integrator"})]
    rows = [{**written, **configuration(each)} for each in report.configurations]
    options = [[{name: row[name] for name in block} for row in rows] for block in blocks]
    distinct = [tuple({str(each): each for each in every}.values()) for every in options]
    own = str(written["integrator"])
    base = stored_sweep_scene(store.manifest.sweep, store.scene_folder).base({})
    tried = {row["integrator"] for row in rows}
    return Space(
        written=written,
        timesteps=tuple(sorted({float(str(row["timestep"])) for row in rows})),
        integrators=tuple(name for name in integrators_of(base, own) if name in tried),
        knobs=tuple(map(Knob, map("+".join, blocks), distinct)),
    )


def configuration(each: Configuration) -> dict[str, object]:
    """Return what a row of a report sets; what it leaves to the model is missing."""
    return {name: value for name, value in each.configuration.items() if value is not None}


def measure(path: Path) -> None:
    """Print what the search finds in one grid."""
    store = Store.open(path)
    report = analyse(store)
    assert report.baseline is not None
    assert report.recommendation is not None
    written: Values = {"integrator": "Euler", **report.baseline.configuration}
    rows = {key_of({**written, **configuration(each)}): each for each in report.configurations}

    def judge(configurations: Sequence[Values]) -> list[float]:
        found = [rows.get(key_of(each)) for each in configurations]
        return [excess(each, report.tolerances) if each else math.inf for each in found]

    def clock(configurations: Sequence[Values]) -> list[float]:
        return [rows[key_of(each)].time or math.inf for each in configurations]

    search = Search(space_of(store, report, written), judge, clock)
    search.run()
    looked, grid = len(search.excess.keys() & rows.keys()), len(rows)
    found, best = rows[key_of(search.here)], report.recommendation
    cost = (found.time or math.inf) / best.time
    print(
        f"{path.name}: {looked} of {grid} configurations, {looked / grid:.0%} of the runs; "
        f"{'feasible' if found.feasible else 'not feasible'}, x{cost:.3f} the time of the grid's"
    )


if __name__ == "__main__":
    for name in sys.argv[1:]:
        measure(Path(name))
