"""The live display of a sweep on a terminal; plain lines, seldom, elsewhere.

A run that finishes only counts. The display is drawn by the clock, a few times a second, however
many runs finish meanwhile.
"""

import time
from collections import Counter, deque
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.live import Live
from rich.text import Text

from contactlab.commands.output import style_of

if TYPE_CHECKING:
    from contactlab.run import Finished

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
            line.append("  ").append(label, style_of(label)).append(f" {count:,}")
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
