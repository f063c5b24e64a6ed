"""A store without traces, small enough to be kept in a repository."""

import shutil
import tempfile
from pathlib import Path

from contactlab.errors import OutputError, StoreError
from contactlab.schema.evidence import StoreManifest
from contactlab.store.atomic_files import sha256_of, write_error
from contactlab.store.backend_protocol import IDENTITY, MANIFEST, SCENES, TABLE, TRACES
from contactlab.store.controls_file import controls_name
from contactlab.store.finished_store import Store
from contactlab.store.runs_table import write_compact_table
from contactlab.store.store_access import backend_at
from contactlab.store.store_address import Address
from contactlab.store.store_manifest import document_json
from contactlab.store.verify_store import verify


def write_baseline(source: Address, target: Path) -> StoreManifest:
    """Copy a store without its traces, replacing an earlier baseline.

    Records stay complete: they name their traces with size and hash. The columns' descriptions
    are left out too.

    Args:
        source: the store's address.
        target: the baseline's folder, replaced in one step.

    Returns:
        The baseline's manifest.

    Raises:
        StoreError: the store is not sound.
        OutputError: the target is no baseline, or cannot be written.
    """
    if problems := verify(source, thorough=False):
        raise StoreError(f"{source} is not sound: {problems[0]} (see `contactlab verify {source}`)")
    _check_target(source, target)
    store = Store.unchecked(source)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f"{target.name}.", dir=target.parent) as name:
            new = Path(name) / "new"
            manifest = _copy(store, new)
            if target.exists():
                target.rename(Path(name) / "old")
            new.rename(target)
    except OSError as error:
        raise write_error(Path(error.filename or target), error) from error
    return manifest


def _copy(store: Store, target: Path) -> StoreManifest:
    shutil.copytree(store.scene_folder.parent, target / SCENES)
    shutil.copyfile(store.file(IDENTITY), target / IDENTITY)
    write_compact_table(store.file(TABLE), target / TABLE)
    backend = backend_at(store.address, StoreError)
    for sha256 in {each.controls for each in store.records() if each.controls is not None}:
        file = target / controls_name(sha256)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(backend.read(controls_name(sha256)) or b"")
    files = {name: sha256_of(target / name) for name in store.manifest.files}
    manifest = store.manifest.model_copy(update={"files": files, "traces_left_out": True})
    (target / MANIFEST).write_text(document_json(manifest), encoding="utf-8")
    return manifest


def _check_target(source: Address, target: Path) -> None:
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
