"""`contactlab baseline`: stores that are small enough to be kept in a repository."""

from pathlib import Path
from typing import Annotated

import typer

from contactlab.commands.options import METAVAR, Address, store_at
from contactlab.commands.terminal import Format, FormatOption, print_json

app = typer.Typer(help="Keep stores to compare with.", no_args_is_help=True)


@app.callback()
def baseline() -> None:
    """Keep stores to compare with."""


@app.command()
def update(
    store: Annotated[
        Address, typer.Argument(parser=store_at, metavar=METAVAR, help="The store that is good.")
    ],
    dest: Annotated[Path, typer.Argument(help="The folder of the baseline, made or replaced.")],
    output: FormatOption = Format.text,
) -> None:
    """Write a store without traces, small enough to commit."""
    from contactlab.store import write_baseline

    manifest = write_baseline(store, dest)
    size = sum(path.stat().st_size for path in dest.rglob("*") if path.is_file())
    if output is Format.json:
        print_json({"baseline": str(dest), "runs": manifest.runs, "bytes": size})
        return
    typer.echo(f"{dest} holds the {manifest.runs} runs of {store} without traces: {_size(size)}")
    typer.echo(f"compare with it: contactlab compare {dest} STORE")


def _size(size: int) -> str:
    return f"{size / 1e3:.0f} kB" if size < 1e6 else f"{size / 1e6:.1f} MB"
