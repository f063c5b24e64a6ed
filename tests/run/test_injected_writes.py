"""A store's life with a fault at each of its writes: nothing is lost, and nothing stays half."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
FOLDER_LIVES = ("sweep", "graded", "torn", "repaired", "merge", "baseline")
BUCKET_LIVES = ("sweep", "graded", "merge")
Faults = list[dict[str, Any]]


@pytest.fixture(scope="session")
def failing_calls(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library of `failing_calls.c`."""
    compiler = shutil.which("cc") or pytest.skip("there is no C compiler")
    library = tmp_path_factory.mktemp("preloaded") / "failing_calls.so"
    source = Path(__file__).with_name("failing_calls.c")
    subprocess.run(
        [compiler, "-shared", "-fPIC", "-Wall", "-Werror", "-o", library, source, "-ldl"],
        check=True,
    )
    return library


@pytest.fixture
def faults(failing_calls: Path) -> Callable[[str, int, str], Faults]:
    """Return what comes of faults at every so many-th point of a life."""

    def tried(life: str, stride: int, where: str) -> Faults:
        command = [sys.executable, "-m", "tests.run.faults_at_writes", life, str(stride), where]
        environment = os.environ | ({} if "://" in where else {"LD_PRELOAD": str(failing_calls)})
        done = subprocess.run(
            command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr[-3000:]
        sys.stdout.write(done.stderr)
        return [json.loads(line) for line in done.stdout.splitlines()]

    return tried


def check(found: Faults, least: int) -> None:
    """Check that all faults held, and that there were enough, of which some were noticed."""
    wrong = [fault for fault in found if fault["wrong"]]
    assert not wrong, json.dumps(wrong[:3], indent=1)
    assert len(found) >= least
    assert {fault["ended"] for fault in found} >= {"refused", "killed"}


@pytest.mark.long
def test_a_folder_outlives_a_fault_at_some_writes(faults: Any, tmp_path: Path) -> None:
    check(faults("sweep", 40, str(tmp_path)), 6)


@pytest.mark.night
@pytest.mark.parametrize("life", FOLDER_LIVES)
def test_a_folder_outlives_a_fault_at_each_write(faults: Any, tmp_path: Path, life: str) -> None:
    check(faults(life, 1, str(tmp_path)), 60)


@pytest.mark.long
def test_a_bucket_outlives_a_fault_at_some_requests(faults: Any, bucket: str) -> None:
    check(faults("sweep", 34, bucket), 3)


@pytest.mark.night
@pytest.mark.parametrize("life", BUCKET_LIVES)
def test_a_bucket_outlives_a_fault_at_each_request(faults: Any, bucket: str, life: str) -> None:
    check(faults(life, 1, bucket), 30)
