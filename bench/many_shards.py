"""Sixty-four shards, five of them killed and run again, against the store of one machine.

Run: python -m bench.many_shards WAY FOLDER [SHARDS], where WAY is `here`, `slurm` or `ray`

Shards run in random order, each in a process group of its own, through the workers of this machine,
through submitit's local executor, or on the Ray cluster that RAY_ADDRESS names. A doomed shard is
killed with all that it started, soon after its first rows are in its journal. What no clock decides
is compared: the digest of the physics, the table without costs and times, the bytes of
traces. A call that was interrupted goes on where it was.
"""

import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

import contactlab
from contactlab.store.finished_store import Store
from contactlab.store.store_files import MANIFEST, TABLE
from contactlab.store.table_layout import COLUMNS_OF_MACHINE
from contactlab.store.verify_store import verify

SHARDS, EVERY = 64, 13
"""Shards, and of how many one is killed."""
SWEEP: dict[str, Any] = {
    "version": 1,
    "scene": "ball_drop",
    "duration": 0.5,
    "seeds": SHARDS,
    "axes": {"timestep": [1e-3, 2e-3], "drop_height": [0.1, 0.2]},
}
WAYS: dict[str, dict[str, Any]] = {
    "here": {"workers": 1},
    "slurm": {"executor": "slurm", "address": "cluster=local,timeout_min=5", "workers": 1},
    "ray": {"executor": "ray", "address": os.environ.get("RAY_ADDRESS"), "workers": 1},
}
_LATEST = 0.5  # how long a doomed shard lives after its first rows at most [s]


def main() -> None:
    """Run the shards, merge them, and print how many columns and traces equal one machine's."""
    way, folder, shards = sys.argv[1], Path(sys.argv[2]), int([*sys.argv, SHARDS][3])
    one, merged = folder / "one", folder / "merged"
    contactlab.sweep(SWEEP, output=one, workers=0)
    rng = np.random.default_rng(shards)
    order = (1 + rng.permutation(shards)).tolist()
    doomed, killed = {*order[::EVERY]}, 0
    for number in order:
        place = folder / f"shard-{number}"
        if number in doomed and not place.exists():
            killed += _killed(way, place, f"{number}/{shards}", float(rng.uniform(0, _LATEST)))
        if not (place / MANIFEST).exists():
            child = _started(way, place, f"{number}/{shards}")
            assert os.waitpid(child, 0)[1] == 0, f"shard {number} failed"
    places = [folder / f"shard-{number}" for number in (1 + rng.permutation(shards)).tolist()]
    if not (merged / MANIFEST).exists():
        contactlab.merge(places, output=merged)
    print(f"{way}: {shards} shards, {killed} killed as they wrote; {_likeness(one, merged)}")


def _started(way: str, place: Path, shard: str) -> int:
    """Run a shard in a process group of its own; return its id."""
    child = os.fork()
    if child:
        return child
    os.setsid()
    try:
        contactlab.sweep(SWEEP, output=place, shard=shard, **WAYS[way])
    except BaseException as error:  # noqa: BLE001 - said, and told to the parent
        print(f"shard {shard}: {error}", file=sys.stderr, flush=True)
        os._exit(1)
    os._exit(0)


def _killed(way: str, place: Path, shard: str, after: float) -> bool:
    """Kill a shard some time after its first rows; return whether it was unfinished then."""
    child, journal = _started(way, place, shard), place / "journal.jsonl"
    while not (journal.exists() and journal.stat().st_size) and not (place / MANIFEST).exists():
        assert os.waitpid(child, os.WNOHANG) == (0, 0), f"shard {shard} failed"
        time.sleep(0.002)
    time.sleep(after)
    was_finished = (place / MANIFEST).exists()
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return not was_finished


def _likeness(one: Path, merged: Path) -> str:
    tables = [pq.read_table(folder / TABLE) for folder in (one, merged)]
    names = [name for name in tables[0].column_names if name not in COLUMNS_OF_MACHINE]
    equal = sum(tables[0][name].equals(tables[1][name]) for name in names)
    traces = [
        {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*.mcap")}
        for folder in (one, merged)
    ]
    alike = sum(traces[1].get(name) == content for name, content in traces[0].items())
    digests = {Store.open(folder).physics for folder in (one, merged)}
    return (
        f"{equal} of {len(names)} columns and {alike} of {len(traces[0])} traces equal, "
        f"{len(digests)} digest of the physics, {len(verify(merged))} problems"
    )


if __name__ == "__main__":
    main()
