"""SIGKILL at every write, rename, removal and new folder: equal afterwards, or a clear refusal.

A Python hook in a forked child counts what it does to files: audit events for opening, renaming,
removing and making, and each write in two halves, between which it can die. A power cut is such a
death after which files have lost what no sync had put on the disk: cut off, or replaced by zeros.
"""

import builtins
import io
import json
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from itertools import count
from pathlib import Path
from typing import Any, Self

import pytest

from contactlab.errors import StoreError
from contactlab.store import atomic_files, folder_backend
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems, write_baseline

TINY = "{version: 1, scene: ball_drop, duration: 0.02, axes: {timestep: [1.0e-3, 2.0e-3]}}"
REFINED = """
version: 1
scene: incline
duration: 0.02
axes:
  tilt: {linspace: [5, 45, 3]}
  friction.slide: {linspace: [0.1, 1.0, 3]}
refine: {axes: [tilt, friction.slide], to: 9, where: "slip_distance > 0.5 mm"}
"""
CHANGES = {"os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate"}


class Fuse:
    """Kills this process at the n-th change of a file below a folder."""

    def __init__(self, folder: Path, left: int) -> None:
        self._folder = str(folder)
        self._left = left
        self._open = io.open
        sys.addaudithook(self._hear)
        builtins.open = io.open = self._opened  # pyright: ignore[reportAttributeAccessIssue]
        atomic_files.FileIO = self._created  # pyright: ignore[reportPrivateImportUsage, reportAttributeAccessIssue]

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

    def _created(self, file: str, mode: str) -> Any:
        if not self.is_below(file):
            return io.FileIO(file, mode)
        self.burn()
        return HalfWriter(io.FileIO(file, mode), self)


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


def sizes_below(path: Path) -> dict[str, int]:
    """Return the sizes of a file, or of all files below a folder, by their inodes."""
    files = [path, *path.rglob("*")]
    return {str(each.stat().st_ino): each.stat().st_size for each in files if each.is_file()}


def note_syncs(note: Path) -> None:
    """Keep how much of each file this process has synced."""
    synced: dict[str, int] = {}

    def noting(sync: Callable[[Path], None]) -> Callable[[Path], None]:
        def both(path: Path) -> None:
            before = sizes_below(path)
            sync(path)
            synced.update(before)
            note.write_text(json.dumps(synced))

        return both

    atomic_files.sync_path = noting(atomic_files.sync_path)
    atomic_files.sync_filesystem = noting(atomic_files.sync_filesystem)
    folder_backend.sync_filesystem = atomic_files.sync_filesystem


def lose_unsynced(folder: Path, note: Path, *, zeros: bool) -> None:
    """Leave of each file what was synced; the rest is gone, or zeros."""
    synced = json.loads(note.read_text()) if note.exists() else {}
    for path in [each for each in folder.rglob("*") if each.is_file()]:
        status = path.stat()
        os.truncate(path, min(status.st_size, synced.get(str(status.st_ino), 0)))
        if zeros:
            os.truncate(path, status.st_size)


def refused(act: Callable[[], object]) -> str:
    """Return why an act is refused; nothing if it is not."""
    try:
        act()
    except StoreError as error:
        return str(error)
    return ""


def kills(
    folder: Path, act: Callable[[], object], changes: Iterable[int] | None = None
) -> Iterator[int]:
    """Do an act in a child that dies at its first change, then its second, until it gets through.

    Or at the changes that are given alone. Yields after each death.
    """
    for change in changes or count(1):
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


@pytest.mark.long
def test_a_sweep_killed_early_and_late_is_resumed(sweeper: Any) -> None:
    """At its identity and within the table; the next test kills at every write."""
    sweeper.run(TINY, "whole")
    whole, store = sweeper.outcome("whole"), sweeper.folder / "store"
    for killed in kills(store, lambda: sweeper.run(TINY), (4, 30)):
        sweeper.run(TINY)
        assert sweeper.outcome() == whole, killed
        assert find_problems(store) == [], killed
        shutil.rmtree(store)


@pytest.mark.long
def test_a_refined_sweep_killed_again_and_again_is_resumed(
    sweeper: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each goes on where the last died, within a round or between two."""
    monkeypatch.setattr("contactlab.run.planned_runs.MAX_RUNS", 4)
    sweeper.run(REFINED, "whole")
    store = sweeper.folder / "store"
    deaths = list(kills(store, lambda: sweeper.run(REFINED), (60, 40, 25, 50, 35, 10**6)))
    assert deaths == [60, 40, 25, 50, 35]
    assert sweeper.outcome() == sweeper.outcome("whole")
    assert find_problems(store) == []


@pytest.mark.night
def test_a_sweep_killed_at_every_write_is_resumed(sweeper: Any) -> None:
    sweeper.run(TINY, "whole")
    whole, store = sweeper.outcome("whole"), sweeper.folder / "store"
    killed = 0
    for killed in kills(store, lambda: sweeper.run(TINY)):
        sweeper.run(TINY)
        assert sweeper.outcome() == whole, killed
        assert find_problems(store) == [], killed
        shutil.rmtree(store)
    # Two runs: their traces, rows, the scene's files, identity, table and manifest.
    assert killed > 30


@pytest.mark.night
@pytest.mark.parametrize("zeros", [False, True])
def test_a_sweep_cut_off_from_power_at_every_write_is_resumed_or_repaired(
    sweeper: Any, tmp_path: Path, zeros: bool
) -> None:
    sweeper.run(TINY, "whole")
    whole, store, note = sweeper.outcome("whole"), sweeper.folder / "store", tmp_path / "synced"

    def act() -> None:
        note_syncs(note)
        sweeper.run(TINY)

    cut = 0
    for cut in kills(store, act):
        lose_unsynced(store, note, zeros=zeros)
        note.unlink(missing_ok=True)
        if refusal := refused(lambda: sweeper.run(TINY)):
            assert "--repair" in refusal, cut
            sweeper.run(TINY, repair=True)
        assert sweeper.outcome() == whole, cut
        assert find_problems(store) == [], cut
        shutil.rmtree(store)
    assert cut > 30


@pytest.mark.night
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
        assert find_problems(store) == [], killed
        shutil.rmtree(store)
        shutil.copytree(begun, store)
    assert killed > 20


@pytest.mark.night
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
        assert find_problems(target) == [], killed
        write_baseline(tmp_path / "new", target)
        assert [path.name for path in beside.iterdir()] == ["tiny"], killed
        shutil.rmtree(beside)
        shutil.copytree(kept, beside)
    assert len(seen) == 2
    assert old in seen
