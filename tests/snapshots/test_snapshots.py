"""Records, traces, help and page are as they were: a change that is meant updates the snapshots."""

import difflib
import re
from pathlib import Path

import pytest
from tests.snapshots.snapshots import SNAPSHOTS, TEXTS, UPDATE, Snapshot, path_of, stated

LOCKED = Path(__file__).parents[2] / "constraints" / "dev.txt"
_EXPLAINED = (
    f"If the change is meant, run `{UPDATE}` and commit the texts. If hashes of trajectories and "
    "digests differ and no value does, the processor or C library computes other last bits."
)


def differences(name: str, snapshot: Snapshot, folder: Path) -> str:
    """Return the unified diff from a stored text to what is made now; empty if they are equal."""
    for module in snapshot.modules:
        pytest.importorskip(module, reason=f"{module} is an extra")
    stored = path_of(name).read_text(encoding="utf-8")
    versions = stored.partition("\n")[0]
    if versions != snapshot.versions():
        pytest.skip(f"made with {versions}; here is {snapshot.versions()}")
    before, now = stored.splitlines(), snapshot.text(folder).splitlines()
    found = difflib.unified_diff(before, now, f"{name}.txt", "now", n=1, lineterm="")
    return "\n".join(in_section(line, before) for line in found)


def in_section(line: str, before: list[str]) -> str:
    """Return a line of a diff; one that begins a hunk, with the title above it, as of a run."""
    place = re.match(r"@@ -(\d+)", line)
    titles = [text for text in before[: int(place[1])] if text.startswith("== ")] if place else []
    return f"{line} {titles[-1]}" if titles else line


# The page takes seconds: charts, and packages that load for long.
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.long] if name == "page" else []) for name in SNAPSHOTS],
)
def test_nothing_changed(name: str, tmp_path: Path) -> None:
    found = differences(name, SNAPSHOTS[name], tmp_path)
    if found:
        pytest.fail(f"{found}\n{_EXPLAINED}", pytrace=False)


def test_every_text_is_of_a_snapshot() -> None:
    assert {path.name for path in TEXTS.iterdir()} == {path_of(name).name for name in SNAPSHOTS}


@pytest.mark.parametrize("name", SNAPSHOTS)
def test_texts_are_made_with_locked_versions(name: str) -> None:
    """So that a newer package cannot have them skipped for good."""
    pins = dict(re.findall(r"^([\w-]+)==(\S+)", LOCKED.read_text(encoding="utf-8"), re.MULTILINE))
    versions = {package: pins[package] for package in SNAPSHOTS[name].packages}
    assert path_of(name).read_text(encoding="utf-8").partition("\n")[0] == stated(versions)
