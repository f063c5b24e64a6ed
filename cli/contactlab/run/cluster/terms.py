"""What nodes must have for a sweep, and asking them for it before the first job."""

import secrets
from collections.abc import Generator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

import ray
from ray.exceptions import RayError
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from contactlab.errors import ClusterError
from contactlab.run.cluster import node
from contactlab.run.cluster.node import Terms
from contactlab.run.job import Task
from contactlab.store import TEMPORARY_SUFFIX, TRACES

# How long nodes may take to answer; those that take longer are asked before their first job [s].
_PATIENCE = 60.0


@contextmanager
def set_terms(task: Task) -> Generator[Terms]:
    """Yield what nodes must have; while this lasts, the store bears a sign that they must see."""
    token = secrets.token_hex(8)
    versions = {"contactlab": version("contactlab"), task.engine.name: task.engine.version}
    store, scene = task.store, task.scene_folder
    if not isinstance(store, Path):
        yield Terms(token, versions)
        return
    sign = store / TRACES / (token + TEMPORARY_SUFFIX)
    sign.touch()
    try:
        yield Terms(token, versions, sign, scene, node.digest(scene))
    finally:
        sign.unlink(missing_ok=True)


def check_nodes(terms: Terms) -> None:
    """Ask every node whether it can run jobs.

    Raises:
        ClusterError: one cannot, or there is none.
    """
    ids = [each["NodeID"] for each in ray.nodes() if each["Alive"] and each["Resources"].get("CPU")]
    if not ids:
        raise ClusterError("no node of the cluster has CPUs; start one: ray start --address=...")
    asked = [_ask(each, terms) for each in ids]
    answered, _ = ray.wait(asked, num_returns=len(asked), timeout=_PATIENCE)
    for each in answered:
        # A node may be lost while it is asked.
        with suppress(RayError):
            refused = ray.get(each)
            if refused is not None:
                raise ClusterError(refused)


def _ask(node_id: str, terms: Terms) -> Any:  # noqa: ANN401 - a reference, which Ray types so
    there = NodeAffinitySchedulingStrategy(node_id, soft=False)
    asking: Any = ray.remote(num_cpus=0, max_retries=0)(node.refusal)
    return asking.options(scheduling_strategy=there).remote(terms)
