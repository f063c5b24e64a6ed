"""A seeded sample of `make attack`: bent stores are found out, bent files are read or refused."""

from pathlib import Path

import pytest
from tests.attack.attack import OUTCOMES, attack
from tests.attack.bent_commands import bend_files
from tests.attack.fuzz import fuzz
from tests.attack.mutations import CONTENT, FILES
from tests.attack.readers import Reader, readers

NAMES = (
    "sweep",
    "scene",
    "model",
    "policy",
    "manifest",
    "identity",
    "trace",
    "trace with checksums",
    "compact trace with checksums",
    "table",
    "drive csv",
    "drive npz",
    "drive parquet",
    "drive arrow",
    "drive mcap",
    "journal",
    "journal with checksums",
)


@pytest.mark.night
def test_no_bent_store_is_sound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    # All of a store with each of three drives; most of a baseline and of an unfinished store.
    count = 5 * (2 * len(FILES) + 4 * len(CONTENT)) - 40
    found = attack(tmp_path, count, seed=7)
    assert sum(found.counts.values()) == count
    assert set(found.counts) <= set(OUTCOMES[:6]), found.cases
    assert found.counts["detected"] > 0.7 * count


@pytest.mark.long
def test_some_bent_stores(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found = attack(tmp_path, 12, seed=8)
    assert set(found.counts) <= set(OUTCOMES[:5]), found.cases


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Reader]:
    found = readers(tmp_path_factory.mktemp("readers"))
    assert tuple(found) == NAMES
    return found


@pytest.mark.parametrize("name", NAMES)
def test_a_bent_file_is_read_or_refused(known: dict[str, Reader], name: str) -> None:
    known[name].read(known[name].sound)
    fuzz(known[name], 20, number=7)


@pytest.mark.parametrize(
    ("count", "seed"),
    [pytest.param(18, 3, marks=pytest.mark.long), pytest.param(200, 1, marks=pytest.mark.night)],
)
def test_a_command_names_what_is_wrong_with_a_file(tmp_path: Path, count: int, seed: int) -> None:
    """Without a traceback, in time, and with an exit code of its own."""
    problems = [
        (case.kind, case.number, case.command, case.problem, case.said[-500:])
        for case in bend_files(tmp_path, count, seed)
        if case.problem
    ]
    assert problems == []
