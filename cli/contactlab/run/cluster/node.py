"""What a node does; it is sent there whole, since a node may have another contactlab, or none.

So nothing else of contactlab is loaded before the node is known to fit.
"""

import hashlib
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import ray

# Sweeps that this process was found fit for.
_fit: set[str] = set()


@dataclass(frozen=True)
class Terms:
    """What a node must have to run jobs of a sweep.

    Attributes:
        token: what tells this sweep from others.
        versions: of packages, by name.
        sign: a file that the sweep made in the store's folder, which nodes must see, and be able
            to write beside; None if the store is no folder.
        scene: the store's copy of the scene; None if the store is no folder.
        scene_hash: of its files.
    """

    token: str
    versions: Mapping[str, str]
    sign: Path | None = None
    scene: Path | None = None
    scene_hash: str = ""


def digest(folder: Path) -> str:
    """Return the SHA-256 over names and bytes of all files in a folder."""
    found = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        data = path.read_bytes()
        found.update(f"{path.relative_to(folder).as_posix()}\0{len(data)}\0".encode() + data)
    return found.hexdigest()


def refusal(terms: Terms) -> str | None:
    """Return why jobs cannot be run here, in words; None if they can."""
    unfit = _unfit(terms)
    return f"node {platform.node()} ({ray.util.get_node_ip_address()}) {unfit}" if unfit else None


def run_job(token: str, shared: Sequence[Any], job: bytes) -> Any:  # noqa: ANN401 - see below
    """Run a job.

    Args:
        token: what tells its sweep from others.
        shared: references to the terms and to what jobs have in common, followed where needed.
        job: the pickled runs.

    Returns:
        Its result, the failure that ended it, or why this node refuses it, in words.
    """
    terms, parcel = shared
    if token not in _fit:
        refused = refusal(ray.get(terms))
        if refused is not None:
            return refused
        _fit.add(token)
    from contactlab.run.cluster.kept import run_kept  # noqa: PLC0415 - see the top

    return run_kept(token, lambda: ray.get(parcel), job)


def _unfit(terms: Terms) -> str | None:
    for name, ours in terms.versions.items():
        theirs = _installed(name)
        if theirs != f"{name} {ours}":
            return (
                f"has {theirs}, but the sweep was started with {name} {ours}; "
                "install the same versions on every node"
            )
    return _blind(terms)


def _installed(name: str) -> str:
    try:
        return f"{name} {version(name)}"
    except PackageNotFoundError:
        return f"no {name}"


def _blind(terms: Terms) -> str | None:
    if terms.sign is None or terms.scene is None:
        return None
    store = terms.sign.parent.parent
    if not terms.sign.exists():
        return (
            f"does not see the store {store}; write it with -o to a folder that all nodes share, "
            "or to an object store: -o s3://BUCKET/PREFIX"
        )
    if not os.access(terms.sign.parent, os.W_OK):
        return f"cannot write to the store {store}; let its user, {os.getuid()}, write there"
    if digest(terms.scene) != terms.scene_hash:
        return f"reads other files in {terms.scene} than the sweep; let all nodes share one copy"
    return None
