"""A store's life with a fault at each of its writes: nothing is lost, and nothing stays half.

A point is one call that changes what is stored: to open a file for writing, to write, flush or
close it, to sync, rename or remove it, to make a folder; in a bucket, to put, create or delete an
object. At each, the call fails once, or it and all that follow do, as in a process that is killed.
"""

import errno
import os
import pathlib
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Self

import pytest

import contactlab
from contactlab.errors import ContactlabError
from contactlab.store import atomic_files, folder_backend
from contactlab.store.finished_store import Store
from contactlab.store.objects.client import ObjectClient
from contactlab.store.verify_store import verify

SWEEP: dict[str, Any] = {
    "version": 1,
    "scene": "ball_drop",
    "duration": 0.005,
    "checks": "none",
    "axes": {"timestep": [1e-3, 2e-3]},
}
SYNCS = {"sync_path", "sync_filesystem"}
AUDITED = {"os.rename", "os.remove", "os.mkdir", "os.rmdir"}
STORED = ("put", "create", "delete")


class Killed(BaseException):
    """Ends a process at a point."""


class Points:
    """Counts the points of a store's life, and fails at one of them."""

    def __init__(self) -> None:
        self.place, self.reached = "", 0
        self._at, self._kill = -1, False

    def begin(self, place: str, at: int = -1, *, kill: bool = False) -> None:
        """Watch what is below a place; fail at a point, or at none."""
        self.place, self.reached, self._at, self._kill = place, 0, at, kill

    def end(self) -> int:
        """Watch no longer; return how many points were reached."""
        self.place = ""
        return self.reached

    def pass_by(self, path: object) -> None:
        """Note that something is about to be written."""
        if not self.place or self.place not in os.fsdecode(str(path)):
            return
        self.reached += 1
        over = self.reached - 1 - self._at
        if self._at < 0 or over < 0 or (over and not self._kill):
            return
        if self._kill:
            raise Killed
        raise OSError(errno.EIO, os.strerror(errno.EIO), str(path))


POINTS = Points()
_audited: list[bool] = []


def audit(event: str, arguments: tuple[Any, ...]) -> None:
    if POINTS.place and event in AUDITED:
        POINTS.pass_by(arguments[0])


class Written:
    """A file that is written, each call of which is a point."""

    def __init__(self, file: Any, path: Path) -> None:
        self._file, self._path = file, path

    def __getattr__(self, name: str) -> Any:
        if name in {"write", "writelines", "flush"}:
            POINTS.pass_by(self._path)
        return getattr(self._file, name)

    def close(self) -> None:
        self._file.close()
        POINTS.pass_by(self._path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def watched(call: Callable[..., Any], path_of: Callable[..., object]) -> Callable[..., Any]:
    """Return a call that is a point."""

    def watch(*arguments: Any, **options: Any) -> Any:
        POINTS.pass_by(path_of(*arguments))
        return call(*arguments, **options)

    return watch


def opening(opened: Callable[..., Any]) -> Callable[..., Any]:
    """Return what opens files by their paths, where writing to a store is a point."""

    def open_one(path: Path, mode: str = "r", *arguments: Any, **options: Any) -> Any:
        if not {*mode} & {*"wax"} or not POINTS.place or POINTS.place not in str(path):
            return opened(path, mode, *arguments, **options)
        POINTS.pass_by(path)
        return Written(opened(path, mode, *arguments, **options), path)

    return open_one


@pytest.fixture
def points(monkeypatch: pytest.MonkeyPatch) -> Iterator[Points]:
    if not _audited:
        sys.addaudithook(audit)
        _audited.append(True)
    file_io = atomic_files.FileIO

    def write_file(path: str, mode: str) -> Any:
        POINTS.pass_by(path)
        return Written(file_io(path, mode), Path(path))

    monkeypatch.setattr(pathlib.Path, "open", opening(pathlib.Path.open))
    monkeypatch.setattr(atomic_files, "FileIO", write_file)
    for module in (atomic_files, folder_backend):
        for name in vars(module).keys() & SYNCS:
            sync = getattr(module, name)
            monkeypatch.setattr(module, name, watched(sync, lambda path: path))
    for name in STORED:
        call = getattr(ObjectClient, name)
        stored = watched(call, lambda client, *_: f"{client.address}/")
        monkeypatch.setattr(ObjectClient, name, stored)
    yield POINTS
    POINTS.end()


def live(place: str) -> None:
    """Make a shard, and fill it up."""
    contactlab.sweep(SWEEP, output=place, workers=0, shard="1/2")
    contactlab.sweep(SWEEP, output=place, workers=0)


def tried(
    points: Points, place: Callable[[int], str], clear: Callable[[str], None], stride: int = 1
) -> int:
    """Fail at points in turn, by an error and by a kill, then go on; return how many faults."""
    count = 0
    points.begin(place(0))
    live(place(0))
    total, physics = points.end(), Store.open(place(0)).physics
    assert total > 20
    for kill in (False, True):
        for point in range(stride // 2, total, stride):
            where = place(count := count + 1)
            points.begin(where, point, kill=kill)
            try:
                live(where)
            except (ContactlabError, OSError, Killed):
                pass
            finally:
                points.end()
            contactlab.sweep(SWEEP, output=where, workers=0)
            assert not verify(Store.open(where).address), (kill, point)
            assert Store.open(where).physics == physics, (kill, point)
            clear(where)
    return count


@pytest.mark.long
def test_a_folder_outlives_a_fault_at_some_writes(points: Points, tmp_path: Path) -> None:
    place = "store-{}-"
    assert tried(points, lambda number: str(tmp_path / place.format(number)), shutil.rmtree, 17)


@pytest.mark.night
def test_a_folder_outlives_a_fault_at_each_write(points: Points, tmp_path: Path) -> None:
    count = tried(points, lambda number: str(tmp_path / f"store-{number}-"), shutil.rmtree)

    assert count > 50


@pytest.mark.night
def test_a_bucket_outlives_a_fault_at_each_write(points: Points, bucket: str) -> None:
    count = tried(points, lambda number: f"{bucket}/store-{number}-", lambda _: None)

    assert count > 20
