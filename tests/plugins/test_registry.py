"""What a transaction takes back, and which entries of a label are refused."""

from typing import Any, NamedTuple

import pytest

from contactlab.errors import PluginError
from contactlab.measure import Label
from contactlab.registry import REGISTRIES, Registry, settle, transaction


class Entry(NamedTuple):
    name: str


def _fail() -> None:
    """Add entries as a plug-in does that imports a package first, and then fails."""
    with transaction():
        late: Registry[Entry] = Registry("late")
        late.add(Entry("ours"))
        settle()
        late.add(Entry("theirs"))
        raise ValueError("bad plug-in")


def test_a_registry_made_meanwhile_keeps_what_its_package_declared() -> None:
    try:
        with pytest.raises(ValueError, match="bad plug-in"):
            _fail()
        assert list(REGISTRIES["late"]) == ["ours"]
    finally:
        REGISTRIES.pop("late", None)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"severity": 46}, "severity must be one of void, bad, poor, noted, good"),
        ({"letter": "ab"}, "letter 'ab' is not one character"),
        ({"colour": "red"}, "colour 'red' is not like '#1f77b4'"),
    ],
)
def test_a_label_says_what_is_wrong_with_it(wrong: Any, message: str) -> None:
    given: Any = {"severity": "poor", **wrong}
    with pytest.raises(PluginError, match=message):
        Label("mine", "Mine.", **given)
