"""Options that commands share, and what they mean."""

import os
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.errors import OutputError, SweepFileError

if TYPE_CHECKING:
    from contactlab.run import SweepRequest
    from contactlab.store import Address
else:
    # What people write; the parser makes an address of it. To know its type here, as typer wants
    # to, would load Arrow before any command is chosen.
    Address = str

METAVAR = "STORE"


def store_at(text: str) -> "Address":
    """Return the address that a text means.

    Raises:
        OutputError: it is none of a store.
    """
    from contactlab.store import parse_address

    return parse_address(text)


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


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class ExecutorName(StrEnum):
    """Where jobs run."""

    local = "local"
    ray = "ray"


ExecutorOption = Annotated[
    ExecutorName, typer.Option("--executor", help="Where runs are computed: here, or by Ray.")
]
AddressOption = Annotated[
    str | None,
    typer.Option(metavar="HOST:PORT|auto", help="The Ray cluster; one is started if left out."),
]


def check_executor(executor: ExecutorName, address: str | None, workers: int | None) -> None:
    """Refuse options that do not go together.

    Raises:
        SweepFileError: there are such.
    """
    if executor is ExecutorName.local and address is not None:
        raise SweepFileError("--address is of a Ray cluster; add --executor ray")
    if executor is ExecutorName.ray and workers == 0:
        raise SweepFileError("--workers 0 runs all in this process; leave it out for Ray")


@contextmanager
def executing(
    ask: "SweepRequest", executor: ExecutorName, address: str | None, workers: int | None
) -> Generator["SweepRequest"]:
    """Yield what to run with where to run it; a cluster is left at the end."""
    if executor is ExecutorName.local:
        yield ask
        return
    from contactlab.run import ray_cluster

    with ray_cluster(address, ask.workers if address is None else workers) as cluster:
        yield replace(ask, cluster=cluster)
