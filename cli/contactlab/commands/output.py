"""How commands print: results to stdout as text or JSON, everything else to stderr."""

import json
from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

# Colour repeats what the word says already.
_STYLES = (
    {"stable": "green"}
    | dict.fromkeys(("crashed", "timeout", "invalid", "diverged"), "red")
    | dict.fromkeys(("tunneling", "energy_injection"), "red")
    | dict.fromkeys(("oracle_miss", "chatter", "deep_penetration"), "yellow")
)


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
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for index, name in enumerate(header):
        numeric = all(isinstance(row[index], (int, float)) for row in rows)
        table.add_column(
            Text(name), justify="right" if numeric else "left", no_wrap=len(header) > 3
        )
    for row in rows:
        table.add_row(*[Text(_cell(value), style=style_of(str(value))) for value in row])
    stdout().print(table, highlight=False)


def style_of(word: str) -> str:
    """Return the colour of a label; none for any other word."""
    return _STYLES.get(word, "")


def stdout() -> Console:
    """Return the console for results; as wide as they need where nobody looks."""
    console = Console()
    return console if console.is_terminal else Console(width=10_000)


def say(message: str) -> None:
    """Print a message for people to stderr."""
    Console(stderr=True).print(message, markup=False, highlight=False, soft_wrap=True)


def _cell(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
