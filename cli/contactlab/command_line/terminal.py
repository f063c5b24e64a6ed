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

from contactlab.command_line.surroundings import Surroundings, Watch
from contactlab.errors import StoppedError
from contactlab.printable import in_one_line, printable
from contactlab.rendering.document import Document, document_of, table_of
from contactlab.rendering.text import render_text
from contactlab.step_progress import StepCount, finished_share, interrupt_steps

if TYPE_CHECKING:
    from pydantic import BaseModel

    from contactlab.run.tasks import FinishedRun, Stop

_QUIET_SECONDS = 10.0
_LEAST_SECONDS_OF_A_RATE = 1.0
_BAR = 24
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_STOPPING = b"finishing the current runs; interrupt again to stop at once\n"


class StatusLine:
    """A line on a terminal about the work of a command, until it prints something else."""

    seconds_between_lines = 0.1

    def __init__(self) -> None:
        self.interruption = ""  # the last line of the command, if Ctrl-C ends the process at once
        self.nested: Sequence[StepCount] = ()
        self._is_shown = self._is_held = False
        self._names = list[str]()
        self._began = self._drawn = 0.0

    def show(self) -> None:
        """Show that a command works, if stderr is a terminal that can take it back."""
        self._began = time.monotonic()
        self._is_shown = _is_screen()
        if self._is_shown:
            os.write(2, b"working\r")

    def show_steps(self, nested: Sequence[StepCount]) -> None:
        """Show the state of counted work, a few times a second and when a name changes."""
        self.nested, now = nested, time.monotonic()
        names = [count.name for count in nested]
        is_soon = now - self._drawn < self.seconds_between_lines and names == self._names
        if self._is_held or is_soon or not any(names) or not _is_screen():
            return
        self._drawn, self._is_shown, self._names = now, True, names
        width = os.get_terminal_size(2).columns or 80
        os.write(2, f"\r{self.line().plain[: width - 1]}\x1b[K\r".encode())

    def line(self) -> Text:
        """Return bar, counts and the time left."""
        share, elapsed = finished_share(self.nested), time.monotonic() - self._began
        filled = int(_BAR * share)
        line = Text(no_wrap=True, overflow="ellipsis")
        line.append("█" * filled, "green").append("░" * (_BAR - filled), "dim")
        if share:
            line.append(f" {_format_time(elapsed * (1 / share - 1))} left ")
        names = [in_one_line(count.text) for count in self.nested if count.text]
        return line.append(f" {': '.join(names)}")

    def clear(self) -> None:
        """Take it back, if it is shown."""
        if self._is_shown:
            os.write(2, b"\x1b[K")
        self._is_shown = False

    @contextmanager
    def hold(self) -> Generator[None]:
        """Leave the terminal to another display."""
        self.clear()
        self._is_held = True
        try:
            yield
        finally:
            self._is_held = False


def _is_screen() -> bool:
    return os.isatty(2) and os.environ.get("TERM") != "dumb"


notice = StatusLine()


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
    # Spreadsheets compute a text that begins with one of these signs; `-` alone means no value.
    is_computed = text.startswith(("=", "@", "+", "-", "\t", "\r")) and len(text) > 1
    return in_one_line(f"'{text}" if is_computed else text)


def print_report_json(report: "BaseModel", arguments: object) -> None:
    """Print a report in the form of its schema; options do not change it."""
    del arguments
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
    """Return the color of a label; none if it is unknown here."""
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
        self._show_count(0, 0, "")

    def _show_count(self, total: int, done_count: int, phase: str) -> None:
        self._total, self._done, self._stored = total, done_count, done_count
        self._phase = phase
        self._labels: Counter[str] = Counter()
        self._began = self._first = time.monotonic()
        # From the end of the first runs: the start of workers does not count.
        self._recent: deque[tuple[float, int]] = deque()

    def begin(self, total: int, done_count: int, phase: str = "", /) -> None:
        """Start to count `total` runs of a pass, `done_count` of them finished."""
        self._show_count(total, done_count, phase)
        self._printed = self._began
        if done_count:
            counted = phase or "runs"
            self._console.print(Text(f"{done_count:,} of {total:,} {counted} are stored already"))

    def advance(self, finished: "Sequence[FinishedRun]") -> None:
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
        if notice.nested and self._done >= self._total:
            # The runs are over, or have not begun.
            return notice.line()
        if not self._total:
            return Text("compiling models, starting workers", "dim")
        filled, seconds_left = _BAR * self._done // self._total, self.seconds_left()
        line = Text(no_wrap=True, overflow="ellipsis")
        line.append("█" * filled, "green").append("░" * (_BAR - filled), "dim")
        line.append(f" {self._phase} {self._done:,}" if self._phase else f" {self._done:,}")
        line.append(f" of {self._total:,}")
        if seconds_left is not None:
            rate = self._runs_per_second()
            rate_text = f"{rate:,.0f}" if rate >= 10 else f"{rate:.2g}"
            line.append(f"  {rate_text}/s  {_format_time(seconds_left)} left")
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


@contextmanager
def progress_display() -> Generator[ProgressDisplay]:
    """Yield a display on stderr: live on a terminal, otherwise a plain line every ten seconds."""
    notice.clear()
    console = Console(stderr=True)
    display = ProgressDisplay(console, live=console.is_terminal)
    if console.is_terminal:
        live = Live(console=console, get_renderable=display.line, transient=True)
        with notice.hold(), live:
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
    def watching(self) -> Generator[Watch]:
        """Show progress on stderr, and stop on Ctrl-C and SIGTERM."""
        from contactlab.run.tasks import Stop

        stop = Stop()
        with stop_on_signals(stop), progress_display() as display:
            yield Watch(display.begin, display.advance, stop)

    def show_steps(self, nested: Sequence[StepCount]) -> None:
        """Show the progress of counted work on a terminal's stderr."""
        notice.show_steps(nested)

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

    An exception there may get lost, or libraries in C report it as an ImportError. A command that
    has begun names the results that stay in either case.
    """
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            if notice.interruption:
                # A live display hides the cursor.
                start = "\r\x1b[K\x1b[?25h" if _is_screen() else ""
                with suppress(OSError):
                    os.write(2, f"{start}{notice.interruption}\n".encode())
            os._exit(StoppedError.exit_code)
        frame = frame.f_back
    interrupt_steps()
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
