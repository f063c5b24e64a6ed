"""The live display of a sweep on a terminal; plain lines, seldom, elsewhere."""

import time
from collections import Counter
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.live import Live
from rich.text import Text

if TYPE_CHECKING:
    from contactlab.pipeline import Finished

_QUIET_SECONDS = 10.0
_BAR = 24


class Progress:
    """Counts finished runs, and says so."""

    def __init__(self, live: Live | None, console: Console) -> None:
        self._live = live
        self._console = console
        self._total = self._before = self._done = 0
        self._labels: Counter[str] = Counter()
        self._start = self._said = time.monotonic()

    def begin(self, total: int, done: int) -> None:
        """Say how many runs there are, and how many are stored already."""
        self._total, self._before, self._done = total, done, done
        self._start = self._said = time.monotonic()
        if done:
            self._console.print(f"{done} of {total} runs are stored already", highlight=False)

    def advance(self, finished: "Sequence[Finished]") -> None:
        """Count runs that just finished."""
        self._done += len(finished)
        self._labels.update(each.label for each in finished)
        if self._live is not None:
            self._live.update(Text(self._line()))
        elif time.monotonic() - self._said > _QUIET_SECONDS:
            self._said = time.monotonic()
            self._console.print(self._line(), highlight=False, markup=False)

    def _line(self) -> str:
        new = self._done - self._before
        rate = new / max(1e-9, time.monotonic() - self._start)
        left = (self._total - self._done) / rate if rate else 0.0
        filled = round(_BAR * self._done / max(1, self._total))
        labels = "  ".join(f"{label} {count}" for label, count in self._labels.most_common(6))
        bar = "█" * filled + "░" * (_BAR - filled)
        return f"{bar} {self._done}/{self._total}  {rate:.0f}/s  {_time(left)} left  {labels}"


@contextmanager
def progress() -> Generator[Progress]:
    """Yield a display on stderr: live on a terminal, else a plain line every ten seconds."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield Progress(None, console)
        return
    with Live(console=console, refresh_per_second=4, transient=True) as live:
        yield Progress(live, console)


def _time(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
