"""A Ray cluster of three nodes with a CPU each, on this machine; ends with its standard input.

It is a program of its own, so that nothing of it is left in the process that tests. Lines that it
reads: `add`; `remove`, which takes a node away as its owner does; `kill`, as a loss of power does.
"""

import logging
import os
import signal
import sys
from pathlib import Path
from typing import Any

from ray.cluster_utils import Cluster

logging.disable(logging.CRITICAL)


def kill(node: Any) -> None:
    """End a node's processes at once."""
    (raylet,) = node.all_processes["raylet"]
    tasks = Path(f"/proc/{raylet.process.pid}/task")
    children = " ".join(path.read_text() for path in tasks.glob("*/children"))
    for pid in [raylet.process.pid, *map(int, children.split())]:
        os.kill(pid, signal.SIGKILL)


def main() -> None:
    """Start the nodes, print the address, and do what is asked."""
    cluster: Any = Cluster(
        initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False}
    )
    nodes: list[Any] = [cluster.add_node(num_cpus=1) for _ in range(3)]
    print(cluster.address, flush=True)  # noqa: T201
    for line in sys.stdin:
        match line.strip():
            case "add":
                nodes.append(cluster.add_node(num_cpus=1))
            case "remove":
                cluster.remove_node(nodes.pop())
            case _:
                kill(nodes[-1])
                cluster.remove_node(nodes.pop())
        print(len(nodes), flush=True)  # noqa: T201
    cluster.shutdown()


main()
