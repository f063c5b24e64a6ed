"""Entry of a node of a Ray cluster: checks its requirements, then runs jobs.

This module is sent to nodes by value, since a node may have another contactlab, or none. Therefore
nothing else of contactlab is imported before the requirements are checked.
"""

import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import ray

_accepted_tokens: set[str] = set()  # tokens of sweeps that this process can serve


@dataclass(frozen=True)
class NodeRequirements:
    """Requirements on a node to run jobs of a sweep, which the token identifies.

    It must see the sentinel, a file that the sweep created in the store's folder, and be able to
    write in the same folder; there is no sentinel if the store is not a folder.
    """

    token: str
    versions: Mapping[str, str]
    sentinel: Path | None = None


def refusal_reason(requirements: NodeRequirements) -> str | None:
    """Return the reason why jobs cannot be run here; None if they can."""
    reason = next(_list_faults(requirements), None)
    return f"node {platform.node()} ({ray.util.get_node_ip_address()}) {reason}" if reason else None


def _list_faults(requirements: NodeRequirements) -> Iterator[str]:
    for name, ours in requirements.versions.items():
        try:
            theirs = f"{name} {version(name)}"
        except PackageNotFoundError:
            theirs = f"no {name}"
        if theirs != f"{name} {ours}":
            yield (
                f"has {theirs}, but the sweep was started with {name} {ours}; "
                "install the same versions on every node"
            )
    if (sentinel := requirements.sentinel) is None:
        return
    store = sentinel.parent.parent
    if not sentinel.exists():
        yield (
            f"does not see the store {store}; write it with -o to a folder that all nodes share, "
            "or to an object store: -o s3://BUCKET/PREFIX"
        )
    elif not os.access(sentinel.parent, os.W_OK):
        yield f"cannot write to the store {store}; let its user, {os.getuid()}, write there"


def run_job(token: str, shared: Sequence[Any], job: bytes) -> Any:  # noqa: ANN401 - see below
    """Return a job's result, the exception that ended it, or the reason for a refusal of this node.

    References to the requirements and to the task's bundle are shared, and fetched on demand.
    """
    requirements, bundle = shared
    if token not in _accepted_tokens:
        if (refused := refusal_reason(ray.get(requirements))) is not None:
            return refused
        _accepted_tokens.add(token)
    from contactlab.run.ray.worker import run_on_worker  # noqa: PLC0415 - see the top

    return run_on_worker(token, lambda: ray.get(bundle), job)
