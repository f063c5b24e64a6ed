"""Signals that end a sweep are a wish at first, and an order where nobody heeds wishes."""

import signal
import subprocess
import sys
import threading

import pytest

from contactlab.command_line.terminal import stop_on_signals
from contactlab.run.tasks import Stop

SAID = "finishing the current runs; interrupt again to stop at once\n"
NUMBERS = (signal.SIGINT, signal.SIGTERM)


@pytest.mark.parametrize("first", NUMBERS)
@pytest.mark.parametrize("second", NUMBERS)
def test_the_first_is_a_wish_and_the_second_an_order(
    first: signal.Signals, second: signal.Signals, capfd: pytest.CaptureFixture[str]
) -> None:
    stop = Stop()
    with stop_on_signals(stop):
        with stop.watch_runs():
            signal.raise_signal(first)
            assert stop.is_set
            assert capfd.readouterr().err == SAID
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(second)
        assert capfd.readouterr().err == ""


@pytest.mark.parametrize("number", NUMBERS)
def test_it_is_an_order_where_no_runs_are_under_way(number: signal.Signals) -> None:
    stop = Stop()
    with stop_on_signals(stop), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)
    with stop.watch_runs():
        pass
    with stop_on_signals(stop), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)


class Finalized:
    """Hears a signal where Python drops exceptions."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_order_that_gets_lost_stays_a_wish() -> None:
    stop = Stop()
    with stop_on_signals(stop):
        Finalized()
    assert stop.is_set


def test_all_is_as_before_in_the_end() -> None:
    before = [signal.getsignal(number) for number in NUMBERS]
    with stop_on_signals(Stop()):
        assert [signal.getsignal(number) for number in NUMBERS] != before
    assert [signal.getsignal(number) for number in NUMBERS] == before


def test_what_is_ignored_stays_so() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with stop_on_signals(Stop()):
            signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_other_threads_hear_nothing() -> None:
    before = [signal.getsignal(number) for number in NUMBERS]
    found: list[object] = []

    def run() -> None:
        with stop_on_signals(Stop()):
            found.extend(signal.getsignal(number) for number in NUMBERS)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert found == before


# As a signal that comes while the main thread is writing, which may not be begun twice.
WRITING = """
import io, os, signal, sys
from contactlab.command_line.terminal import stop_on_signals
from contactlab.run.tasks import Stop

class Interrupted(io.RawIOBase):
    def writable(self):
        return True

    def write(self, data):
        signal.raise_signal(signal.SIGTERM)
        return os.write(2, data)

stop = Stop()
sys.stderr = io.TextIOWrapper(io.BufferedWriter(Interrupted()), write_through=True)
with stop_on_signals(stop), stop.watch_runs():
    sys.stderr.write("progress\\n")
    sys.stderr.flush()
assert stop.is_set
"""


@pytest.mark.long
def test_it_may_come_while_something_is_written() -> None:
    done = subprocess.run(
        [sys.executable, "-c", WRITING], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, SAID + "progress\n")


@pytest.mark.parametrize(
    "error", ["MemoryError()", 'ValueError("Error: engine error: Could not allocate memory")']
)
def test_a_machine_without_memory_is_told_of_in_a_line(error: str) -> None:
    code = f"""
from contactlab.command_line import main
def run(words): raise {error}
main._run_words = run
from contactlab.__main__ import main
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "error: out of memory; free some, or raise its limit (ulimit -v)\n"
