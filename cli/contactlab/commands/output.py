"""How commands print: results to stdout as text or JSON, everything else to stderr."""

import json
from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table


class Format(StrEnum):
    """How results are printed."""

    text = "text"
    json = "json"


FormatOption = Annotated[Format, typer.Option("--format", help="How results are printed.")]


def print_json(data: Any) -> None:  # noqa: ANN401 - anything that JSON holds
    """Print data as JSON to stdout."""
    typer.echo(json.dumps(data, indent=2, allow_nan=False))


def print_table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a plain table to stdout; columns that hold only numbers are aligned to the right."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for index, name in enumerate(header):
        numeric = all(isinstance(row[index], (int, float)) for row in rows)
        table.add_column(name, justify="right" if numeric else "left", overflow="fold")
    for row in rows:
        table.add_row(*[_cell(value) for value in row])
    stdout().print(table, markup=False, highlight=False)


def stdout() -> Console:
    """Return the console for results; as wide as they need where nobody looks."""
    console = Console()
    return console if console.is_terminal else Console(width=160)


def say(message: str) -> None:
    """Print a message for people to stderr."""
    Console(stderr=True).print(message, markup=False, highlight=False, soft_wrap=True)


def _cell(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
