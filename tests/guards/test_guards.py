"""Results and words are those that were recorded; a change that is meant renews the records."""

import re
from pathlib import Path
from typing import Any

import pytest
from tests.guards.comparing import compare, summary
from tests.guards.guards import GUARDS, UPDATE, Guard, SchemaGuard, UnavailableError
from tests.guards.records import FOLDER, Record

LOCKED = Path(__file__).parents[2] / ".ci/constraints" / "dev.txt"
_EXPLAINED = (
    f"If the change is meant, run `{UPDATE}` and commit the records. Another processor or C "
    "library changes last bits, and hashes where no number changed."
)
_MARKS: dict[str, Any] = {"long": pytest.mark.long, "night": pytest.mark.night}
_STORED = [guard for guard in GUARDS if not isinstance(guard, SchemaGuard)]


@pytest.mark.parametrize(
    "guard",
    [
        pytest.param(guard, marks=[_MARKS[guard.tier]] if guard.tier else [], id=guard.key)
        for guard in GUARDS
    ],
)
def test_nothing_changed(guard: Guard, tmp_path: Path) -> None:
    before = guard.read()
    if before.versions != (here := guard.versions()):
        pytest.skip(f"recorded with {dict(before.versions)}; here is {here}")
    try:
        after = guard.record(tmp_path)
    except UnavailableError as error:
        pytest.skip(str(error))
    if text := summary(guard.kind, compare(before, after)):
        pytest.fail(f"{text}\n{_EXPLAINED}", pytrace=False)


def test_every_record_is_of_a_guard() -> None:
    stored = {path.relative_to(FOLDER).as_posix() for path in FOLDER.rglob("*.json")}
    assert stored == {f"{guard.key}.json" for guard in _STORED}


def test_records_are_made_with_locked_versions() -> None:
    """So that a newer package cannot have them skipped for good."""
    # A package may have a version for each Python.
    pins = re.findall(r"^([\w-]+)==(\S+)", LOCKED.read_text(encoding="utf-8"), re.MULTILINE)
    for guard in _STORED:
        versions = guard.read().versions
        assert [*versions] == [*guard.packages], guard.key
        assert {*versions.items()} <= {*pins}, guard.key


def test_records_are_read_as_they_were_written() -> None:
    for guard in _STORED[::7]:
        record = guard.read()
        assert not compare(record, Record.from_text(record.to_text())), guard.key
