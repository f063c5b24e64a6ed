"""A disk that is full or read-only: a clear message, nothing half-written, and a way to go on."""

import errno
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import chdir
from pathlib import Path
from typing import Any

import pytest

from contactlab.run.tasks import FinishedRun
from contactlab.store.row_journal import encode_lines
from contactlab.store.verify_store import find_problems

SWEEP = """
version: 1
scene: ball_drop
duration: 0.3
seeds: 3
axes:
  timestep: [1.0e-3, 2.0e-3, 3.0e-3]
  drop_height: [0.02, 0.1]
"""
PAGE = 4096
FULL = f"{os.strerror(errno.ENOSPC)}; free some space and run the same command again; it resumes"


class Disk:
    """A file system of its own, in memory."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def mount(self, options: str) -> None:
        """Mount it, or change how it is mounted."""
        self._call("mount", "-t", "tmpfs", "-o", options, "tmpfs", str(self.path))

    def unmount(self) -> None:
        self._call("umount", "--lazy", str(self.path))

    def _call(self, name: str, *arguments: str) -> None:
        command = [shutil.which(name) or pytest.skip(f"there is no {name}"), *arguments]
        if os.geteuid() != 0:
            sudo = shutil.which("sudo") or pytest.skip("only root mounts, and there is no sudo")
            command = [sudo, "--non-interactive", *command]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            pytest.skip(f"{name} is not permitted here: {done.stderr.strip()}")


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    path = tmp_path / "disk"
    path.mkdir()
    disk = Disk(path)
    disk.mount(f"size=1m,uid={os.geteuid()}")
    yield disk
    disk.unmount()


class Quiet:
    """What comes of a sweep that nothing disturbs, and how much of a disk it takes."""

    def __init__(self, sweeper: Any, rule: str) -> None:
        self.journal = 0
        with chdir(sweeper.folder):
            sweeper.run(text_of(rule), progress=self._count)
        self.outcome = sweeper.outcome()
        store = sweeper.folder / "store"
        self.table = (store / "runs.parquet").stat().st_size
        self.begin = taken([store / "sweep.json", *(store / "scenes").rglob("*")])
        self.traces = taken((store / "traces").rglob("*.mcap"))

    def _count(self, finished: Sequence[FinishedRun]) -> None:
        lines = encode_lines([each.row for each in finished], finished[0].shared)
        self.journal += sum(map(len, lines))


def text_of(rule: str) -> str:
    return f"{SWEEP}trace: {rule}\n"


def taken(paths: Any) -> int:
    """Return the whole pages that files take."""
    return sum(-(-path.stat().st_size // PAGE) * PAGE for path in paths if path.is_file())


@pytest.fixture(scope="module", params=["all", "none"])
def rule(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def quiet(
    rule: str, tmp_path_factory: pytest.TempPathFactory, make_sweeper: Callable[[Path], Any]
) -> Quiet:
    return Quiet(make_sweeper(tmp_path_factory.mktemp("quiet")), rule)


@pytest.mark.night
@pytest.mark.parametrize("full", ["while it runs", "at its end"])
def test_a_full_disk(
    full: str, rule: str, quiet: Quiet, command: Any, disk: Disk, outcome: Any
) -> None:
    """Workers find it full with traces, the parent without, or when it makes the table."""
    runs = quiet.traces + quiet.journal
    room = quiet.begin + (runs // 2 if full == "while it runs" else runs + quiet.table // 2)
    disk.mount(f"remount,size={room}")
    (disk.path.parent / "small.yaml").write_text(text_of(rule))
    sweep = ("sweep", "small.yaml", "-o", "disk/store", "--workers", "2")
    code, out, err = command.run(*sweep)
    assert (code, out) == (2, "")
    running = r"(journal\.jsonl|traces/.*\.mcap)" if rule == "all" else r"journal\.jsonl"
    part = r"runs\.parquet" if full == "at its end" else running
    assert re.fullmatch(rf"error: cannot write (/.*)?disk/store/{part}: {FULL}.*\n", err)
    store = disk.path / "store"
    assert [*store.rglob("*.tmp"), *store.glob("manifest.json"), *store.glob("*.parquet")] == []
    assert command.run("verify", "disk/store")[0] == 3
    disk.mount("remount,size=16m")
    code, _, err = command.run(*sweep)
    assert (code, "runs are stored already" in err) == (0, True), err
    assert outcome(store) == quiet.outcome
    assert find_problems(store) == []


def refused(command: Any, tmp_path: Path, store: str) -> str:
    """Return what is said of a place that cannot be written, after checking that it is clear."""
    (tmp_path / "small.yaml").write_text(SWEEP)
    code, out, err = command.run("sweep", "small.yaml", "-o", store, "--workers", "2")
    assert (code, out, err.count("\n")) == (2, "", 1), err
    assert err.startswith(f"error: cannot write {store}")
    assert err.endswith("; choose another folder with -o\n")
    return err


@pytest.mark.night
def test_a_disk_that_is_read_only(command: Any, tmp_path: Path, disk: Disk) -> None:
    disk.mount("remount,ro")
    assert os.strerror(errno.EROFS) in refused(command, tmp_path, "disk/store")
    assert list(disk.path.iterdir()) == []


@pytest.mark.night
def test_a_store_that_became_read_only(
    command: Any, tmp_path: Path, disk: Disk, outcome: Any
) -> None:
    (tmp_path / "small.yaml").write_text(SWEEP)
    assert command.run("sweep", "small.yaml", "-o", "disk/store", "--workers", "0")[0] == 0
    before = outcome(disk.path / "store")
    disk.mount("remount,ro")
    refused(command, tmp_path, "disk/store")
    assert find_problems(disk.path / "store") == []
    assert outcome(disk.path / "store") == before


@pytest.mark.night
@pytest.mark.parametrize("place", ["file", "file/store", "/proc/store"])
def test_places_where_nobody_can_write(command: Any, tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("not a folder")
    refused(command, tmp_path, place)
    assert (tmp_path / "file").read_text() == "not a folder"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission(command: Any, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir(mode=0o555)
    assert os.strerror(errno.EACCES) in refused(command, tmp_path, "mine/store")
