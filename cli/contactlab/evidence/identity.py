"""What a store is: read its identity and manifest, and compare them with what is asked."""

import json
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from contactlab.errors import StoreError
from contactlab.schema import STORE_VERSION, StoreManifest, SweepIdentity

_Kind = TypeVar("_Kind", bound=BaseModel)

IDENTITY = "sweep.json"
MANIFEST = "manifest.json"


def read_identity(store: Path) -> SweepIdentity:
    """Read what a store's runs were asked to be.

    Raises:
        StoreError: it is missing, damaged or of another version.
    """
    return _read(store, IDENTITY, SweepIdentity)


def read_manifest(store: Path) -> StoreManifest:
    """Read what a finished store holds.

    Raises:
        StoreError: it is missing, damaged or of another version.
    """
    return _read(store, MANIFEST, StoreManifest)


def check_same(store: Path, there: SweepIdentity, asked: SweepIdentity) -> None:
    """Check that a store can be resumed.

    Raises:
        StoreError: it was begun by another sweep, engine or definition of metrics.
    """
    ours, theirs = asked.model_dump(), there.model_dump()
    differs = [name for name in ours if ours[name] != theirs[name] and name != "source"]
    if differs:
        raise StoreError(
            f"{store} holds another sweep (other {', '.join(differs)}); "
            "write elsewhere with -o, or replace it with --fresh"
        )


def _read(store: Path, name: str, kind: type[_Kind]) -> _Kind:
    path = store / name
    try:
        data = json.loads(path.read_bytes())
        _check_version(path, data)
        return kind.model_validate(data)
    except FileNotFoundError as error:
        raise StoreError(_missing(store, name)) from error
    except (OSError, ValueError, ValidationError) as error:
        raise StoreError(f"{path} is damaged: {error}") from error


def _check_version(path: Path, data: object) -> None:
    if not isinstance(data, dict):
        raise ValueError("it is not a JSON object")
    version = data.get("store_version")
    if version != STORE_VERSION:
        raise StoreError(
            f"{path} is of store version {version}; this contactlab reads version {STORE_VERSION}"
        )


def _missing(store: Path, name: str) -> str:
    if not store.is_dir():
        return f"no store at {store}"
    if name == MANIFEST and (store / IDENTITY).is_file():
        return f"{store} is unfinished; run its sweep again to go on where it stopped"
    return f"{store} is not a store: it has no {name}"
