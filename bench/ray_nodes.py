"""What a Ray cluster of 1, 2 and 3 local nodes does, beside worker processes of our own.

Run: python -m bench.ray_nodes [rounds] [seeds]

Nodes have one CPU each and join one by one; at each number of them the same sweep is run by one
and by two worker processes and by the cluster, in turns, each into a new store and warm: nodes and
fork servers are up, and ran a sweep before. Shown are the throughputs over that of one worker
process in the same turn, and the time of a CPU that a run costs more than there; medians of the
rounds, with the least and the most. Nodes beyond the machine's cores share them.
"""

import logging
import os
import secrets
import sys
import tempfile
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from contactlab.parts import register_parts
from contactlab.run.ray.connection import ray_cluster
from contactlab.run.sweep_request import SweepRequest, read_request
from contactlab.run.sweep_runner import run_sweep

ROUNDS, SEEDS, NODES = 3, 40, 3
SWEEP = """
version: 1
scene: box_stack
duration: 2
seeds: {seeds}
trace: sample:16
axes:
  boxes: [3]
  timestep: [1.0e-3, 2.0e-3]
  cone: [pyramidal, elliptic]
"""


class Turn(NamedTuple):
    """Seconds that the sweep took: by one worker process, by two, and by the cluster."""

    one: float
    two: float
    nodes: float


def timed(ask: SweepRequest) -> float:
    """Return how long a sweep into a new store takes [s]."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        run_sweep(replace(ask, store=Path(folder) / "store"), lambda *_: None, lambda _: None)
        return time.perf_counter() - begin


@contextmanager
def cluster_of_none() -> Generator[Any]:
    """Yield a cluster that only its owner can use, without any CPU yet."""
    os.environ |= {
        "RAY_AUTH_MODE": "token",
        "RAY_AUTH_TOKEN": secrets.token_hex(32),
        "RAY_USAGE_STATS_ENABLED": "0",
        "RAY_USAGE_STATS_REPORT_URL": "http://127.0.0.1:9/",
    }
    from ray.cluster_utils import Cluster  # noqa: PLC0415 - reads the environment

    logging.disable(logging.WARNING)
    cluster: Any = Cluster(
        initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False}
    )
    try:
        yield cluster
    finally:
        cluster.shutdown()


def turns(cluster: Any, ask: SweepRequest) -> Iterator[tuple[int, Turn]]:  # noqa: ANN401 - Ray's own
    """Yield what the sweep takes as nodes join; they leave at the end."""
    nodes: list[Any] = []
    for count in range(1, NODES + 1):
        nodes.append(cluster.add_node(num_cpus=1))
        with ray_cluster(cluster.address, None) as executor:
            there = replace(ask, cluster=executor)
            timed(there)
            one, two = replace(ask, workers=1), replace(ask, workers=2)
            yield count, Turn(timed(one), timed(two), timed(there))
    for node in nodes:
        cluster.remove_node(node)


def show(count: int, found: list[Turn], runs: int) -> None:
    """Print a line of the table."""
    two = [each.one / each.two for each in found]
    nodes = [each.one / each.nodes for each in found]
    more = [1e3 * (min(count, cores()) * each.nodes - each.one) / runs for each in found]
    print(f"  {count:5}  {_spread(two):22}{_spread(nodes):22}{_spread(more)}")


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))


def _spread(values: list[float]) -> str:
    return f"{median(values):.2f} ({min(values):.2f} to {max(values):.2f})"


def main(rounds: int, seeds: int) -> None:
    """Take the rounds and print the table."""
    text = SWEEP.format(seeds=seeds)
    ask = read_request(text, "nodes", Path("store"), folder=Path(), workers=1)
    timed(ask)
    found: dict[int, list[Turn]] = {}
    with cluster_of_none() as cluster:
        for _ in range(rounds):
            for count, turn in turns(cluster, ask):
                found.setdefault(count, []).append(turn)
    print(f"{ask.plan.count} runs, {rounds} rounds, {cores()} cores; one worker process is 1")
    print(f"  {'nodes':5}  {'two processes':22}{'the nodes':22}a run costs more by [ms of a core]")
    for count, turn in found.items():
        show(count, turn, ask.plan.count)


if __name__ == "__main__":
    register_parts()
    given = [int(each) for each in sys.argv[1:]]
    main(*given, *(ROUNDS, SEEDS)[len(given) :])
