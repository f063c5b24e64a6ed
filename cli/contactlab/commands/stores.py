"""Where a store is, on the command line: a folder, or an address in object storage."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.errors import OutputError

if TYPE_CHECKING:
    from contactlab.store import Address
else:
    # What people write; the parser makes an address of it. To know its type here, as typer wants
    # to, would load Arrow before any command is chosen.
    Address = str

__all__ = ["METAVAR", "Address", "StoreArgument", "folder_at", "store_at"]
METAVAR = "STORE"


def store_at(text: str) -> "Address":
    """Return the address that a text means.

    Raises:
        OutputError: it is none of a store.
    """
    from contactlab.store import located

    return located(text)


def folder_at(text: str) -> Path:
    """Return the folder that a text means, for commands that write several stores.

    Raises:
        OutputError: it is an address in object storage.
    """
    address = store_at(text)
    if not isinstance(address, Path):
        raise OutputError(f"{text}: this command writes into a folder; sweep -o takes addresses")
    return address


StoreArgument = Annotated[
    Address,
    typer.Argument(
        parser=store_at, metavar=METAVAR, help="The store: a folder or s3://BUCKET/PREFIX."
    ),
]
