"""Read a store in object storage: its small files at once, its traces when they are asked for."""

import atexit
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from functools import cache
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory, mkdtemp

from contactlab.errors import OutputError, StoreError
from contactlab.schema import StoreManifest
from contactlab.store.objects.object_client import (
    ObjectClient,
    ObjectVersion,
    StoredObject,
    connect,
)
from contactlab.store.objects.resuming import fetch_all
from contactlab.store.store_address import Address, ObjectAddress
from contactlab.store.store_manifest import IDENTITY, MANIFEST, missing_file_error, parse_document

_PREFIX = "contactlab-"
_fetched: dict[ObjectAddress, tuple[ObjectVersion, Path]] = {}


def fetched_store(address: ObjectAddress) -> Path:
    """Return a folder with all of a store but its traces; it is there as long as the process.

    A store that is as it was when it was fetched last is not fetched again.

    Raises:
        StoreError: there is none, it is unfinished, damaged, of another version, or cannot be
            reached.
    """
    client = connect(address, StoreError)
    manifest = _manifest(client)
    version, folder = _fetched.get(address, (None, None))
    if folder is None or version != manifest.version:
        folder = _folder()
        names = parse_document(manifest.data, StoreManifest, address / MANIFEST).files
        fetch_all(client, [checked(name, address) for name in names], folder)
        (folder / MANIFEST).write_bytes(manifest.data)
        _fetched[address] = manifest.version, folder
    return folder


def _manifest(client: ObjectClient) -> StoredObject:
    if (found := client.find(MANIFEST)) is not None:
        return found
    top = client.top()
    if not top:
        raise StoreError(f"no store at {client.address}")
    raise missing_file_error(client.address, MANIFEST, begun=IDENTITY in top)


def checked(name: str, address: ObjectAddress) -> str:
    """Return a name that a store gives, once it is sure that it leads nowhere else.

    Raises:
        StoreError: it leads out of the store.
    """
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or path.as_posix() != name:
        raise StoreError(f"{address} is damaged: it names a file '{name}'")
    return name


@contextmanager
def fetched_trace(address: ObjectAddress, name: str) -> Generator[Path]:
    """Yield a file with a stored trace, which goes with the context.

    Raises:
        StoreError: there is none, or it cannot be reached.
    """
    with TemporaryDirectory(prefix=_PREFIX) as folder:
        path = Path(folder) / PurePosixPath(checked(name, address)).name
        if not _client(address).fetch(name, path):
            raise StoreError(f"{address / name} is missing")
        yield path


@cache
def _client(address: ObjectAddress) -> ObjectClient:
    return connect(address, StoreError)


def local_scene(store: Address, folder: Path) -> Path:
    """Return a folder with a store's scene, fetched if there is none on this machine.

    Args:
        store: where the store is.
        folder: where its scene is on the machine that runs the sweep; its name is the scene's hash.

    Raises:
        OutputError: the store cannot be reached, or has no such scene.
    """
    if folder.is_dir() or isinstance(store, Path):
        return folder
    return _fetched_scene(store, f"{folder.parent.name}/{folder.name}")


@cache
def _fetched_scene(store: ObjectAddress, name: str) -> Path:
    client = connect(store, OutputError)
    names = [checked(file, store) for file, _ in client.sizes(name)]
    if not names:
        raise OutputError(f"{store / name} is missing; has the sweep been removed?")
    target = _folder()
    fetch_all(client, names, target)
    return target / name


def _folder() -> Path:
    """Return a new folder that is removed when the process ends."""
    folder = Path(mkdtemp(prefix=_PREFIX))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
