"""Runs with arrays in temporary files: the same evidence, and nothing left of the files."""

import resource
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy._core import multiarray

from contactlab.disk_arrays import arrays_on_disk, load_disk_memory
from contactlab.errors import OutputError
from contactlab.run import worker
from contactlab.store.verify_store import find_problems

# Contacts, a second pass, twins, and a drop that slots widen for.
SWEEPS = {
    "contacts": """
version: 1
scene: box_stack
duration: 0.05
checks: all
knife_edge: true
axes: {boxes: [2], timestep: [2.0e-3, 4.0e-3]}
""",
    "compact, driven": """
version: 1
scene: ball_drop
duration: 0.2
trace_format: compact
drive: exercise
checks: verdict
axes: {timestep: [1.0e-3], drop_height: [0.01]}
""",
}
LEAST = 1 << 13  # bytes of an array in a file


@pytest.fixture(autouse=True)
def _library() -> None:
    if isinstance(reason := load_disk_memory(), str):
        pytest.skip(reason)


def resident() -> int:
    """Return the bytes of files that this process has in memory."""
    shared = Path("/proc/self/statm").read_text().split()[2]
    return int(shared) * resource.getpagesize()


@pytest.mark.parametrize("name", SWEEPS)
def test_files_change_no_bit(sweeper: Any, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    sweeper.run(SWEEPS[name], "memory")
    folders = set[str]()

    def spied(*_: object) -> Any:
        folders.add(tempfile.gettempdir())
        return arrays_on_disk(LEAST)

    monkeypatch.setattr(worker, "LONG_BYTES", 0)
    monkeypatch.setattr(worker, "arrays_on_disk", spied)
    sweeper.run(SWEEPS[name], "files")
    assert folders
    assert sweeper.outcome("files") == sweeper.outcome("memory")
    # Reading them into files finds no difference either.
    with arrays_on_disk(LEAST):
        assert find_problems(sweeper.folder / "memory") == []


def test_large_arrays_lie_in_files_without_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing can be left of them, however the process ends; few of their pages are in memory."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    most, size = 8 << 20, 64 << 20
    before = resident()
    with arrays_on_disk(LEAST, most):
        large = np.ones(size // 8)
        doubled = large * 2
        names = {multiarray.get_handler_name(each) for each in (large, doubled)}
        assert names == {"contactlab_disk"}
        assert [*tmp_path.iterdir()] == []
        for _ in range(200):
            large += 1
            if resident() - before < size:
                break
        assert resident() - before < size
    assert multiarray.get_handler_name(np.ones(size // 8)) == "default_allocator"
    assert doubled.sum() == 2 * size // 8
    assert large.min() == large.max()
    maps = Path("/proc/self/maps").read_text()
    assert str(tmp_path) in maps
    del large, doubled
    assert str(tmp_path) not in Path("/proc/self/maps").read_text()


def test_arrays_may_grow_and_shrink() -> None:
    with arrays_on_disk(LEAST):
        for first, last in ((10, 5000), (5000, 10), (5000, 9000), (9000, 500)):
            array = np.arange(float(first))
            array.resize(last, refcheck=False)
            kept = min(first, last)
            assert array[:kept].tolist() == list(range(kept))
            assert not array[kept:].any()


def test_a_full_disk_ends_the_sweep_with_advice(
    sweeper: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No file may be longer than a page here, which is how a full disk looks to it."""
    monkeypatch.setattr(worker, "LONG_BYTES", 0)
    monkeypatch.setattr(worker, "arrays_on_disk", partial(arrays_on_disk, 1 << 16))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def run(*_: object, **__: object) -> Any:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 14, limits[1]))
        try:
            with arrays_on_disk(1 << 16):
                return np.ones(1 << 16)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)

    monkeypatch.setattr(worker.Worker, "_record_job", run)
    with pytest.raises(OutputError, match=r"files for the arrays.*TMPDIR"):
        sweeper.run(SWEEPS["contacts"])
