"""How commands print: results to stdout as text or JSON, everything else to stderr."""

import json
import time
from collections import Counter, deque
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from contactlab.run import Finished


class Format(StrEnum):
    """How results are printed."""

    text = "text"
    json = "json"


FormatOption = Annotated[Format, typer.Option("--format", help="How results are printed.")]


def print_json(data: Any) -> None:  # noqa: ANN401 - anything that JSON holds
    """Print data as JSON to stdout."""
    typer.echo(json.dumps(data, indent=2, allow_nan=False))


def print_table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a plain table to stdout; columns that hold only numbers are aligned to the right.

    A column "label" has the colours of labels, which repeat what the word says already.
    """
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for index, name in enumerate(header):
        numeric = all(isinstance(row[index], (int, float)) for row in rows)
        table.add_column(
            Text(name), justify="right" if numeric else "left", no_wrap=len(header) > 3
        )
    for row in rows:
        cells = zip(header, row, strict=True)
        table.add_row(
            *[
                Text(_cell(value), style=label_style(str(value)) if name == "label" else "")
                for name, value in cells
            ]
        )
    stdout().print(table, highlight=False)


def label_style(name: str) -> str:
    """Return the colour of a label; none if it is unknown here."""
    from contactlab.measure import LABELS

    if name not in LABELS:
        return ""
    label = LABELS[name]
    return "red" if label.is_severe else "yellow" if label.severity else "green"


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


DRAWN_PER_SECOND = 4
_QUIET_SECONDS = 10.0
# Rates are those of the last half minute, and not told before the first second is over.
_RECENT_SECONDS = 30.0
_LEAST_SECONDS = 1.0
_BAR = 24
_MOST_LABELS = 6


class Progress:
    """Counts finished runs, and says so."""

    def __init__(self, console: Console, *, live: bool) -> None:
        self._console = console
        self._live = live
        self._total = self._done = 0
        self._labels: Counter[str] = Counter()
        self._recent: deque[tuple[float, int]] = deque()
        self._said = time.monotonic()

    def begin(self, total: int, done: int) -> None:
        """Say how many runs there are, and how many are stored already."""
        self._total, self._done = total, done
        self._labels = Counter()
        self._said = time.monotonic()
        self._recent = deque([(self._said, done)])
        if done:
            self._console.print(f"{done:,} of {total:,} runs are stored already", highlight=False)

    def advance(self, finished: "Sequence[Finished]") -> None:
        """Count runs that just finished."""
        self._done += len(finished)
        for each in finished:
            self._labels[each.label] += 1
        if not self._live and time.monotonic() - self._said > _QUIET_SECONDS:
            self._said = time.monotonic()
            self._console.print(self.line(), soft_wrap=True)

    def line(self) -> Text:
        """Return what there is to say now, as one line; nothing before there are runs."""
        if not self._total:
            return Text()
        filled, rate = _BAR * self._done // self._total, self._rate()
        line = Text(no_wrap=True, overflow="ellipsis")
        line.append("█" * filled, "green").append("░" * (_BAR - filled), "dim")
        line.append(f" {self._done:,} of {self._total:,}")
        if rate:
            line.append(f"  {_rate(rate)}  {_time((self._total - self._done) / rate)} left")
        # The display has a thread of its own: a copy, lest a new label come while it looks.
        for label, count in Counter(dict(self._labels)).most_common(_MOST_LABELS):
            line.append("  ").append(label, label_style(label)).append(f" {count:,}")
        return line

    def _rate(self) -> float:
        """Return runs per second [1/s] of late; 0 if that cannot be told yet."""
        now, recent = time.monotonic(), self._recent
        recent.append((now, self._done))
        while len(recent) > 2 and recent[1][0] < now - _RECENT_SECONDS:
            recent.popleft()
        start, before = recent[0]
        return (self._done - before) / (now - start) if now - start >= _LEAST_SECONDS else 0.0


@contextmanager
def progress() -> Generator[Progress]:
    """Yield a display on stderr: live on a terminal, else a plain line every ten seconds."""
    console = Console(stderr=True)
    shown = Progress(console, live=console.is_terminal)
    if not console.is_terminal:
        yield shown
        return
    with Live(
        console=console,
        get_renderable=shown.line,
        refresh_per_second=DRAWN_PER_SECOND,
        transient=True,
    ):
        yield shown


def _rate(rate: float) -> str:
    return f"{rate:,.0f}/s" if rate >= 10 else f"{rate:.2g}/s"


def _time(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    days, hours = divmod(hours, 24)
    if days:
        return f"{days} d {hours} h"
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
