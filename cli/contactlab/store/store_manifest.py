"""`sweep.json` and `manifest.json`: the sweep that a store belongs to, and what the store holds."""

from datetime import UTC, datetime
from typing import TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import from_json

from contactlab.errors import StoreError
from contactlab.schema.evidence import STORE_VERSION, StoreManifest, SweepIdentity
from contactlab.store.store_address import Address
from contactlab.store.store_files import IDENTITY, MANIFEST

_Document = TypeVar("_Document", bound=BaseModel)


def parse_identity(data: bytes, store: Address) -> SweepIdentity:
    """Return the sweep that a store belongs to; a StoreError says how its file is damaged."""
    return _parse(data, SweepIdentity, store / IDENTITY)


def parse_manifest(data: bytes, store: Address) -> StoreManifest:
    """Return the manifest of a finished store; see `parse_identity`."""
    return _parse(data, StoreManifest, store / MANIFEST)


def time_now() -> str:
    """Return the time (UTC) as it is written in manifests and records."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def document_json(document: BaseModel) -> str:
    """Return an identity or a manifest as its file holds it."""
    return document.model_dump_json(indent=2) + "\n"


def check_same_sweep(store: Address, stored: SweepIdentity, requested: SweepIdentity) -> None:
    """Raise a StoreError unless a store is of the requested sweep, by the same definitions."""
    ours, theirs = requested.model_dump(), stored.model_dump()
    names = [*ours, *(name for name in theirs if name not in ours)]
    ignored = {"source"} if stored.definitions else {"source", "definitions"}
    differing = [each for each in names if ours.get(each) != theirs.get(each)]
    differing = [each for each in differing if each not in ignored]
    if differing == ["definitions"]:
        raise StoreError(
            f"{store} holds runs of another contactlab, which prepares, measures or labels them "
            "otherwise; write elsewhere with -o, or replace it with --fresh"
        )
    if differing:
        raise StoreError(
            f"{store} holds another sweep (other {', '.join(differing)}"
            f"{_other_plugins(stored, requested)}); "
            "write elsewhere with -o, or replace it with --fresh"
        )


def _other_plugins(stored: SweepIdentity, requested: SweepIdentity) -> str:
    """Return which plug-ins differ, in words; nothing if none do."""
    if stored.plugins == requested.plugins:
        return ""
    old, new = (", ".join(map(str, each.plugins)) or "none" for each in (stored, requested))
    return f": it was begun with {old}; loaded now: {new}"


def _parse(data: bytes, kind: type[_Document], path: Address) -> _Document:
    try:
        content = from_json(data)
        _check_version(path, content)
        return kind.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise StoreError(f"{path} is damaged: {where}: {first['msg']}") from error
    except ValueError as error:
        raise StoreError(f"{path} is damaged: {error}") from error


def _check_version(path: Address, content: object) -> None:
    if not isinstance(content, dict):
        raise ValueError("it is not a JSON object")
    version = content.get("store_version")
    if version != STORE_VERSION:
        raise StoreError(
            f"{path} is of store version {version}; this contactlab reads version {STORE_VERSION}"
        )
