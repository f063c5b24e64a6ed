"""SIGKILL at every write, rename, removal and new folder: equal afterwards, or a clear refusal.

A Python hook in a forked child counts what it does to files: audit events for opening, renaming,
removing and making, and each write in two halves, between which it can die.
"""

import builtins
import io
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any, Self

import pytest

from contactlab.store.baseline_store import write_baseline
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import verify

TINY = "{version: 1, scene: ball_drop, duration: 0.02, axes: {timestep: [1.0e-3, 2.0e-3]}}"
CHANGES = {"os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate"}


class Fuse:
    """Kills this process at the n-th change of a file below a folder."""

    def __init__(self, folder: Path, left: int) -> None:
        self._folder = str(folder)
        self._left = left
        self._open = io.open
        sys.addaudithook(self._hear)
        builtins.open = io.open = self._opened  # pyright: ignore[reportAttributeAccessIssue]

    def burn(self) -> None:
        self._left -= 1
        if self._left == 0:
            os.kill(os.getpid(), signal.SIGKILL)

    def is_below(self, path: object) -> bool:
        return isinstance(path, str | bytes | Path) and os.fsdecode(path).startswith(self._folder)

    def _hear(self, event: str, given: tuple[Any, ...]) -> None:
        if event in CHANGES and self.is_below(given[0]):
            self.burn()

    def _opened(self, file: Any, mode: str = "r", *more: Any, **rest: Any) -> Any:
        if not self.is_below(file) or not set(mode) & set("wa"):
            return self._open(file, mode, *more, **rest)
        self.burn()
        return HalfWriter(self._open(file, mode, *more, **rest), self)


class HalfWriter:
    """A file whose writes can end in the middle."""

    def __init__(self, file: Any, fuse: Fuse) -> None:
        self._file, self._fuse = file, fuse

    def write(self, data: Any) -> int:
        middle = len(data) // 2
        self._file.write(data[:middle])
        self._file.flush()
        self._fuse.burn()
        self._file.write(data[middle:])
        self._file.flush()
        self._fuse.burn()
        return len(data)

    def writelines(self, lines: Any) -> None:
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()


def kills(folder: Path, act: Callable[[], object]) -> Iterator[int]:
    """Do an act in a child that dies at its first change, then its second, until it gets through.

    Yields after each death.
    """
    for change in count(1):
        child = os.fork()
        if child == 0:
            Fuse(folder, change)
            try:
                act()
            finally:
                os._exit(0)
        _, status = os.waitpid(child, 0)
        if not os.WIFSIGNALED(status):
            assert status == 0
            return
        assert os.WTERMSIG(status) == signal.SIGKILL
        yield change


@pytest.mark.slow
def test_a_sweep_killed_at_every_write_is_resumed(sweeper: Any) -> None:
    sweeper.run(TINY, "whole")
    whole, store = sweeper.outcome("whole"), sweeper.folder / "store"
    killed = 0
    for killed in kills(store, lambda: sweeper.run(TINY)):
        sweeper.run(TINY)
        assert sweeper.outcome() == whole, killed
        assert verify(store) == [], killed
        shutil.rmtree(store)
    # Two runs: their traces, rows, the scene's files, identity, table and manifest.
    assert killed > 40


@pytest.mark.slow
def test_a_resumed_sweep_killed_at_every_write_is_resumed(
    sweeper: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("contactlab.run.planned_runs.MAX_RUNS", 1)
    sweeper.run(TINY, "whole")
    whole, store = sweeper.outcome("whole"), sweeper.folder / "store"

    def stop(_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweeper.run(TINY, progress=stop)
    with (store / "journal.jsonl").open("ab") as journal:
        journal.write(b'{"run_id":')
    shutil.copytree(store, begun := sweeper.folder / "begun")
    killed = 0
    for killed in kills(store, lambda: sweeper.run(TINY)):
        sweeper.run(TINY)
        assert sweeper.outcome() == whole, killed
        assert verify(store) == [], killed
        shutil.rmtree(store)
        shutil.copytree(begun, store)
    assert killed > 20


@pytest.mark.slow
def test_a_baseline_killed_at_every_write_is_the_old_or_the_new(
    sweeper: Any, tmp_path: Path
) -> None:
    sweeper.run(TINY, "old")
    sweeper.run(TINY.replace("0.02", "0.03"), "new")
    beside = tmp_path / "baselines"
    target = beside / "tiny"
    old = write_baseline(tmp_path / "old", target).digest
    shutil.copytree(beside, kept := tmp_path / "kept")
    seen: set[str] = set()
    for killed in kills(beside, lambda: write_baseline(tmp_path / "new", target)):
        seen.add(Store.open(target).digest)
        assert verify(target) == [], killed
        write_baseline(tmp_path / "new", target)
        assert [path.name for path in beside.iterdir()] == ["tiny"], killed
        shutil.rmtree(beside)
        shutil.copytree(kept, beside)
    assert len(seen) == 2
    assert old in seen
