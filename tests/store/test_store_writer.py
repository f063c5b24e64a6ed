"""A store is written whole or stays resumable; what is not its own it leaves alone."""

import errno
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from contactlab.errors import OutputError, StoreError
from contactlab.schema.evidence import StoreManifest, SweepIdentity
from contactlab.store import atomic_files
from contactlab.store.atomic_files import GroupCommit, atomic_write, target_name, write_error
from contactlab.store.store_writer import StoreWriter, open_writer
from contactlab.store.table_layout import record_to_row

IdentityOf = Callable[..., SweepIdentity]

FREE = "free some space and run the same command again; it resumes where it stopped"
ELSEWHERE = "choose another folder with -o"
HOLD = """
import fcntl, sys
lock = open(sys.argv[1], "a")
fcntl.flock(lock, fcntl.LOCK_EX)
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def full_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 64 kB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("only root may mount a small disk")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_new_store_then_a_finished_one(
    tmp_path: Path, store: Path, identity_of: IdentityOf, scene_file: Any
) -> None:
    with open_writer(tmp_path / "new", identity_of(3), scene_file, fresh=False) as writer:
        assert isinstance(writer, StoreWriter)
        assert writer.done == frozenset()
    with open_writer(store, identity_of(3), scene_file, fresh=False) as finished:
        assert isinstance(finished, StoreManifest)
    with open_writer(store, identity_of(3), scene_file, fresh=True) as writer:
        assert isinstance(writer, StoreWriter)
        assert sorted(path.name for path in store.iterdir()) == [
            *(".lock", "journal.jsonl", "scenes", "sweep.json", "traces")
        ]


@pytest.mark.parametrize("finished", [True, False])
@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"plan_hash": "c"}, "runs"),
        ({"name": "other", "runs_asked": 9}, "name, number of runs"),
        ({"metric_versions": {"depth": 2, "gain": 1}}, "versions of metrics"),
    ],
)
def test_a_store_of_another_sweep(
    store: Path,
    identity_of: IdentityOf,
    scene_file: Any,
    finished: bool,
    change: dict[str, object],
    named: str,
) -> None:
    if not finished:
        (store / "manifest.json").unlink()
    message = rf"holds another sweep \(other {named}\); write elsewhere with -o, or .* --fresh"
    with (
        pytest.raises(StoreError, match=message),
        open_writer(store, identity_of(3, **change), scene_file, fresh=False),
    ):
        pass
    assert (store / "runs.parquet").exists()


def test_comments_of_the_sweep_file_may_change(
    store: Path, identity_of: IdentityOf, scene_file: Any
) -> None:
    changed = identity_of(3, source="# better explained\nversion: 1\n")
    with open_writer(store, changed, scene_file, fresh=False) as finished:
        assert isinstance(finished, StoreManifest)


@pytest.mark.parametrize("fresh", [True, False])
@pytest.mark.parametrize("name", ["thesis.tex", "notes.tmp"])
def test_a_folder_with_other_files(
    tmp_path: Path, identity_of: IdentityOf, scene_file: Any, fresh: bool, name: str
) -> None:
    (tmp_path / name).write_text("mine")
    with (
        pytest.raises(OutputError, match=rf"holds other files \({name}\)"),
        open_writer(tmp_path, identity_of(3), scene_file, fresh=fresh),
    ):
        pass
    assert (tmp_path / name).read_text() == "mine"


def test_files_that_joined_a_store_stay(
    store: Path, identity_of: IdentityOf, scene_file: Any
) -> None:
    (store / "manifest.json").unlink()
    (store / "notes.tmp").write_text("mine")
    with open_writer(store, identity_of(3), scene_file, fresh=False):
        pass
    assert (store / "notes.tmp").read_text() == "mine"


def test_one_sweep_at_a_time(store: Path, identity_of: IdentityOf, scene_file: Any) -> None:
    with open_writer(store, identity_of(3), scene_file, fresh=False):
        with (
            pytest.raises(OutputError, match="is in use by another sweep; wait or use -o"),
            open_writer(store, identity_of(3), scene_file, fresh=True),
        ):
            pass
        assert (store / "manifest.json").exists()


def test_the_lock_goes_with_its_process(
    store: Path, identity_of: IdentityOf, scene_file: Any
) -> None:
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(store / ".lock")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert holder.stdout
    assert holder.stdout.readline() == b"held\n"
    with (
        pytest.raises(OutputError, match="in use"),
        open_writer(store, identity_of(3), scene_file, fresh=False),
    ):
        pass
    holder.kill()
    holder.communicate()
    with open_writer(store, identity_of(3), scene_file, fresh=False) as finished:
        assert isinstance(finished, StoreManifest)


@pytest.mark.parametrize("below", ["", "store"])
def test_a_file_in_the_way(
    tmp_path: Path, identity_of: IdentityOf, scene_file: Any, below: str
) -> None:
    (tmp_path / "file").write_text("mine")
    with (
        pytest.raises(OutputError, match=r"^cannot write .*file.*; choose another folder with -o$"),
        open_writer(tmp_path / "file" / below, identity_of(3), scene_file, fresh=False),
    ):
        pass


def test_a_folder_that_nobody_can_write(identity_of: IdentityOf, scene_file: Any) -> None:
    with (
        pytest.raises(OutputError, match=r"^cannot write /proc/store: .*; choose another folder"),
        open_writer(Path("/proc/store"), identity_of(3), scene_file, fresh=False),
    ):
        pass


def test_a_full_disk_in_the_journal(
    full_disk: Path, identity_of: IdentityOf, scene_file: Any, record_of: Any
) -> None:
    path, ballast = full_disk / "store", full_disk / "ballast"
    ballast.write_bytes(bytes(40_000))
    rows = [json.dumps(record_to_row(record_of(number))).encode() for number in range(100)]
    message = r"^cannot write .*journal\.jsonl: No space left on device; free some space and run"

    def fill() -> None:
        with open_writer(path, identity_of(3), scene_file, fresh=False) as writer:
            assert isinstance(writer, StoreWriter)
            for row in rows:
                writer.append_rows([row])

    with pytest.raises(OutputError, match=message):
        fill()
    ballast.unlink()
    with open_writer(path, identity_of(3), scene_file, fresh=False) as writer:
        assert isinstance(writer, StoreWriter)
        ids = [record_of(number).run_id for number in range(100)]
        assert set(ids[:3]) <= writer.done < set(ids)


def test_a_full_disk_under_a_file(full_disk: Path) -> None:
    target = full_disk / "file"
    target.write_text("before")
    with (
        pytest.raises(OutputError, match="No space left on device"),
        atomic_write(target) as temporary,
    ):
        temporary.write_bytes(bytes(100_000))
    assert [path.name for path in full_disk.iterdir()] == ["file"]
    assert target.read_text() == "before"


def test_a_failure_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    target = tmp_path / "file"
    target.write_text("before")

    def fail() -> None:
        with atomic_write(target) as temporary:
            temporary.write_text("half")
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert [path.read_text() for path in tmp_path.iterdir()] == ["before"]


def test_where_nothing_can_be_written_or_removed_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a file system that is read only, removing what was never made fails too."""

    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    for name in ("write_text", "unlink"):
        monkeypatch.setattr(Path, name, refuse)
    target = tmp_path / "file"
    with (
        pytest.raises(OutputError, match=r"cannot write .*file: Read-only file system"),
        atomic_write(target) as temporary,
    ):
        temporary.write_text("new")


def test_a_time_limit_of_the_caller_is_no_fault_of_the_file(
    tmp_path: Path, identity_of: IdentityOf, scene_file: Any
) -> None:
    """Python's own error has no number of the system's; that of a network's file does."""

    def end() -> None:
        raise TimeoutError

    with pytest.raises(TimeoutError), atomic_write(tmp_path / "file"):
        end()
    with (
        pytest.raises(TimeoutError),
        open_writer(tmp_path / "store", identity_of(3), scene_file, fresh=False),
    ):
        end()
    with (
        pytest.raises(OutputError, match=r"cannot write .*file: Connection timed out"),
        atomic_write(tmp_path / "file"),
    ):
        raise OSError(errno.ETIMEDOUT, os.strerror(errno.ETIMEDOUT))


def test_two_writers_of_one_file_do_not_share_what_they_write(tmp_path: Path) -> None:
    target = tmp_path / "file"
    with atomic_write(target) as first:
        first.write_text("first, longer")
        with atomic_write(target) as second:
            second.write_text("second")
        assert target.read_text() == "second"
    assert target.read_text() == "first, longer"
    assert [target_name(path.name) for path in (first, second)] == ["file", "file"]
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.long
def test_many_changes_are_synced_together_and_all_of_them_by_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    changes, seen = 0, list[int]()
    monkeypatch.setattr(atomic_files, "sync_filesystem", lambda _: seen.append(changes))
    commit = GroupCommit(tmp_path)
    while len(seen) < 2:
        changes += 1
        commit.request_sync()
    assert len(seen) < changes / 10
    changes += 1
    commit.request_sync()
    commit.close()
    assert seen[-1] == changes


def test_a_change_that_cannot_be_synced_ends_the_sweep(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: Path) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(atomic_files, "sync_filesystem", fail)
    commit = GroupCommit(tmp_path)
    commit.request_sync()
    with pytest.raises(OutputError, match="Input/output error"):
        commit.close()


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), f"No space left on device; {FREE}"),
        (OSError(errno.EDQUOT, "Disk quota exceeded"), f"Disk quota exceeded; {FREE}"),
        (OSError(errno.EACCES, "Permission denied"), f"Permission denied; {ELSEWHERE}"),
        (OSError("odd"), f"odd; {ELSEWHERE}"),
    ],
)
def test_messages_say_what_to_do(error: OSError, message: str) -> None:
    assert str(write_error(Path("x"), error)) == f"cannot write x: {message}"
