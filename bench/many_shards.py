"""Sixty-four shards, five of them killed and run again, against the store of one machine.

Run: python -m bench.many_shards WAY FOLDER [SHARDS], where WAY is `here`, `slurm` or `ray`

Shards run in random order, each in a process group of its own, forked from one that has loaded what
it needs: in that process, through submitit's local executor, or on the Ray cluster that RAY_ADDRESS
names. A doomed shard is killed with all of its group, at a random moment of the time that the shard
before it took to write its store. What no clock decides is compared: the digest of the physics, the
table without costs and times, the bytes of traces. An interrupted call goes on where it was.
"""

import os
import shutil
import signal
import sys
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pyarrow.parquet as pq

import contactlab
from contactlab.parts import register_parts
from contactlab.store.finished_store import Store
from contactlab.store.store_files import IDENTITY, MANIFEST, TABLE
from contactlab.store.table_layout import COLUMNS_OF_MACHINE
from contactlab.store.verify_store import find_problems

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
    "here": {"workers": 0},
    "slurm": {"executor": "slurm", "address": "cluster=local,timeout_min=5", "workers": 1},
    "ray": {"executor": "ray", "address": os.environ.get("RAY_ADDRESS"), "workers": 1},
}


def main() -> None:
    """Run the shards, merge them, and print how many columns and traces equal one machine's."""
    way, folder, shards = sys.argv[1], Path(sys.argv[2]), int([*sys.argv, SHARDS][3])
    one, merged = folder / "one", folder / "merged"
    contactlab.sweep(SWEEP, output=one, workers=0)
    run_all(way, folder, shards)
    places = [folder / f"shard-{number}" for number in range(1, shards + 1)]
    if not (merged / MANIFEST).exists():
        shuffled = np.random.default_rng(shards + 1).permutation(shards)
        contactlab.sweep([places[number] for number in shuffled], merge=True, output=merged)
    killed = (folder / "killed").read_text().splitlines() if (folder / "killed").exists() else []
    took = median(written_in(place) for place in places)
    print(f"{way}: {shards} shards, {len(killed)} killed; {likeness(one, merged)}")
    print(f"  a shard writes its store within {took:.2f} s (median)")


def run_all(way: str, folder: Path, shards: int) -> None:
    """Run every shard that is not finished, in random order, and kill some of them first."""
    rng = np.random.default_rng(shards)
    order, longest = (1 + rng.permutation(shards)).tolist(), 1.0
    doomed = {*order[EVERY // 2 :: EVERY]}
    for number in order:
        place, after = folder / f"shard-{number}", float(rng.uniform(0, 1))
        while number in doomed and not place.exists():
            kill_once(started(way, place, f"{number}/{shards}"), place, longest * after)
            after /= 2
        if not (place / MANIFEST).exists():
            begin = time.time()
            child = started(way, place, f"{number}/{shards}")
            assert os.waitpid(child, 0)[1] == 0, f"shard {number} failed"
            print(f"shard {number}: {time.time() - begin:.1f} s", flush=True)
        longest = written_in(place)


def started(way: str, place: Path, shard: str) -> int:
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


def kill_once(child: int, place: Path, after: float) -> None:
    """Kill a shard so long after its store began [s]; remove the store if it was whole by then."""
    while not (place / IDENTITY).exists():
        assert os.waitpid(child, os.WNOHANG) == (0, 0), f"{place.name} failed"
        time.sleep(0.002)
    time.sleep(after)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    if (place / MANIFEST).exists():
        shutil.rmtree(place)
    else:
        with (place.parent / "killed").open("a") as told:
            told.write(f"{place.name}, {after:.3f} s after its store began\n")


def written_in(place: Path) -> float:
    """Return how long a store took from its first file to its last [s]."""
    return (place / MANIFEST).stat().st_mtime - (place / IDENTITY).stat().st_mtime


def likeness(one: Path, merged: Path) -> str:
    """Return in words what is equal in two stores."""
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
        f"{len(digests)} digest of the physics, {len(find_problems(merged))} problems"
    )


if __name__ == "__main__":
    register_parts()
    main()
