"""The display of a sweep costs the same however many runs finish, and says what is true of late."""

import io
import os
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from rich.text import Text

from contactlab.command_line import terminal as module
from contactlab.command_line.terminal import ProgressDisplay, progress_display
from contactlab.run.tasks import FinishedRun

# What rich does by default.
_DRAWN_PER_SECOND = 4
LABELS = ("stable", "chatter", "tunneling")
DONE = [[FinishedRun(b"", label, "ok", None)] for label in LABELS]


class Clock:
    """A clock that goes as it is told."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 1000.0
        monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: self.now))


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


def shown(live: bool = True) -> tuple[ProgressDisplay, io.StringIO]:
    out = io.StringIO()
    return ProgressDisplay(Console(file=out, width=200), live=live), out


@pytest.mark.timed
def test_a_million_runs_are_drawn_a_few_times_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    out, drawn = io.StringIO(), [0]
    monkeypatch.setattr(module, "Console", lambda **_: Console(file=out, force_terminal=True))
    line = ProgressDisplay.line

    def counted(self: ProgressDisplay) -> Text:
        drawn[0] += 1
        return line(self)

    monkeypatch.setattr(ProgressDisplay, "line", counted)
    began = time.monotonic()
    with progress_display() as display:
        display.begin(1_000_000, 0)
        spent = time.process_time()
        for index in range(1_000_000):
            display.advance(DONE[index % 3])
        spent = time.process_time() - spent
    # One for each tick of the clock, one at the start and at most two at the end.
    assert 1 <= drawn[0] <= _DRAWN_PER_SECOND * (time.monotonic() - began) + 3
    assert "1,000,000" in display.line().plain
    # Counting takes about half a microsecond; formatting one line alone takes a hundred.
    assert spent / 1_000_000 < 10e-6


def test_plain_lines_come_every_ten_seconds(clock: Clock) -> None:
    display, out = shown(live=False)
    display.begin(100_000, 0)
    for _ in range(60_000):
        clock.now += 1e-3
        display.advance(DONE[0])
    lines = out.getvalue().splitlines()
    assert len(lines) == 5
    assert lines[-1].startswith("█" * 12)
    assert "of 100,000  1,000/s" in lines[-1]
    assert lines[-1].endswith(f"stable {50_000 + len(lines):,}")


def test_what_is_stored_already_is_no_rate(clock: Clock) -> None:
    display, out = shown()
    display.begin(1_000_000, 900_000)
    assert out.getvalue() == "900,000 of 1,000,000 runs are stored already\n"
    assert "/s" not in display.line().plain
    clock.now += 2.0
    display.advance(DONE[0] * 200)
    assert "900,200 of 1,000,000  100/s  16:38 left  stable 200" in display.line().plain


def test_the_rate_is_that_of_late(clock: Clock) -> None:
    display, _ = shown()
    display.begin(1_000_000, 0)
    for rate in (1000, 10):
        for _ in range(240):
            clock.now += 0.25
            display.advance(DONE[1] * (rate // 4))
            display.line()
    text = display.line().plain
    # A quarter of 10 is 2 runs in each of the last 120 quarters, so 8 a second.
    assert "  8/s  " in text
    assert " d " in text.partition("left")[0]


def test_a_new_pass_counts_anew(clock: Clock) -> None:
    display, _ = shown()
    display.begin(10, 0)
    display.advance(DONE[0] * 10)
    display.begin(4, 0)
    clock.now += 1.0
    assert display.line().plain.endswith("░ 0 of 4")
    display.advance(DONE[1] * 4)
    assert display.line().plain.startswith("█" * 24 + " 4 of 4")
    assert "stable" not in display.line().plain


def test_a_pass_over_finished_runs_has_its_name(clock: Clock) -> None:
    display, out = shown()
    display.begin(24, 0)
    display.advance(DONE[0] * 24)
    display.begin(24, 6, "errors")
    clock.now += 2.0
    display.advance([FinishedRun(b"", "errors", "ok", None)] * 6)
    assert out.getvalue() == "6 of 24 errors are stored already\n"
    assert "█ errors" not in display.line().plain
    assert "░ errors 12 of 24  3/s  0:04 left" in display.line().plain


@pytest.mark.timed
@given(
    workers=st.integers(1, 16),
    bursts=st.integers(21, 60),
    batch=st.integers(1, 20),
    start=st.floats(0.1, 30),
    cost=st.floats(1, 200),
    uneven=st.lists(st.floats(0.875, 1.125), min_size=60, max_size=60),
)
def test_the_time_left_is_right_within_a_factor_of_two_after_a_tenth(
    *, workers: int, bursts: int, batch: int, start: float, cost: float, uneven: list[float]
) -> None:
    """Workers start together, which takes as long as they like, then finish jobs of like cost.

    Of w workers that finish together, the first one's runs begin the count: after k rounds it has
    k w - 1 jobs in the time of k - 1 rounds, at most 3/2 of what is true from the third on. Costs
    of a round differ by up to an eighth from the usual, so that means differ by at most 9/7.
    """
    with pytest.MonkeyPatch.context() as patch:
        clock = Clock(patch)
        display, _ = shown()
        display.begin(bursts * workers * batch, 0)
        end = clock.now + start + sum(cost * each for each in uneven[:bursts])
        clock.now += start
        for burst in range(bursts - 1):
            clock.now += cost * uneven[burst]
            for _ in range(workers):
                display.advance(DONE[0] * batch)
            if burst + 1 >= max(3, bursts / 10):
                said = display.seconds_left()
                assert said is not None
                assert 0.5 <= said / (end - clock.now) <= 2


def test_setting_up_is_said_without_a_terminal(clock: Clock) -> None:
    display, out = shown(live=False)
    display.remind()
    assert out.getvalue() == ""
    clock.now += 11
    display.remind()
    display.remind()
    assert out.getvalue() == "compiling models, starting workers\n"
    display.begin(100, 0)
    clock.now += 11
    display.remind()
    assert out.getvalue().splitlines()[1:] == ["░" * 24 + " 0 of 100"]


def on_terminal(*command: str) -> tuple[bytes, bytes]:
    """Return what a command prints to a pipe, and what to a terminal, its stderr."""
    ours, theirs = os.openpty()
    line = [sys.executable, "-m", "contactlab", *command]
    able = os.environ | {"TERM": "xterm"}
    done = subprocess.run(line, stdout=subprocess.PIPE, stderr=theirs, env=able, check=False)
    os.close(theirs)
    with os.fdopen(ours, "rb") as screen:
        return done.stdout, screen.read1()


@pytest.mark.long
def test_a_terminal_says_at_once_that_a_command_works_and_keeps_nothing_of_it() -> None:
    """A slow command may print nothing for long."""
    shown, wiped = b"working\r", b"\x1b[K"
    missing = b"error: no store at nowhere; `contactlab sweep` writes one\r\n"
    assert on_terminal("verify", "nowhere") == (b"", shown + wiped + missing)
    assert on_terminal("show", "nowhere") == (b"", shown + wiped + missing)


@pytest.mark.long
def test_a_pipe_is_not_told_that_a_command_works() -> None:
    command = [sys.executable, "-m", "contactlab", "verify", "nowhere"]
    done = subprocess.run(command, capture_output=True, check=False)
    assert done.stderr == b"error: no store at nowhere; `contactlab sweep` writes one\n"


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(7, "0:07"), (65, "1:05"), (3 * 3600 + 5 * 60 + 9, "3:05:09"), (86_400 + 7200, "1 d 2 h")],
)
def test_the_time_that_is_left_is_read_as_a_clock(seconds: float, said: str) -> None:
    assert module._format_time(seconds) == said  # pyright: ignore[reportPrivateUsage]
