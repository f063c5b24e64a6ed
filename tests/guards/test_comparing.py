"""A comparison says in words what changed, for every kind of change that is planted."""

import json
import re
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.guards.comparing import compare, joined, summary
from tests.guards.guards import GUARDS
from tests.guards.records import Record
from tests.guards.schemas import reordered

_BY_KEY = {guard.key: guard for guard in GUARDS}
_RUNS = {f"r{number}": f"{number:016x}" for number in range(27)}


def said(before: dict[str, Any], after: dict[str, Any], kind: str = "model") -> str:
    return summary("guard", compare(Record({}, {kind: before}), Record({}, {kind: after})))


def planted(key: str, edit: Callable[[Record], None]) -> str:
    """Return what is said of an edited copy of a stored record."""
    before = _BY_KEY[key].read()
    after = deepcopy(before)
    edit(after)
    return summary(_BY_KEY[key].kind, compare(before, after))


def test_a_run_id_that_changed_is_named() -> None:
    def edit(record: Record) -> None:
        runs = record.results["planned run"]
        for name in ("timestep=0.02 drop_height=2", "timestep=0.002 drop_height=2"):
            runs[f"bounce: restitution=0.6 {name}"]["run id"] = "0123456789abcdef"

    text = planted("sweeps/bounce", edit)
    assert text.startswith("sweeps: results changed\n  run id ")
    assert "2 of 27 planned runs" in text
    assert "bounce: restitution=0.6 timestep=0.02 drop_height=2 " in text
    assert "-> 0123456789ab" in text


def test_a_byte_of_a_trace_that_changed_is_named() -> None:
    def edit(record: Record) -> None:
        run = record.results["run"]["bounce: restitution=0.6 timestep=0.02 drop_height=2"]
        run["trace bytes"] = f"{int(run['trace bytes'], 16) ^ 1:064x}"

    text = planted("sweeps/bounce", edit)
    assert text.startswith("sweeps: results changed\n  trace bytes ")
    assert text.endswith("in 1 of 6 runs (bounce: restitution=0.6 timestep=0.02 drop_height=2)")


def test_a_verdict_that_changed_is_named() -> None:
    before = _BY_KEY["robots/gymnasium-half_cheetah"].read()
    verdict = before.results["robot"]["gymnasium-half_cheetah"]["verdict"]

    def edit(record: Record) -> None:
        record.results["robot"]["gymnasium-half_cheetah"]["verdict"] = "another"

    assert planted("robots/gymnasium-half_cheetah", edit) == (
        f'robots: results changed\n  verdict "{verdict}" -> "another" in '
        "robot gymnasium-half_cheetah"
    )


def test_a_share_that_changed_is_named() -> None:
    def edit(record: Record) -> None:
        phases = record.results["robot"]["gymnasium-half_cheetah"]["phases"]
        rows = next(iter(phases.values()))["rows"]
        next(iter(rows.values()))["share"] *= 1.5

    text = planted("robots/gymnasium-half_cheetah", edit)
    assert re.fullmatch(
        r"robots: results changed\n  phases\.\w+\.rows\.[\w ]+\.share \S+ -> \S+ \(\+0\.5 of it\) "
        r"in robot gymnasium-half_cheetah",
        text,
    )


def test_a_written_file_that_changed_is_named_and_its_patch_is_shown() -> None:
    name = "gymnasium-half_cheetah"

    def edit(record: Record) -> None:
        files = record.results["written file"]
        for facts in files.values():
            facts["bytes"] = f"{int(facts['bytes'], 16) ^ 1:064x}"

    text = planted(f"written/{name}", edit)
    assert text.startswith("written: results changed\n  bytes ")
    assert f"{name}: tune/" in text


def test_help_that_changed_is_shown_by_line() -> None:
    counts = list[int]()

    def edit(record: Record) -> None:
        record.words["command"]["contactlab tune"]["help"][0] += " AND MORE"
        counts.append(len(record.words["command"]))

    text = planted("help/commands", edit)
    assert text.startswith(
        f"help: words changed\n  help changed in 1 of {counts[0]} commands (contactlab tune)"
    )
    assert "    -Usage: contactlab tune" in text
    assert text.endswith("AND MORE")


def test_a_property_of_a_schema_that_is_another_type_is_named() -> None:
    def edit(record: Record) -> None:
        record.results["schema"]["tune.schema.json"]["properties"]["seconds"]["type"] = "string"

    text = planted("schemas/all", edit)
    assert 'properties.seconds.type "number" -> "string" in' in text
    assert "tune.schema.json" in text


def test_a_line_of_a_page_that_changed_is_shown() -> None:
    def edit(record: Record) -> None:
        texts = record.words["page"]["sweep grasp"]["text"]
        texts[0] = "another title"

    text = planted("pages/sweep grasp", edit)
    assert text.startswith("pages: words changed\n  text changed in page sweep grasp:\n    -")
    assert text.endswith("    +another title")


def test_a_word_that_is_another_wherever_it_stood_is_renamed() -> None:
    words = {"a": "unresolved", "b": "unresolved", "c": "sound"}
    before = {name: {"verdict": word} for name, word in words.items()}
    after = {
        name: {"verdict": "inaccurate" if word == "unresolved" else word}
        for name, word in words.items()
    }
    assert said(before, after) == (
        'guard: renamed\n  verdict: "unresolved" is now called "inaccurate" in 2 of 3 models (a, b)'
    )


def test_a_sentence_that_is_another_everywhere_is_a_change_of_words() -> None:
    before, after = (Record({}, {}, {"model": {"a": {"s": text}, "b": {}}}) for text in ("x", "y"))
    assert summary("guard", compare(before, after)) == (
        'guard: words changed\n  s "x" -> "y" in 1 of 2 models (a)'
    )


@pytest.mark.parametrize("other", ["sound", "unresolved"])
def test_a_word_that_is_another_of_the_known_ones_is_a_change(other: str) -> None:
    words = {"a": "unresolved", "b": "sound", "c": "sound"}
    before = {name: {"verdict": word} for name, word in words.items()}
    after = deepcopy(before)
    changed = "a" if other == "sound" else "b"
    after[changed]["verdict"] = other
    was = before[changed]["verdict"]
    assert said(before, after) == (
        f'guard: results changed\n  verdict "{was}" -> "{other}" in 1 of 3 models ({changed})'
    )


def test_a_word_that_is_new_in_some_places_alone_is_a_change() -> None:
    before = {name: {"verdict": "unresolved"} for name in "abc"}
    after = deepcopy(before)
    after["b"]["verdict"] = "inaccurate"
    assert said(before, after).startswith("guard: results changed\n  verdict")


def test_a_fact_with_another_name_and_the_same_values_is_renamed() -> None:
    before = {
        name: {"rows": {"cone": {"share": value, "of": name}}} for name, value in _RUNS.items()
    }
    after = {
        name: {"rows": {"friction cone": facts["rows"]["cone"]}} for name, facts in before.items()
    }
    text = said(before, after)
    assert text == (
        "guard: renamed\n  rows.cone is now called rows.friction cone, with the same values, "
        "in all 27 models"
    )


def test_a_fact_with_another_name_and_another_value_is_gone_and_new() -> None:
    before = {"a": {"cone": 0.5}, "b": {"cone": 0.25}}
    after = {"a": {"friction": 0.5}, "b": {"friction": 0.5}}
    text = said(before, after)
    assert "renamed" not in text
    assert text.startswith("guard: results changed\n  cone")


def test_numbers_are_compared_to_the_last_bit_and_told_apart_from_it() -> None:
    before = {name: {"share": 0.1, "more": 1.0} for name in "ab"}
    after = {"a": {"share": 0.1 + 2**-56, "more": 1.0}, "b": {"share": 0.1, "more": 1.5}}
    assert said(before, after).splitlines()[1:] == [
        "  share 0.1 -> 0.10000000000000002, by last bits only in 1 of 2 models (a)",
        "  more 1.0 -> 1.5 (+0.5 of it) in 1 of 2 models (b)",
    ]


def test_items_that_came_and_went_are_named() -> None:
    assert said({"a": {"n": 1}}, {"b": {"n": 2}}).splitlines() == [
        "guard: results changed",
        "  1 model gone: a",
        "  1 model new: b",
    ]


def test_an_item_with_another_name_and_the_same_facts_is_renamed() -> None:
    before = {"to_aim/a": {"size": 1}, "to_aim/b": {"size": 2}, "c": {"size": 3}}
    after = {"target/a": {"size": 1}, "target/b": {"size": 4}, "c": {"size": 3}}
    assert said(before, after, "file").splitlines() == [
        "guard: results changed",
        "  1 file gone: to_aim/b",
        "  1 file new: target/b",
        "guard: renamed",
        "  file to_aim/a is now called target/a, with the same facts",
    ]


def test_equal_changes_of_several_records_are_one_line() -> None:
    def record(word: str, name: str) -> Record:
        return Record({}, {"model": {name: {"label": word}}})

    before, after = (
        joined(record(word, name) for name in ("a", "b")) for word in ("slip", "creep")
    )
    assert "all 2 models" in summary("guard", compare(before, after))


_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=3),
    lambda inner: (
        st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=2), inner, max_size=2)
    ),
    max_leaves=4,
)
_ITEMS = st.dictionaries(
    st.text(max_size=2).filter(lambda name: name != "*"),
    st.dictionaries(st.text(max_size=2), _VALUES, max_size=3),
    max_size=3,
)


@given(before=_ITEMS, after=_ITEMS)
def test_nothing_is_said_exactly_if_records_are_equal(
    before: dict[str, Any], after: dict[str, Any]
) -> None:
    equal = json.dumps(before, sort_keys=True) == json.dumps(after, sort_keys=True)
    assert bool(said(before, after)) == (not equal)
    assert not said(before, before)


@given(items=_ITEMS)
def test_a_record_is_read_as_it_was_written(items: dict[str, Any]) -> None:
    record = Record({"mujoco": "4"}, {"model": items})
    read = Record.from_text(record.to_text())
    assert not compare(record, read)
    assert not compare(read, record)


def test_a_schema_in_another_order_is_named() -> None:
    made = {"a.schema.json": json.dumps({"a": 1, "b": 2})}
    assert reordered({"a.schema.json": json.dumps({"b": 2, "a": 1})}, made) == ["a.schema.json"]
    assert not reordered({"a.schema.json": json.dumps({"b": 3, "a": 1})}, made)
    assert not reordered(made, made)
