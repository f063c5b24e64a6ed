"""The terminal: results on stdout, messages and progress on stderr, and Ctrl-C.

The progress display counts runs as they finish and is drawn by the clock, a few times a second, so
that its cost does not grow with the number of runs.
"""

import csv
import io
import json
import os
import signal
import sys
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

import typer
from rich.console import Console
from rich.live import Live
from rich.style import Style
from rich.text import Text

from contactlab.command_line.surroundings import Begin, Surroundings, Watch
from contactlab.errors import StoppedError
from contactlab.printable import in_one_line, printable
from contactlab.rendering.document import Document, document_of, table_of
from contactlab.rendering.text import render_text

if TYPE_CHECKING:
    from pydantic import BaseModel

    from contactlab.run.tasks import Finished, Stop

_QUIET_SECONDS = 10.0
_LEAST_SECONDS_OF_A_RATE = 1.0
_BAR = 24
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_STOPPING = b"finishing the current runs; interrupt again to stop at once\n"


class _Notice:
    """A word on a terminal from when a command starts until it says more, which may take long."""

    _is_shown = False

    def show(self) -> None:
        """Show it, where stderr is a terminal that can take it back."""
        self._is_shown = os.isatty(2) and os.environ.get("TERM") != "dumb"
        if self._is_shown:
            os.write(2, b"working\r")

    def clear(self) -> None:
        """Take it back, if it is shown."""
        if self._is_shown:
            os.write(2, b"\x1b[K")
        self._is_shown = False


notice = _Notice()


def echo(text: object, *, err: bool = False) -> None:
    """Print lines to stdout, or to stderr; control characters of data are shown as text."""
    echo_commands(printable(str(text)), err=err)


def echo_commands(text: str, *, err: bool = False) -> None:
    """Print lines that a CI job may take for commands, as annotations are."""
    with _leaving_reader():
        typer.echo(text, err=err)  # noqa: TID251 - where others get it from


def echo_bytes(data: bytes) -> None:
    """Print the bytes of a file unchanged: a patch keeps the line ends of its files."""
    with _leaving_reader():
        typer.echo(data, nl=False)  # noqa: TID251 - `echo` shows what is in lines


@contextmanager
def _leaving_reader() -> Generator[None]:
    """Print nothing more once the reader of a pipe has left, as `head` does, without an error."""
    notice.clear()
    try:
        yield
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def print_json(data: object) -> None:
    """Print data as JSON to stdout."""
    echo(json.dumps(data, indent=2, allow_nan=False))


def print_csv(header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print rows to stdout as comma-separated values, numbers with all their digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    for row in rows:
        writer.writerow([_plain_cell(cell) if isinstance(cell, str) else cell for cell in row])
    echo(text.getvalue().removesuffix("\n"))


def _plain_cell(text: str) -> str:
    # Spreadsheets compute a text that begins with one of these signs.
    return in_one_line(f"'{text}" if text.startswith(("=", "@", "+", "\t", "\r")) else text)


def print_report_json(report: "BaseModel", given: object) -> None:
    """Print a report in the form of its schema; options do not change it."""
    del given
    echo(report.model_dump_json(indent=2))


def print_table(
    header: Sequence[str], rows: Sequence[Sequence[object]], droppable: int = 0
) -> None:
    """Print a table to stdout; up to `droppable` of the last columns are left out if need be."""
    print_document(document_of([table_of(header, rows, droppable=droppable)]))


def print_document(document: Document) -> None:
    """Print a document as wide as the terminal; cells of a column "label" have colors there."""
    console = stdout()
    paint = _paint_label if console.is_terminal else None
    echo_commands(render_text(document, console.width, paint))


def _paint_label(column: str, text: str) -> str:
    style = label_style(text) if column == "label" else ""
    return Style.parse(style).render(text) if style else text


def label_style(name: str) -> str:
    """Return the colour of a label; none if it is unknown here."""
    from contactlab.measure import LABELS

    if name not in LABELS:
        return ""
    label = LABELS[name]
    return "green" if label.is_good else "red" if label.is_severe else "yellow"


def stdout() -> Console:
    """Return the console for results: as wide as the terminal, or 80 columns where none is."""
    return Console()


def say(message: str) -> None:
    """Print a message for people to stderr."""
    notice.clear()
    Console(stderr=True).print(Text(printable(message)), soft_wrap=True)


class ProgressDisplay:
    """Counts finished runs and prints how many there are."""

    def __init__(self, console: Console, *, live: bool) -> None:
        self._console = console
        self._live = live
        self._printed = time.monotonic()
        self._show_count(0, 0)

    def _show_count(self, total: int, done: int) -> None:
        self._total, self._done, self._stored = total, done, done
        self._labels: Counter[str] = Counter()
        self._began = self._first = time.monotonic()
        # From the end of the first runs: the start of workers does not count.
        self._recent: deque[tuple[float, int]] = deque()

    def begin(self, total: int, done: int) -> None:
        """Start to count `total` runs; `done` of them are finished already."""
        self._show_count(total, done)
        self._printed = self._began
        if done:
            self._console.print(Text(f"{done:,} of {total:,} runs are stored already"))

    def advance(self, finished: "Sequence[Finished]") -> None:
        """Count runs that just finished."""
        self._done += len(finished)
        for outcome in finished:
            self._labels[outcome.label] += 1
        if not self._recent:
            self._first = time.monotonic()
            self._recent.append((self._first, self._done))
        self.remind()

    def remind(self) -> None:
        """Print a plain line where no terminal shows one, if the last one is ten seconds ago."""
        if not self._live and time.monotonic() - self._printed > _QUIET_SECONDS:
            self._printed = time.monotonic()
            self._console.print(self.line(), soft_wrap=True)

    def line(self) -> Text:
        """Return the current state as one line: bar, counts, rate, time left, labels."""
        if not self._total:
            return Text("compiling models, starting workers", "dim")
        filled, left = _BAR * self._done // self._total, self.seconds_left()
        line = Text(no_wrap=True, overflow="ellipsis")
        line.append("█" * filled, "green").append("░" * (_BAR - filled), "dim")
        line.append(f" {self._done:,} of {self._total:,}")
        if left is not None:
            rate = self._runs_per_second()
            shown = f"{rate:,.0f}" if rate >= 10 else f"{rate:.2g}"
            line.append(f"  {shown}/s  {_format_time(left)} left")
        most_labels = 6
        # Drawn by a thread of its own: a copy, since a new label may come meanwhile.
        for label, count in Counter(dict(self._labels)).most_common(most_labels):
            line.append("  ").append(in_one_line(label), label_style(label)).append(f" {count:,}")
        return line

    def seconds_left(self) -> float | None:
        """Return how long all that is left takes at the recent rate [s]; None without one."""
        rate = self._runs_per_second()
        return (self._total - self._done) / rate if rate else None

    def _runs_per_second(self) -> float:
        """Return the recent rate of runs [1/s]; 0 if it is not known yet."""
        now, recent = time.monotonic(), self._recent
        start, before = self._began, self._stored
        if recent and now - self._first >= _LEAST_SECONDS_OF_A_RATE:
            recent.append((now, self._done))
            # Rates are those of the last half minute, or half of the time, after the first second.
            recent_seconds = 30.0
            while len(recent) > 2 and recent[1][0] < now - max(
                recent_seconds, (now - self._first) / 2
            ):
                recent.popleft()
            start, before = recent[0]
        return (
            (self._done - before) / (now - start)
            if now - start >= _LEAST_SECONDS_OF_A_RATE
            else 0.0
        )


class PartsBar:
    """Bar of some work in parts, with words for the one that is under way."""

    def __init__(self, most: int) -> None:
        self._most, self._begun, self._part = most, 0, "reading the model"

    def begin(self, part: str) -> None:
        """Begin the next part."""
        self._part, self._begun = part, min(self._begun + 1, self._most)

    def line(self) -> Text:
        """Return the current state as one line."""
        filled = _BAR * max(0, self._begun - 1) // self._most
        line = Text(no_wrap=True, overflow="ellipsis")
        line.append("█" * filled, "green").append("░" * (_BAR - filled), "dim")
        return line.append(f" {in_one_line(self._part)}")


@contextmanager
def progress_display() -> Generator[ProgressDisplay]:
    """Yield a display on stderr: live on a terminal, otherwise a plain line every ten seconds."""
    notice.clear()
    console = Console(stderr=True)
    display = ProgressDisplay(console, live=console.is_terminal)
    if console.is_terminal:
        with Live(console=console, get_renderable=display.line, transient=True):
            yield display
        return
    ended = threading.Event()

    look_seconds = 2.5

    def remind() -> None:
        while not ended.wait(look_seconds):
            display.remind()

    threading.Thread(target=remind, daemon=True).start()
    try:
        yield display
    finally:
        ended.set()


def _format_time(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    days, hours = divmod(hours, 24)
    if days:
        return f"{days} d {hours} h"
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


@contextmanager
def resumable(then: str = "resume") -> Generator["Stop"]:
    """Yield the event that Ctrl-C and SIGTERM set; `then` names the next action of the command."""
    from contactlab.run.tasks import Stop

    stop = Stop()
    try:
        with stop_on_signals(stop):
            yield stop
    except (KeyboardInterrupt, StoppedError) as error:
        say(f"interrupted; run the same command again to {then}")
        raise typer.Exit(StoppedError.exit_code) from error


def begin_workers(count: int | None) -> None:
    """Start the server that workers are forked from, if any are wanted; it loads meanwhile."""
    if count != 0:
        from contactlab.run.fork_server import start_server

        start_server()


class Terminal(Surroundings):
    """A terminal, or a job's log: progress and messages on stderr, and Ctrl-C asks runs to stop."""

    def say(self, message: str) -> None:
        """Print a message for people to stderr."""
        say(message)

    def fork_workers(self, count: int | None) -> None:
        """Load the modules of workers, and fork their parent process, if any are wanted."""
        begin_workers(count)

    @contextmanager
    def watching(self, then: str) -> Generator[Watch]:
        """Show progress on stderr, and stop on Ctrl-C and SIGTERM."""
        with resumable(then) as stop, progress_display() as display:
            yield Watch(display.begin, display.advance, stop)

    @contextmanager
    def in_parts(self, most: int) -> "Generator[Begin]":
        """Show one bar for all parts on a terminal's stderr; elsewhere nothing."""
        notice.clear()
        console = Console(stderr=True)
        bar = PartsBar(most)
        with resumable("examine it again"):
            if not console.is_terminal:
                yield bar.begin
                return
            with Live(console=console, get_renderable=bar.line, transient=True):
                yield bar.begin

    def announce(self, markdown: Callable[[], str], annotations: Callable[[], str]) -> None:
        """Add to the summary of a GitHub job, and annotate it; nothing elsewhere."""
        if summary := os.environ.get("GITHUB_STEP_SUMMARY"):
            from contactlab.store.atomic_files import write_errors

            with write_errors(Path(summary)), Path(summary).open("a", encoding="utf-8") as file:
                file.write(markdown())
        if os.environ.get("GITHUB_ACTIONS") == "true":
            echo_commands(annotations().removesuffix("\n"), err=True)

    def rerun_with_mujoco(self, version: str, target: object) -> None:
        """Run the same command with another MuJoCo, and end with it."""
        from contactlab.run.mujoco_environment import exec_with, find_interpreter, without_option

        other = find_interpreter(version, say)
        if other is not None:
            words = without_option(sys.argv[1:], "--mujoco")
            exec_with(other, [*words, *(["-o", f"{target}-{other.mujoco}"] if target else [])])


def interrupt(_number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt; but end the process at once, by 130, while a module is loaded.

    An exception there may get lost, or libraries in C report it as an ImportError.
    """
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            os._exit(StoppedError.exit_code)
        frame = frame.f_back
    raise KeyboardInterrupt


@contextmanager
def stop_on_signals(stop: "Stop") -> Generator[None]:
    """Turn the first Ctrl-C or SIGTERM into a request to stop, while runs that heed it go on.

    At other times, and the second time, they raise KeyboardInterrupt. A signal that is ignored
    stays so: a shell ignores Ctrl-C for processes in the background. Only the main thread
    receives signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _SIGNALS}
    handled = [number for number, handler in before.items() if handler is not signal.SIG_IGN]

    def handle(number: int, frame: FrameType | None) -> None:
        again = stop.is_set or not stop.is_watched
        # An exception may get lost, as in a finalizer; the request stays.
        stop.request_stop()
        if again:
            interrupt(number, frame)
        # Past all buffers: it may have come while one was written. On a terminal the cursor stands
        # behind the live display.
        with suppress(OSError):
            os.write(2, ("\n" if os.isatty(2) else "").encode() + _STOPPING)

    for number in handled:
        signal.signal(number, handle)
    try:
        yield
    finally:
        for number in handled:
            signal.signal(number, before[number])
