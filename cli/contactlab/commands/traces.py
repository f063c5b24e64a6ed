"""Work with the traces of a store."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Option, command
from contactlab.command_line.report_formats import report_formats
from contactlab.errors import OutputError, StoreError

if TYPE_CHECKING:
    from contactlab.schema.store_reports import ExpandedTraces


@command(
    "read",
    name="traces expand",
    examples=("traces expand results/grasp 3ead3115 -o messages",),
    formats=report_formats(),
)
def expand(
    store: opt.StoreArgument,
    run: Annotated[
        str | None,
        Argument("RUN", "Run id, or its first digits; all runs that have a trace by default."),
    ] = None,
    *,
    output: Annotated[
        str | Path | None,
        Option(
            "FOLDER",
            "Folder to write RUN.mcap into; by default STORE-messages, next to the store.",
            kind=Path,
            short="-o",
        ),
    ] = None,
) -> "ExpandedTraces":
    """Write traces as messages, which viewers open, with every bit of a compact trace.

    Raises:
        StoreError: there is no such store or run, or it has no trace.
        OutputError: the folder is in the store, or cannot be written.
    """
    from contactlab.schema.store_reports import ExpandedTraces
    from contactlab.store.atomic_files import atomic_write, write_errors
    from contactlab.store.finished_store import Store

    address = opt.address_of(store)
    opened = Store.open(address)
    records = (
        [opened.record(run)] if run else [record for record in opened.records() if record.trace]
    )
    if not records:
        raise StoreError(f"{address} has no traces; sweep again with --set trace=all elsewhere")
    folder = opt.beside(address, "-messages") if output is None else Path(output)
    if isinstance(address, Path) and folder.resolve().is_relative_to(address.resolve()):
        raise OutputError(f"{folder} is in the store; name another folder")
    size = 0
    for record in records:
        content = opened.trace_messages(record)
        with write_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(folder / f"{record.run_id}.mcap") as temporary:
            temporary.write_bytes(content)
        size += len(content)
    return ExpandedTraces(folder=folder, traces=len(records), bytes=size)
