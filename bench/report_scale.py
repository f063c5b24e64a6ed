"""What a report costs: made-up stores of 10,000 to 10,000,000 runs.

Run: python -m bench.report_scale [runs]...

The stores have every column of a real one: seven axes, labels, and the metrics of a small real
sweep, each times a random number of its own, so that what is null or zero there is so here, and
nothing else repeats. Each report is written by a process of its own;
memory is the process's peak. Where Chromium and Playwright are found, the page is opened from its
file: the time to first paint is the browser's own, and the time until it answers ends when the
script has drawn its maps.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pyarrow as pa
from bench.made_up import Rows, ids_of, parts_of, real_store, tables, write_store

from contactlab.contact.trace_arrays import Floats
from contactlab.measure import METRICS
from contactlab.page.report_files import write_page
from contactlab.parts import register_parts
from contactlab.schema.setting_values import as_number
from contactlab.store.finished_store import Store

# Values of timestep, integrator, cone, solref, friction.slide, direction and seed.
GRIDS = {
    10_000: (10, 2, 2, 5, 5, 5, 2),
    100_000: (10, 2, 2, 5, 10, 5, 10),
    1_000_000: (20, 2, 2, 10, 10, 5, 25),
    10_000_000: (20, 2, 2, 10, 10, 5, 250),
}
LABELS = ("tunneling", "chatter", "oracle_miss", "stable")
_WORST = LABELS[:-1]
_LABELLED: dict[str, pa.Array] = {  # each label's own columns, in the order of LABELS
    "label": pa.array(LABELS),
    "labels": pa.array([*([label] for label in _WORST), []], pa.list_(pa.string())),
    "label_reason": pa.array([*("why" for _ in _WORST), None]),
    "label_reasons": pa.array([*(["why"] for _ in _WORST), []], pa.list_(pa.string())),
    "label_step": pa.array([*(1 for _ in _WORST), None], pa.int64()),
    "label_steps": pa.array([*([1] for _ in _WORST), []], pa.list_(pa.int64())),
    "label_bodies": pa.array([*([[]] for _ in _WORST), []], pa.list_(pa.list_(pa.string()))),
}
CHROMIUM = Path("/usr/bin/chromium")
SWEEP = """
version: 1
scene: box_slide
axes:
  timestep: [1.0e-3, 2.0e-3]
  integrator: [Euler, RK4]
  cone: [pyramidal, elliptic]
  solref: ["0.02 1", "0.01 1"]
  friction.slide: [0.3, 0.5]
  direction: {values: [0, 45], role: scenario}
tolerances: {oracle_error: 100.0, penetration_max: 1.0}
duration: 0.01
trace: none
checks: none
"""


def main() -> None:
    """Make stores and measure each size in a process of its own, or be that process."""
    if sys.argv[1:2] == ["--one"]:
        measure(Path(sys.argv[2]), Path(sys.argv[3]))
        return
    sizes = [int(each) for each in sys.argv[1:]] or list(GRIDS)
    head = ("runs", "page [MB]", "build [s]", "peak [MB]", "paint [s]", "ready [s]")
    print("  ".join(f"{name:>10}" for name in head))
    for runs in sizes:
        with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as name:
            store = make_store(
                Path(name) / "store", GRIDS[runs], real_store(Path(name) / "real", SWEEP)
            )
            page = Path(name) / "page.html"
            command = [sys.executable, "-m", "bench.report_scale", "--one", str(store), str(page)]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            wall, peak = json.loads(done.stdout)
            told = (page.stat().st_size / 1e6, wall, peak / 1e6, *opened(page))
            print("  ".join([f"{runs:>10,}", *(f"{value:10.2f}" for value in told)]))


def measure(store: Path, page: Path) -> None:
    """Write a page and print wall time [s] and peak memory [B]."""
    start = time.perf_counter()
    write_page(Store.open(store), page)
    spent = time.perf_counter() - start
    print(json.dumps([spent, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024]))


def opened(page: Path) -> tuple[float, float]:
    """Return when a browser has painted a page, and when the page answers [s]; the best of three.

    NaN without a browser.
    """
    if not CHROMIUM.exists() or find_spec("playwright") is None:
        return np.nan, np.nan
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - only where it is

    times: list[tuple[float, float]] = []
    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=str(CHROMIUM), args=["--no-sandbox", "--disable-gpu"]
        )
        for _ in range(3):
            tab = browser.new_page()
            tab.goto(page.as_uri())
            tab.wait_for_selector("body[data-ready]", timeout=120_000)
            paint = tab.evaluate(
                "performance.getEntriesByName('first-contentful-paint')[0].startTime"
            )
            times.append((paint / 1e3, tab.evaluate("performance.now()") / 1e3))
            tab.close()
        browser.close()
    return min(paint for paint, _ in times), min(ready for _, ready in times)


def make_store(path: Path, grid: Sequence[int], template: Store) -> Path:
    """Write a store of made-up runs over a grid."""
    runs = int(np.prod(grid))
    known = {name: template.columns.numbers(name).values for name in METRICS}
    first = next(template.records())
    simulated = first.steps * as_number(first.settings["timestep"])
    made = partial(made_up, grid=grid, known=known, simulated=simulated)
    return write_store(path, runs, template, tables(parts_of(runs), template, made))


def made_up(
    index: Rows, grid: Sequence[int], known: Mapping[str, Floats], simulated: float
) -> dict[str, pa.Array]:
    """Return the columns of runs (n,) that differ from run to run.

    Args:
        index: places in the grid.
        grid: its sizes.
        known: metric to its values in a real sweep.
        simulated: how long each run is [s].
    """
    rng = np.random.default_rng(index[0])
    step, integrator, cone, solref, friction, direction, seed = np.unravel_index(index, grid)
    # Long steps fail, and stiff contacts fail first.
    worse = rng.random(len(index)) < 0.7 * (step / grid[0]) * (0.5 + solref / grid[3])
    codes = np.where(worse, rng.integers(len(LABELS) - 1, size=len(index)), len(LABELS) - 1)
    cpu = np.exp(rng.normal(size=len(index)) * 0.1) / (1 + step)
    made: dict[str, pa.Array] = {
        "run_id": ids_of(index),
        "index": pa.array(index),
        "seed": pa.array(seed),
        "timestep": pa.array(1e-4 * 1.3**step),
        "integrator": pa.array(["Euler", "RK4"]).take(pa.array(integrator)),
        "cone": pa.array(["pyramidal", "elliptic"]).take(pa.array(cone)),
        "solref": pa.array([f"{0.02 / (1 + code):.4g} 1" for code in range(grid[3])]).take(
            pa.array(solref)
        ),
        "friction.slide": pa.array(0.1 * (1 + friction)),
        "direction": pa.array(9.0 * direction),
        "cost_cpu_s": pa.array(cpu),
        "cost_cpu_per_sim_s": pa.array(cpu / simulated),
    }
    made |= {name: of_label.take(pa.array(codes)) for name, of_label in _LABELLED.items()}
    for name, values in known.items():
        noisy = values[index % len(values)] * np.exp(0.5 * rng.normal(size=len(index)))
        made[name] = pa.array(noisy, mask=np.isnan(noisy))
    return made


if __name__ == "__main__":
    register_parts()
    main()
