"""A wall clock that jumps by hours changes no result and ends no run."""

import os
import pty
import re
import shutil
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.store.verify_store import find_problems

SWEEP = """
version: 1
scene: ball_drop
duration: 0.3
seeds: 8
timeout: 30
axes:
  timestep: [1.0e-3, 2.0e-3, 3.0e-3]
  drop_height: [0.02, 0.1]
"""
# Put before the C library, so that it is what every process, thread and library asks. Every 50 ms
# of true time the wall clock is an hour late, then an hour early.
CLOCK = """
#define _GNU_SOURCE
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

int clock_gettime(clockid_t clock, struct timespec *now) {
    int failed = syscall(SYS_clock_gettime, clock, now);
    if (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE) {
        struct timespec steady;
        syscall(SYS_clock_gettime, CLOCK_MONOTONIC, &steady);
        now->tv_sec += steady.tv_nsec / 50000000 % 2 ? 3600 : -3600;
    }
    return failed;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone) {
    struct timespec exact;
    clock_gettime(CLOCK_REALTIME, &exact);
    now->tv_sec = exact.tv_sec;
    now->tv_usec = exact.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *now) {
    struct timespec exact;
    clock_gettime(CLOCK_REALTIME, &exact);
    if (now) *now = exact.tv_sec;
    return exact.tv_sec;
}
"""
# Says that the clock did jump in this process.
WITNESS = """
import os, time
before, begin = time.time(), time.monotonic()
while time.monotonic() - begin < 1 and abs(time.time() - before) < 3000:
    pass
if abs(time.time() - before) > 3000:
    open(f"{os.path.dirname(__file__)}/jumped-{os.getpid()}", "w").close()
"""


@pytest.fixture(scope="module")
def jumping(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the library that makes the clock jump."""
    compiler = shutil.which("cc") or pytest.skip("needs a C compiler, to stand in for the clock")
    folder = tmp_path_factory.mktemp("clock")
    (folder / "clock.c").write_text(CLOCK)
    library = str(folder / "clock.so")
    subprocess.run(
        [compiler, "-shared", "-fPIC", "-O1", "-o", library, str(folder / "clock.c")], check=True
    )
    return library


@pytest.fixture
def watched(command: Any, tmp_path: Path) -> Callable[[], tuple[int, str]]:
    """Return what runs the sweep on a terminal; it returns exit code and what was shown."""
    (tmp_path / "small.yaml").write_text(SWEEP)

    def run() -> tuple[int, str]:
        ours, theirs = pty.openpty()
        shown: list[bytes] = []

        def read() -> None:
            try:
                while part := os.read(ours, 1 << 16):
                    shown.append(part)
            except OSError:
                return  # as a terminal says that nobody writes any more

        reader = threading.Thread(target=read)
        process = command.start(
            *("sweep", "small.yaml", "-o", "store", "--workers", "2"),
            first=tmp_path,
            stderr=theirs,
        )
        os.close(theirs)
        reader.start()
        process.communicate(timeout=120)
        reader.join()
        os.close(ours)
        return process.returncode, b"".join(shown).decode()

    return run


@pytest.mark.night
def test_a_clock_that_jumps(
    watched: Any, jumping: str, sweeper: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LD_PRELOAD", jumping)
    (tmp_path / "sitecustomize.py").write_text(WITNESS)
    code, shown = watched()
    monkeypatch.delenv("LD_PRELOAD")
    assert code == 0, shown
    assert list(tmp_path.glob("jumped-*"))
    sweeper.run(SWEEP, "quiet")
    assert sweeper.outcome() == sweeper.outcome("quiet")
    assert find_problems(tmp_path / "store") == []
    lines = [line for line in re.split(r"[\r\n]|\x1b\[[0-9;?]*[A-Za-z]", shown) if " of 48" in line]
    assert lines
    # A sweep of less than a second shows no rate yet; tests/commands/test_progress.py has rates.
    for line in lines:
        assert "-" not in line
        # Neither an hour's worth of time left for a second of work nor a rate beyond reason.
        assert not re.search(r"\d:\d\d:\d\d left", line)
