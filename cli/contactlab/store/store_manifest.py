"""What a store is: read its identity and manifest, and compare them with what is asked."""

import json
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from contactlab.errors import StoreError
from contactlab.schema import STORE_VERSION, StoreManifest, SweepIdentity
from contactlab.store.store_address import Address

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


def check_same_sweep(store: Address, there: SweepIdentity, asked: SweepIdentity) -> None:
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


def parse_document(data: bytes, kind: type[_Kind], named: Address) -> _Kind:
    """Return what an identity or a manifest says.

    Raises:
        StoreError: it is damaged or of another version; the message names it as given.
    """
    try:
        said = json.loads(data)
        _check_version(named, said)
        return kind.model_validate(said)
    except (ValueError, ValidationError) as error:
        raise StoreError(f"{named} is damaged: {error}") from error


def missing_file_error(store: Address, name: str, *, begun: bool) -> StoreError:
    """Return the error for a store that is there, but lacks its identity or manifest.

    Args:
        store: where it is.
        name: what it lacks.
        begun: whether it has an identity.
    """
    if name == MANIFEST and begun:
        return StoreError(f"{store} is unfinished; run its sweep again to go on where it stopped")
    return StoreError(f"{store} is not a store: it has no {name}")


def _read(store: Path, name: str, kind: type[_Kind]) -> _Kind:
    path = store / name
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        if not store.is_dir():
            raise StoreError(f"no store at {store}") from error
        raise missing_file_error(store, name, begun=(store / IDENTITY).is_file()) from error
    except OSError as error:
        raise StoreError(f"{path} is damaged: {error}") from error
    return parse_document(data, kind, path)


def _check_version(path: Address, data: object) -> None:
    if not isinstance(data, dict):
        raise ValueError("it is not a JSON object")
    version = data.get("store_version")
    if version != STORE_VERSION:
        raise StoreError(
            f"{path} is of store version {version}; this contactlab reads version {STORE_VERSION}"
        )
