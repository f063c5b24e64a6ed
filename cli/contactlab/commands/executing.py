"""Where a sweep's jobs run: worker processes of this machine, or a Ray cluster."""

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from contactlab.errors import SweepFileError

if TYPE_CHECKING:
    from contactlab.run import Ask


class Executing(StrEnum):
    """Where jobs run."""

    local = "local"
    ray = "ray"


ExecutorOption = Annotated[
    Executing, typer.Option("--executor", help="Where runs are computed: here, or by Ray.")
]
AddressOption = Annotated[
    str | None,
    typer.Option(metavar="HOST:PORT|auto", help="The Ray cluster; one is started if left out."),
]


def check_executor(executor: Executing, address: str | None, workers: int | None) -> None:
    """Refuse options that do not go together.

    Raises:
        SweepFileError: there are such.
    """
    if executor is Executing.local and address is not None:
        raise SweepFileError("--address is of a Ray cluster; add --executor ray")
    if executor is Executing.ray and workers == 0:
        raise SweepFileError("--workers 0 runs all in this process; leave it out for Ray")


@contextmanager
def executing(
    ask: "Ask", executor: Executing, address: str | None, workers: int | None
) -> Generator["Ask"]:
    """Yield what to run with where to run it; a cluster is left at the end."""
    if executor is Executing.local:
        yield ask
        return
    from contactlab.run.cluster import ray_cluster

    with ray_cluster(address, ask.workers if address is None else workers) as cluster:
        yield replace(ask, cluster=cluster)
