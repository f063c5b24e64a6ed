"""Commands on the traces of a store: `traces expand` writes them as messages."""

from pathlib import Path

import typer

from contactlab.commands import options as opt
from contactlab.commands.terminal import echo
from contactlab.errors import OutputError, StoreError

traces = typer.Typer(help="Work with the traces of a store.", no_args_is_help=True)


@traces.command()
def expand(
    store: opt.Address = opt.STORE,
    run: str | None = typer.Argument(
        None, help="Run id, or its first digits; all runs that have a trace by default."
    ),
    target: Path | None = opt.output_option(
        "FOLDER", "Folder to write RUN.mcap into; by default STORE-messages, beside the store."
    ),
) -> None:
    """Write traces as messages, which viewers open, with every bit of a compact trace."""
    from contactlab.store.atomic_files import atomic_write, write_errors
    from contactlab.store.finished_store import Store

    opened = Store.open(store)
    records = [opened.record(run)] if run else [each for each in opened.records() if each.trace]
    if not records:
        raise StoreError(f"{store} has no traces; sweep again with --set trace=all elsewhere")
    folder = target or opt.beside(store, "-messages")
    if isinstance(store, Path) and folder.resolve().is_relative_to(store.resolve()):
        raise OutputError(f"{folder} is in the store; name a folder beside it")
    size = 0
    for record in records:
        content = opened.trace_messages(record)
        with write_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(folder / f"{record.run_id}.mcap") as temporary:
            temporary.write_bytes(content)
        size += len(content)
    count = "1 trace" if len(records) == 1 else f"{len(records):,} traces"
    echo(f"{count} as messages in {folder}: {size / 1e6:.2g} MB")
