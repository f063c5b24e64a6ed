"""`contactlab baseline`: stores that are small enough to commit, to compare with."""

from pathlib import Path
from typing import Annotated

import typer

from contactlab.commands import options as opt
from contactlab.commands.terminal import echo, print_json

app = typer.Typer(help="Keep stores to compare with.", no_args_is_help=True)


@app.callback()
def baseline() -> None:
    """Keep stores to compare with."""


@app.command()
def update(
    store: Annotated[
        opt.Address,
        opt.store_argument("STORE", "Store to take as the baseline."),
    ],
    dest: Annotated[Path, typer.Argument(help="Folder of the baseline, created or replaced.")],
    baseline_digest: opt.BaselineDigestOption = None,
    output: opt.FormatOption = "text",
) -> None:
    """Write a store without its traces, small enough to commit."""
    from contactlab.store.baseline_store import write_baseline

    written = write_baseline(store, dest, baseline_digest)
    runs, digest = written.manifest.runs, written.digest
    size = sum(path.stat().st_size for path in dest.rglob("*") if path.is_file())
    if output == "json":
        print_json({"baseline": str(dest), "runs": runs, "bytes": size, "digest": digest})
        return
    echo(f"{dest} holds the {runs} runs of {store} without traces: {_size(size)}")
    echo(f"digest {digest}")
    echo(f"compare with it: contactlab compare {dest} STORE --baseline-digest {digest}")


def _size(size: int) -> str:
    return f"{size / 1e3:.0f} kB" if size < 1e6 else f"{size / 1e6:.1f} MB"
