"""The backend that an address leads to."""

from pathlib import Path

from contactlab.errors import ContactlabError, optional
from contactlab.store.backend_protocol import Backend
from contactlab.store.folder_backend import FolderBackend
from contactlab.store.store_address import Address


def backend_at(address: Address, error: type[ContactlabError]) -> Backend:
    """Return the backend of a store; make it in the process that uses it.

    Args:
        address: the store's address.
        error: class of the errors that reading raises.

    Raises:
        OutputError: the library for object storage is not installed.
        ContactlabError: of the given class; the object storage cannot be used.
    """
    if isinstance(address, Path):
        return FolderBackend(address, error)
    with optional("objects", f"a store at {address.scheme}://"):
        from contactlab.store.object_backend import ObjectBackend  # noqa: PLC0415 - an extra
    return ObjectBackend(address, error)
