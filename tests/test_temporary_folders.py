"""Temporary folders: removed at the end, and after a kill by the next process."""

import os
import subprocess
import sys
import time
from pathlib import Path

from contactlab.temporary_folders import make_locked_folder, remove_left_folders

MADE = "from contactlab.temporary_folders import temporary_folder as f; t = f(); print(t.name)"


def started(place: Path, end: str) -> "subprocess.Popen[str]":
    """Return a process that makes a temporary folder below a place, and then runs a statement."""
    return subprocess.Popen(
        [sys.executable, "-c", f"{MADE}; import os, sys; sys.stdout.flush(); {end}"],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"TMPDIR": str(place)},
    )


def test_the_folder_of_a_process_goes_with_it_and_that_of_a_killed_one_later(
    tmp_path: Path,
) -> None:
    with started(tmp_path, "pass") as ended:
        assert ended.wait() == 0
    assert list(tmp_path.iterdir()) == []

    waiting = "import time; time.sleep(60)"
    with started(tmp_path, waiting) as killed, started(tmp_path, waiting) as living:
        places = []
        for process in (killed, living):
            assert process.stdout is not None
            places.append(Path(process.stdout.readline().strip()).parent)
        killed.kill()
        killed.wait()
        kept = tmp_path / "contactlab-notes"  # without a lock, of somebody else
        kept.mkdir()

        remove_left_folders(tmp_path)
        assert set(tmp_path.iterdir()) == {*places, kept}, "they are new"
        hours_ago = time.time() - 7200
        for place in (*places, kept):
            os.utime(place, (hours_ago, hours_ago))
        remove_left_folders(tmp_path)
        assert set(tmp_path.iterdir()) == {places[1], kept}
        living.kill()


def test_a_folder_beside_a_store_goes_with_the_next_of_its_kind(tmp_path: Path) -> None:
    """Such as that of tasks on SLURM, after a kill."""
    code = (
        "import os; from pathlib import Path; "
        "from contactlab.temporary_folders import make_locked_folder; "
        f"print(make_locked_folder(Path({str(tmp_path)!r}), '.tasks-'), flush=True); os._exit(0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    left = Path(done.stdout.strip())
    living, other = make_locked_folder(tmp_path, ".tasks-"), tmp_path / ".tasks-of-another"
    other.mkdir()
    hours_ago = time.time() - 7200
    for place in (left, living, other):
        os.utime(place, (hours_ago, hours_ago))
    kept = {left, living, other, make_locked_folder(tmp_path, ".tasks-", least_age=10_000)}
    assert set(tmp_path.iterdir()) == kept
    new = make_locked_folder(tmp_path, ".tasks-")
    assert set(tmp_path.iterdir()) == kept - {left} | {new}
