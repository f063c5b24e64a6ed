"""Long lists of numbers are read as the YAML parser reads them, without it."""

import math
from collections.abc import Callable
from unittest.mock import patch

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactlab.plan import number_lists
from contactlab.plan.yaml_document import Document, read_document

WORDS = st.one_of(
    st.integers(-1000, 10**19).map(str),
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.sampled_from(
        [
            "+1",
            "-0",
            "007",
            "08",
            "1.",
            ".5",
            "-.5e-3",
            "1e3",
            "1E+3",
            "1e999",
            "1e",
            "-",
            ".",
            "1-2",
        ]
    ),
)
COMMAS = st.sampled_from([", ", ",", " ,", ",\n  ", ",\r\n   ", "\n  , ", ",\n\n "])
ENDS = st.sampled_from(["", " ", "\n  "])
# Places of a list; some are text, and some do not allow it.
PLACES = (
    "a: {}\nb: 1\n",
    "a: &x {}\nb: *x\n",
    "- {}\n- 2\n",
    "{{a: {}, b: 3}}\n",
    "[{}, 1]\n",
    "# {}\na: 1\n",
    "a: '{}'\nb: 2\n",
    'a: "{}"\n',
    "a: |\n  {}\nb: 1\n",
    "a: f{}\n",
    "{}: 1\n",
    "a: {}\na: {}\n",
    "a: {} b\n",
    "a: !!set {}\n",
    "%YAML 1.1\n---\na: {}\n",
)


@st.composite
def draw_list(draw: st.DrawFn) -> str:
    words = draw(st.lists(WORDS, min_size=1, max_size=6))
    text = words[0] + "".join(draw(COMMAS) + word for word in words[1:])
    return f"[{draw(ENDS)}{text}{draw(ENDS)}]"


def read_with(least: float, read: Callable[[], Document]) -> Document:
    with patch.object(number_lists, "LEAST_ITEMS", least):
        return read()


@settings(max_examples=60)
@given(st.sampled_from(PLACES), draw_list(), draw_list())
def test_it_is_what_the_parser_reads(place: str, one: str, other: str) -> None:
    text = place.format(one, other)
    fast, slow = (read_with(least, lambda: read_document(text, "sweep")) for least in (2, math.inf))
    assert repr(fast.data) == repr(slow.data)
    assert (fast.values, fast.keys) == (slow.values, slow.keys)
    assert fast.mistakes == slow.mistakes


def test_a_long_list_costs_the_parser_one_value(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(number_lists, "MOST_WRITTEN", 6)
    numbers = list(range(1000))
    document = read_document(f"axes: {{timestep: {numbers}}}", "sweep")
    assert document.data == {"axes": {"timestep": numbers}}
    assert not document.mistakes


def test_too_many_other_values_are_refused_while_they_are_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The rest of the text is not read, and so not refused."""
    monkeypatch.setattr(number_lists, "MOST_WRITTEN", 400)
    text = "".join(f"axis_{number}: [1, 2]\n" for number in range(101))
    (mistake,) = read_document(text + "\t: ]", "sweep").mistakes
    assert mistake.message.startswith("more than 400 values outside of lists of numbers")


def test_a_long_list_is_not_merged() -> None:
    text = f"<<: {list(range(1000))}\n"
    (mistake,) = read_document(text, "sweep").mistakes
    assert mistake.message.startswith("`<<` takes a mapping")
