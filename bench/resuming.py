"""What a long journal costs: to go on with its store, to finish it, and to sum it up.

Run: python -m bench.resuming [runs]...

The journal is made up: rows of a real sweep, each with the id and the place of another run of it,
up to some thousand places out of order. "going on" is all that the parent does until it knows that
no run is left, planning and imports included; "finishing" writes table and manifest; "summary" is
what the command then prints. Each size is a process of its own; memory is its peak until then.
"""

import contextlib
import io
import json
import re
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from bench.planning import EnoughError, grid, spent_by

from contactlab.parts import register_parts
from contactlab.store.finished_store import Store
from contactlab.store.row_journal import SEAL_SIZE, SHARED, row_extent, with_checksum

SIZES = (100_000, 1_000_000)
_OTHERS = "duration: 0.1\ntrace: none\nchecks: none\n"
# By how many places a run may finish late.
_LATE = 2000
_HEAD = re.compile(rb'^\{"run_id":"\w+","index":\d+')


def main() -> None:
    """Make stores and measure each size in a process of its own, or be that process."""
    if sys.argv[1:2] == ["--one"]:
        resume(Path(sys.argv[2]))
        return
    sizes = [int(each) for each in sys.argv[1:]] or SIZES
    print(f"{'runs':>9}  {'':10} {'wall [s]':>8} {'CPU [s]':>8} {'peak [MB]':>9}")
    for runs in sizes:
        with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as name:
            file = Path(name) / "sweep.yaml"
            file.write_text(grid(runs) + _OTHERS, encoding="utf-8")
            make_journal(file)
            spent = spent_by([sys.executable, "-m", "bench.resuming", "--one", str(file)])
        said = json.loads(spent.output)
        for what, (wall, cpu, peak) in said.items():
            print(f"{runs:9,}  {what:10} {wall:8.2f} {cpu:8.2f} {peak / 1e3:9,.0f}", flush=True)


def make_journal(file: Path) -> None:
    """Begin a sweep, and make up the rows of all its runs."""
    from contactlab.run.planned_runs import RunIndex  # noqa: PLC0415
    from contactlab.run.sweep_request import read_request  # noqa: PLC0415 - imports are measured
    from contactlab.run.sweep_runner import run_sweep  # noqa: PLC0415 - imports are measured

    ask = read_request(file, file.stem, _store_of(file), folder=file.parent, workers=0)
    with contextlib.suppress(EnoughError):
        run_sweep(ask, lambda *_: None, _enough)
    journal = _store_of(file) / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    rows = [line for line in lines if row_extent(line)[1] != SHARED]
    ids = [run.run_id for run in RunIndex(ask.plan, ask.scene).iterate_runs()]
    late = np.random.default_rng(0).uniform(0, _LATE, len(ids))
    with journal.open("wb") as made_up:
        made_up.writelines(line for line in lines if row_extent(line)[1] == SHARED)
        for place in np.argsort(np.arange(len(ids)) + late).tolist():
            head = b'{"run_id":"%b","index":%d' % (ids[place].encode(), place)
            row = rows[place % len(rows)]
            made_up.write(with_checksum(_HEAD.sub(head, row[:-SEAL_SIZE])))


def _enough(_: object) -> None:
    raise EnoughError


def _store_of(file: Path) -> Path:
    return file.with_suffix("")


def resume(file: Path) -> None:
    """Go on with a sweep of which all runs are stored, and print what it takes as JSON."""
    times = [(time.time(), 0.0, 0)]
    from contactlab.command_line.store_summary import summary_text  # noqa: PLC0415 - as above
    from contactlab.run.sweep_request import read_request  # noqa: PLC0415 - imports are measured
    from contactlab.run.sweep_runner import run_sweep  # noqa: PLC0415 - imports are measured

    def take(*_: object) -> None:
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        times.append((time.time(), time.process_time(), peak))

    ask = read_request(file, file.stem, _store_of(file), folder=file.parent, workers=0)
    run_sweep(ask, take, lambda _: None)
    take()
    with contextlib.redirect_stdout(io.StringIO()):
        summary_text(Store.open(_store_of(file)), {})
    take()
    spent = zip(("going on", "finishing", "summary"), times[:-1], times[1:], strict=True)
    print(json.dumps({name: (b[0] - a[0], b[1] - a[1], b[2]) for name, a, b in spent}))


if __name__ == "__main__":
    register_parts()
    main()
