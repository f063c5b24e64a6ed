"""A store without traces, small enough to be kept in a repository."""

import fcntl
import os
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from contactlab.errors import OutputError, StoreError
from contactlab.store.atomic_files import exchange_folders, sha256_of, sync_filesystem, write_error
from contactlab.store.controls_file import controls_name
from contactlab.store.finished_store import Store
from contactlab.store.runs_table import rows_digest, write_compact_table
from contactlab.store.store_files import (
    IDENTITY,
    MANIFEST,
    SCENES,
    TABLE,
    TRACES,
    Address,
    check_tree,
    document_json,
)
from contactlab.store.verify_store import verify


def write_baseline(source: Address, target: Path, pinned: str | None = None) -> Store:
    """Copy a store without its traces, replacing an earlier baseline.

    Records stay complete: they name their traces with size and hash. The columns' descriptions are
    left out too. The target is replaced in one step; if a digest is pinned, only a baseline that
    has it. Raises a StoreError if the store is not sound; an OutputError if the target is no
    baseline, or another one, or cannot be written.
    """
    if problems := verify(source, thorough=False):
        raise StoreError(f"{source} is not sound: {problems[0]} (see `contactlab verify {source}`)")
    try:
        with _staging(target) as folder:
            _check_target(source, target, pinned)
            _copy(Store.unchecked(source), folder / "new")
            sync_filesystem(folder)
            if target.exists():
                exchange_folders(folder / "new", target)
            else:
                (folder / "new").rename(target)
    except OSError as error:
        raise write_error(Path(error.filename or target), error) from error
    return Store.unchecked(target)


@contextmanager
def _staging(target: Path) -> Generator[Path]:
    """Yield an empty folder beside a baseline; one that a killed update left is swept up first."""
    folder = target.absolute().with_name(f".{target.absolute().name}.update")
    check_tree(folder)
    folder.mkdir(parents=True, exist_ok=True)
    lock = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            message = f"{target} is being replaced by another update; wait for it"
            raise OutputError(message) from error
        if (folder / "old").exists() and not target.exists():
            (folder / "old").rename(target)
        for name in ("old", "new"):
            shutil.rmtree(folder / name, ignore_errors=True)
        try:
            yield folder
        finally:
            shutil.rmtree(folder)
    finally:
        os.close(lock)


def _copy(store: Store, target: Path) -> None:
    shutil.copytree(store.scene_folder.parent, target / SCENES)
    shutil.copyfile(store.file(IDENTITY), target / IDENTITY)
    write_compact_table(store.table, target / TABLE)
    for sha256 in {each.controls for each in store.records() if each.controls is not None}:
        file = target / controls_name(sha256)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(store.backend.read(controls_name(sha256)) or b"")
    files = {name: sha256_of(target / name) for name in store.manifest.files}
    records = rows_digest(target / TABLE)
    if store.manifest.records not in {None, records}:
        raise StoreError(f"{store.address} is not sound: its records are not those of its manifest")
    changes = {"files": files, "records": records, "traces_left_out": True}
    text = document_json(store.manifest.model_copy(update=changes))
    (target / MANIFEST).write_text(text, encoding="utf-8")


def _check_target(source: Address, target: Path, pinned: str | None) -> None:
    if pinned is not None and (found := Store.unchecked(target).digest) != pinned:
        raise OutputError(f"{target} has the digest {found}, not {pinned}; it is not replaced")
    if not target.exists() or (target.is_dir() and not any(target.iterdir())):
        return
    if isinstance(source, Path) and target.samefile(source):
        raise OutputError(f"{target} is the store itself; name another folder for the baseline")
    try:
        replaceable = Store.unchecked(target).manifest.traces_left_out
    except StoreError:
        # A baseline of another version may be replaced; anything else may not.
        replaceable = (target / MANIFEST).is_file() and not (target / TRACES).exists()
    if not replaceable:
        raise OutputError(f"{target} is no baseline, so it is not replaced; name another folder")
