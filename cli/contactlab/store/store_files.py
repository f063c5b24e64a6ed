"""Address and files of a store, such as `sweep.json` and `manifest.json`, and safe access to them.

A store is a local folder, or a prefix in object storage. Its files may come from an untrusted
source. Names are relative and lead nowhere else; below the store's folder, which may itself be a
link, only folders and regular files are used, up to a size that no valid store reaches.
"""

import math
import os
import re
import stat
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import from_json, to_json

from contactlab.errors import OtherSweepError, OutputError, StoreError
from contactlab.plugins import find_extensions
from contactlab.schema.evidence import STORE_VERSION, StoreManifest, SweepIdentity
from contactlab.schema.strict_model import is_inner_name
from contactlab.schema.sweep_schema import Sweep

# NAME:SECRET@HOST, and the parameters of signed addresses.
_CREDENTIALS = re.compile(r"^[^/]*@|\?.*(key|secret|token|sig)", re.IGNORECASE | re.DOTALL)
_URL_PARTS = re.compile(r"(?P<scheme>[a-z][a-z0-9+.-]*)://(?P<rest>.*)", re.DOTALL)


@dataclass(frozen=True)
class ObjectAddress:
    """A store in object storage, or an object in it."""

    scheme: str  # such as s3, gs or az
    bucket: str  # the bucket; for az, the container
    prefix: str  # key prefix in the bucket, without leading or trailing slashes; not empty

    @property
    def name(self) -> str:
        """The last part of the prefix."""
        return self.prefix.rpartition("/")[2]

    def __truediv__(self, name: object) -> "ObjectAddress":
        return ObjectAddress(self.scheme, self.bucket, f"{self.prefix}/{name}")

    def __str__(self) -> str:
        return f"{self.scheme}://{self.bucket}/{self.prefix}"


Address = Path | ObjectAddress


def parse_address(text: str | Address) -> Address:
    """Return the address of a store: `s3://bucket/prefix`, `gs://...`, `az://...`, or a path.

    Raises an OutputError if it is a URL but not of a store, if it contains credentials, or if it is
    a path with a backslash.
    """
    if not isinstance(text, str):
        return text
    url = _URL_PARTS.fullmatch(text)
    if (
        url is None
        and (scheme := text.partition(":")[0]) in find_extensions("store")
        and ":" in text
    ):
        raise OutputError(f"{text}: write {scheme}://BUCKET/PREFIX")
    if url is None:
        path = Path(text).absolute()
        if os.sep == "/" and "\\" in str(path):
            raise OutputError(
                f"{path}: MuJoCo cannot open files in a folder with a backslash in its name; write "
                "another name"
            )
        # Arrow would read a relative path with a colon as a URL.
        return path if ":" in text else Path(text)
    if _CREDENTIALS.search(url["rest"]):
        # The text is not repeated, because it would appear in the logs of CI jobs.
        raise OutputError(
            f"the {url['scheme']}:// address holds credentials; write it without them, and set the "
            "environment variables of the provider (see docs/how-to/stores.md)"
        )
    if url["scheme"] not in (schemes := find_extensions("store")):
        known_schemes = ", ".join(f"{scheme}://" for scheme in schemes)
        raise OutputError(f"{text}: a store is a folder or an address with {known_schemes}")
    bucket, *parts = url["rest"].rstrip("/").split("/")
    if not bucket or not parts or not all(part not in {"", ".", ".."} for part in parts):
        raise OutputError(f"{text}: write {url['scheme']}://BUCKET/PREFIX, without empty parts")
    return ObjectAddress(url["scheme"], bucket, "/".join(parts))


MANIFEST = "manifest.json"
IDENTITY = "sweep.json"
TABLE = "runs.parquet"
JOURNAL = "journal.jsonl"
NOTES = "notes.jsonl"
SCENES = "scenes"
TRACES = "traces"
CONTROLS = "controls"
LOCK = ".lock"

MOST_DOCUMENT = 64 << 20  # bytes of a file that is read at once: identity, manifest, lock
MOST_TRACE = 2 << 30  # bytes of a trace, compressed or not, unless it is read into files
MOST_BYTES = 64 << 30  # bytes of any file
_Document = TypeVar("_Document", bound=BaseModel)
_OPEN_FLAGS = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


def read_stored(folder: Path, name: str, most: int = MOST_DOCUMENT) -> bytes | None:
    """Return the content of a store's file; see `stored_file`."""
    path = stored_file(folder, name, most)
    if path is None:
        return None
    with os.fdopen(os.open(path, _OPEN_FLAGS), "rb") as file:
        # Check again: another file may have replaced it.
        _check_file(path, os.fstat(file.fileno()), most)
        return file.read(most)


def stored_file(folder: Path, name: str, most: int = MOST_BYTES) -> Path | None:
    """Return the path of a store's file of at most `most` bytes; None if it does not exist.

    Raises a StoreError if the name leads out of the store, if the file or a folder on the way is
    something else, or if it is too large.
    """
    return None if stored_size(folder, name, most) is None else folder / name


def stored_size(folder: Path, name: str, most: int = MOST_BYTES) -> int | None:
    """Return the size of a store's file [bytes]; see `stored_file`."""
    if not is_inner_name(name):
        raise StoreError(f"{folder} is damaged: it names a file '{name}'")
    path = str(folder)
    *folders, last = name.split("/")
    try:
        for place in folders:
            path = f"{path}/{place}"
            if stat.S_ISLNK(os.lstat(path).st_mode):
                raise _foreign_file_error(path)
        path = f"{path}/{last}"
        status = os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise StoreError(f"cannot read {path}: {error.strerror}") from error
    _check_file(path, status, most)
    return status.st_size


def check_tree(folder: Path) -> None:
    """Raise a StoreError if a folder of a store contains anything except folders and files."""
    folders = [folder]
    while folders:
        path = folders.pop()
        try:
            mode = path.lstat().st_mode
            if stat.S_ISDIR(mode):
                with os.scandir(path) as inside:
                    folders += [Path(e) for e in inside if not e.is_file(follow_symlinks=False)]
        except FileNotFoundError:
            continue
        except OSError as error:
            raise StoreError(f"cannot read {path}: {error.strerror}") from error
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise _foreign_file_error(path)


def _check_file(path: object, status: os.stat_result, most: int) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise _foreign_file_error(path)
    if status.st_size > most:
        raise StoreError(f"{path} is damaged: {status.st_size:,} bytes are more than {most:,}")


def _foreign_file_error(path: object) -> StoreError:
    return StoreError(
        f"{path} is a symbolic link or not a regular file; a store holds folders and files only"
    )


def parse_identity(data: bytes, store: Address) -> SweepIdentity:
    """Return the sweep that a store belongs to. Raises a StoreError if its file is damaged."""
    return _parse_document(data, SweepIdentity, store / IDENTITY)


def parse_manifest(data: bytes, store: Address) -> StoreManifest:
    """Return the manifest of a finished store; see `parse_identity`."""
    return _parse_document(data, StoreManifest, store / MANIFEST)


def stored_sweep(identity: SweepIdentity) -> Sweep:
    """Return the sweep of a store. Raises a StoreError if it is not one of this version."""
    try:
        return Sweep.model_validate(identity.resolved)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise StoreError(f"{IDENTITY} is damaged: resolved.{where}: {first['msg']}") from error


def time_now() -> str:
    """Return the time (UTC) in the format of manifests and records."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def document_json(document: BaseModel) -> str:
    """Return the text of an identity or a manifest in its file."""
    return document.model_dump_json(indent=2) + "\n"


def other_parts(stored: SweepIdentity, requested: SweepIdentity) -> list[str]:
    """Return the different parts of two sweeps, as text, whatever runs of their grids they make.

    Parts that are only written differently are equal: a list of seeds and their count, or values
    of an axis as a list and as a form, if the plans have the same runs. Differences of their files
    are given by key; the resulting differences of runs are omitted.
    """
    ours, theirs = _whole_grid(requested), _whole_grid(stored)
    requested_parts, stored_parts = (_plain_form(whole.pop("resolved")) for whole in (ours, theirs))
    keys = [
        name
        for name in {**requested_parts, **stored_parts}
        if requested_parts.get(name) != stored_parts.get(name)
    ]
    same_runs = all(ours[name] == theirs[name] for name in ("plan_hash", "runs_asked"))
    shapes = [_grid_shape(_plain_form(each.resolved)) for each in (requested, stored)]
    if same_runs and shapes[0] == shapes[1]:
        keys = [name for name in keys if name not in _GRID_KEYS]
    unsaid = {"source", *(_MADE_BY_KEYS if keys else ("overrides",) if same_runs else ())}
    # One that is empty, such as no plug-ins, is left out.
    names = dict.fromkeys((*ours, *theirs))
    others = [each for each in names if each not in unsaid and ours.get(each) != theirs.get(each)]
    return [*dict.fromkeys([*keys, *(_PART_TEXTS.get(name, name) for name in others)])]


_GRID_KEYS = ("seeds", "axes", "zip", "sample", "include", "exclude")


def _plain_form(resolved: Mapping[str, Any]) -> dict[str, Any]:
    # Seeds, and the values of axes that are knobs, are lists.
    seeds, axes, keys = resolved.get("seeds", 1), resolved.get("axes", {}), {"values", "role"}
    plain_axes = {
        name: axis["values"] if isinstance(axis, dict) and axis.keys() == keys else axis
        for name, axis in axes.items()
        if not isinstance(axis, dict) or axis.get("role") == "knob"
    }
    plain = [*range(seeds)] if isinstance(seeds, int) else [*seeds]
    return {**resolved, "seeds": plain, "axes": {**axes, **plain_axes}}


def _grid_shape(resolved: Mapping[str, Any]) -> object:
    # The parts that the hash of the plan lacks; all parts if results choose the runs.
    if any(map(resolved.get, _CHOICE_KEYS)):
        return [resolved.get(name) for name in _GRID_KEYS]
    blocks, include = (resolved.get("axes", {}), *resolved.get("zip", ())), resolved.get("include")
    return (
        resolved.get("seeds"),
        [(name, *_axis_shape(axis)) for block in blocks for name, axis in block.items()],
        [[*row] for row in include] if isinstance(include, list) else include,
        resolved.get("sample"),
    )


def _axis_shape(axis: object) -> tuple[object, object]:
    # Role and number of values; a drawn axis as written.
    match axis:
        case {"values": values, "role": role}:
            return role, len(values)
        case {"linspace": (_, _, count), "role": role} | {"logspace": (_, _, count), "role": role}:
            return role, count
        case {"range": steps, "role": role}:
            first, last, step = (Fraction(str(value)) for value in steps)
            return role, (last - first) // step + 1
        case list() | tuple():
            return "knob", len(axis)
        case _:
            return "", axis


_MADE_BY_KEYS = {"overrides": "options", "runs_asked": "number of runs", "plan_hash": "runs"}
_PART_TEXTS = {
    **_MADE_BY_KEYS,
    "scene_hash": "files of the scene",
    "scene_model": "model file",
    "metric_versions": "versions of metrics",
    "lacking": "values that are null",
    "store_version": "version of stores",
}


def most_common(identities: Sequence[SweepIdentity]) -> int:
    """Return the index of the first of the most frequent sweep, whatever runs they make."""
    whole = [to_json({**_whole_grid(each), "source": ""}) for each in identities]
    return whole.index(Counter(whole).most_common(1)[0][0])


def check_same_sweep(store: Address, stored: SweepIdentity, requested: SweepIdentity) -> None:
    """Raise an OtherSweepError unless a store is of the requested sweep, with the same definitions.

    A StoreError says that it is another part of the sweep.
    """
    differing = other_parts(stored, requested)
    if not differing:
        if (requested_shard := shard_of(requested)) not in {None, (content := shard_of(stored))}:
            part = f"shard {content}" if content else "another part, or all,"
            raise StoreError(
                f"{store} holds {part} of this sweep, not shard {requested_shard}; write elsewhere "
                "with -o"
            )
        return
    plugins = ""
    if stored.plugins != requested.plugins:
        old, new = (
            ", ".join(map(str, identity.plugins)) or "none" for identity in (stored, requested)
        )
        plugins = f": it was begun with {old}; loaded now: {new}"
    both = _plain_form(stored.resolved), _plain_form(requested.resolved)
    details = "; ".join(_different_values(*both, differing))
    content = f"another sweep (other {', '.join(differing)}{plugins}{details and f': {details}'})"
    if differing == ["definitions"]:
        content = "runs of another contactlab, which prepares, measures or labels them differently"
    raise OtherSweepError(
        f"{store} holds {content}", "write elsewhere with -o, or replace it with --fresh"
    )


def _different_values(
    stored: Mapping[str, Any], requested: Mapping[str, Any], keys: Iterable[str], within: str = ""
) -> Iterator[str]:
    most_characters = 60
    for key in keys:
        if key not in stored.keys() | requested.keys() or stored.get(key) == requested.get(key):
            continue
        one, other, name = stored.get(key), requested.get(key), f"{within}{key}"
        if isinstance(one, dict) and isinstance(other, dict):
            both: dict[str, Any] = {**one, **other}
            yield from _different_values(one, other, both, f"{name}.")
        else:
            texts = [
                text if len(text) <= most_characters else f"{text[:most_characters]}..."
                for text in (to_json(each).decode() for each in (one, other))
            ]
            yield f"{name} is {texts[0]} there and {texts[1]} here"


# Keys of a sweep that choose the runs to make; the grid is the same for all of their values.
_CHOICE_KEYS = ("refine", "limit", "until", "search")


def _whole_grid(identity: SweepIdentity) -> dict[str, Any]:
    """Return the definition of a sweep's whole grid, independent of the chosen part."""
    whole = identity.model_dump(exclude={"whole"})
    whole["resolved"] = {**identity.resolved, **dict.fromkeys(_CHOICE_KEYS)}
    if grid := identity.whole:
        whole["runs_asked"] = grid.runs
    return whole


def shard_of(identity: SweepIdentity) -> str | None:
    """Return the slice of its grid that a sweep runs, such as 3/64; None if it is not a shard."""
    return identity.whole.shard if identity.whole else None


def is_slice(identity: SweepIdentity) -> bool:
    """Return whether a store has a part of its grid that no result chose: one or several shards."""
    return identity.whole is not None and not any(map(identity.resolved.get, _CHOICE_KEYS))


def is_covered(stored: SweepIdentity, requested: SweepIdentity) -> bool:
    """Return whether a finished store of the same sweep has all requested runs."""
    if stored.whole is None:
        return True
    is_part = is_slice(stored) and shard_of(stored) is None
    return not is_part and chooses_alike(stored, requested)


def chooses_alike(stored: SweepIdentity, requested: SweepIdentity) -> bool:
    """Return whether both choose the same part of a grid."""
    alike = all(stored.resolved.get(key) == requested.resolved.get(key) for key in _CHOICE_KEYS)
    return alike and shard_of(stored) == shard_of(requested)


def _check_numbers(value: object, keys: Sequence[str]) -> None:
    # JSON has neither NaN nor infinity, but its readers accept them.
    entries: Iterable[tuple[object, object]] = ()
    if isinstance(value, dict):
        entries = value.items()
    elif isinstance(value, list):
        entries = enumerate(value)
    for key, inner in entries:
        _check_numbers(inner, (*keys, str(key)))
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{'.'.join(keys)} is {value}, no number of JSON")


class _VersionedDocument(BaseModel):
    store_version: object = None


def _parse_document(data: bytes, kind: type[_Document], path: Address) -> _Document:
    try:
        version = _VersionedDocument.model_validate_json(data).store_version
        if version != STORE_VERSION:
            raise StoreError(
                f"{path} is of store version {version}; this contactlab reads version "
                f"{STORE_VERSION}: sweep again, or read it with the release of contactlab that "
                "wrote it"
            )
        _check_numbers(from_json(data), [])
        return kind.model_validate_json(data)
    except ValueError as error:
        if not isinstance(error, ValidationError):
            raise StoreError(f"{path} is damaged: {error}") from error
        first = error.errors(include_url=False)[0]
        # Text that is not JSON has no key.
        key = ".".join(map(str, first["loc"]))
        where = f"{key}: " if key else ""
        raise StoreError(f"{path} is damaged: {where}{first['msg']}") from error
