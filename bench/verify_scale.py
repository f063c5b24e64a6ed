"""What verifying a store costs as it grows: time and peak memory, without traces.

Run: python -m bench.verify_scale [runs]...

Each store is a real one but for its outcomes, which all runs share: a sweep is begun, the rows of
all its runs are made up with their own ids, axis values and settings, and the sweep is resumed,
which finishes it. "files and records" is `verify_store.verify`; "run ids" resolves each run again.
Each is a process of its own; memory is its peak, imports included.

Traces take longer. Each byte of one is read, hashed (SHA-256 and CRC-32), unpacked, compared with
its layout, and hashed again if it belongs to a state. A rolling ball of a million steps, 163 MB
that hold 416 MB, takes 0.65 s of CPU, 250 MB/s of the file: 0.10 s to read, 0.13 s for the file's
hashes, 0.17 s to unpack, 0.08 s for the states' hash and 0.15 s to compare. Chunks are unpacked and
compared on all cores. A trace of 14 kB takes about 1 ms, mostly for its row and its record.
"""

import contextlib
import json
import resource
import sys
import tempfile
import time
from pathlib import Path

from bench.planning import EnoughError, grid, spent_by

from contactlab.parts import register_parts

SIZES = (10_000, 100_000)
_OTHERS = "duration: 0.1\ntrace: none\nchecks: none\n"


def main() -> None:
    """Make stores and measure each size in processes of their own, or be one of them."""
    if sys.argv[1:2] == ["--one"]:
        measure(sys.argv[2], Path(sys.argv[3]))
        return
    sizes = [int(each) for each in sys.argv[1:]] or SIZES
    print(f"{'runs':>9}  {'':17} {'wall [s]':>8} {'CPU [s]':>8} {'us a run':>8} {'peak [MB]':>9}")
    for runs in sizes:
        with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as name:
            file = Path(name) / "sweep.yaml"
            file.write_text(grid(runs) + _OTHERS, encoding="utf-8")
            make_store(file)
            for what in ("files and records", "run ids"):
                command = [sys.executable, "-m", "bench.verify_scale", "--one", what]
                wall, cpu, peak = json.loads(spent_by([*command, str(file)]).output)
                each = cpu / runs * 1e6
                print(
                    f"{runs:9,}  {what:17} {wall:8.2f} {cpu:8.2f} {each:8.0f} {peak / 1e3:9,.0f}",
                    flush=True,
                )


def make_store(file: Path) -> None:
    """Begin a sweep, make up the rows of all its runs, and finish it."""
    from pydantic_core import to_json  # noqa: PLC0415 - imports are measured

    from contactlab.run.planned_runs import RunIndex  # noqa: PLC0415
    from contactlab.run.sweep_request import read_request  # noqa: PLC0415
    from contactlab.run.sweep_runner import run_sweep  # noqa: PLC0415
    from contactlab.store.row_journal import read_lines, with_checksum  # noqa: PLC0415
    from contactlab.store.table_layout import axis_cell  # noqa: PLC0415

    store = file.with_suffix("")
    ask = read_request(file, file.stem, store, folder=file.parent, workers=0)
    with contextlib.suppress(EnoughError):
        run_sweep(ask, lambda *_: None, _enough)
    journal = store / "journal.jsonl"
    template = next(read_lines(journal))
    with journal.open("wb") as made_up:
        for run in RunIndex(ask.plan, ask.scene).iterate_runs():
            own = {"run_id": run.run_id, "index": run.index, "seed": run.seed}
            axes = {name: axis_cell(value) for name, value in run.axes.items()}
            simulated = template["steps"] * run.timestep
            cost = {"cost_cpu_per_sim_s": template["cost_cpu_s"] / simulated}
            row = template | own | axes | cost | {"settings": run.values}
            made_up.write(with_checksum(to_json(row)))
    run_sweep(ask, lambda *_: None, lambda _: None)


def _enough(_: object) -> None:
    raise EnoughError


def measure(what: str, file: Path) -> None:
    """Verify a store, and print wall and CPU time [s] and peak memory [kB] as JSON."""
    store, wall, cpu = file.with_suffix(""), time.time(), time.process_time()
    if what == "run ids":
        from contactlab.run.recomputed_runs import recomputed_problems  # noqa: PLC0415
        from contactlab.store.finished_store import Store  # noqa: PLC0415

        problems = list(recomputed_problems(Store.open_unchecked(store)))
    else:
        from contactlab.store.verify_store import find_problems  # noqa: PLC0415

        problems = find_problems(store)
    assert problems == [], problems[:3]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(json.dumps([time.time() - wall, time.process_time() - cpu, peak]))


if __name__ == "__main__":
    register_parts()
    main()
