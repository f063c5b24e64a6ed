"""Runs are paired by what they are, never by their place."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.comparison.compare_stores import compare_stores
from contactlab.comparison.pairing import pair_keys, round_values
from contactlab.errors import StoreError
from contactlab.schema.comparison import ComparePolicy

BY_AXES = ComparePolicy(version=1, match="axes")
BY_ID = ComparePolicy(version=1, match="id")
KEYS = st.lists(st.integers(0, 30), unique=True)


@given(KEYS.filter(len), KEYS.filter(len))
def test_pairing_is_looking_up(old: list[int], new: list[int]) -> None:
    found = pair_keys(np.array(old), np.array(new))
    pairs = {old[row]: new[other] for row, other in zip(*found[:2], strict=True)}
    assert pairs == {key: key for key in set(old) & set(new)}
    assert [old[row] for row in found.missing] == [key for key in old if key not in new]
    assert [new[row] for row in found.new] == [key for key in new if key not in old]


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_rounding_keeps_nine_digits(value: float) -> None:
    """Half a unit of the ninth digit is at most 5e-9 of the value."""
    (found,) = round_values(np.array([value]))
    assert abs(found - value) <= 5.0000001e-9 * abs(value)
    assert round_values(np.array([found])) == found


def test_another_order_is_no_difference(
    baseline: Path, runs: Callable[[], Any], stored: Callable[..., Path]
) -> None:
    turned = runs()
    turned.runs = [
        run.model_copy(update={"index": place}) for place, run in enumerate(reversed(turned.runs))
    ]
    report = compare_stores(baseline, stored("turned", turned))
    assert (report.verdict, report.exit_code, report.pairs.bitwise_equal) == ("same", 0, 8)


def test_axes_that_differ_in_the_last_digits(
    baseline: Path, runs: Callable[[], Any], stored: Callable[..., Path]
) -> None:
    other = runs()
    for index, run in enumerate(other.runs):
        axes = {**run.axes, "timestep": run.axes["timestep"] * (1 + 1e-12)}
        other.change(index, run_id=f"{index + 100:016x}", axes=axes)
    with pytest.raises(StoreError, match=r"no run of .* is in .*; .* add --match axes"):
        compare_stores(baseline, stored("other", other), BY_ID)
    assert compare_stores(baseline, stored("other2", other), BY_AXES).pairs.paired == 8
    chosen = compare_stores(baseline, stored("other3", other))
    assert (chosen.match, chosen.pairs.paired) == ("axes", 8)


def test_one_common_id_pairs_by_id(
    baseline: Path, runs: Callable[[], Any], stored: Callable[..., Path]
) -> None:
    other = runs()
    for index, _ in enumerate(other.runs[1:], 1):
        other.change(index, run_id=f"{index + 100:016x}")
    report = compare_stores(baseline, stored("other", other))
    assert (report.match, report.pairs.paired) == ("id", 1)
    assert report.pairs.missing == report.pairs.new == len(other.runs) - 1


def test_runs_that_axes_do_not_tell_apart(
    baseline: Path, runs: Callable[[], Any], stored: Callable[..., Path]
) -> None:
    other = runs()
    other.change(1, axes=other.runs[0].axes)
    message = "0{15}1 and 0{15}2 of the candidate have equal axis values and seed"
    with pytest.raises(StoreError, match=message):
        compare_stores(baseline, stored("other", other), BY_AXES)


def test_seeds_tell_runs_apart(runs: Callable[[], Any], stored: Callable[..., Path]) -> None:
    given_runs = runs()
    given_runs.change(1, axes=given_runs.runs[0].axes, seed=1)
    one, two = (stored(name, given_runs) for name in ("one", "two"))
    assert compare_stores(one, two, BY_AXES).pairs.paired == 8


def test_other_axes_cannot_be_matched(
    baseline: Path, runs: Callable[[], Any], stored: Callable[..., Path]
) -> None:
    other = runs()
    for index, run in enumerate(other.runs):
        other.change(index, axes={**run.axes, "margin": 1e-3 * index})
    with pytest.raises(StoreError, match="only one of the stores sweeps margin"):
        compare_stores(baseline, stored("other", other), BY_AXES)


def test_an_axis_of_one_value_tells_no_runs_apart(
    baseline: Path, runs: Callable[[], Any], stored: Callable[..., Path]
) -> None:
    """As when the candidate's sweep was run with `--set margin=0`."""
    other = runs()
    for index, run in enumerate(other.runs):
        other.change(index, axes={**run.axes, "margin": 0.0})
    report = compare_stores(baseline, stored("other", other), BY_AXES)
    assert report.pairs.paired == len(other.runs)


def test_stores_of_two_settings_are_compared_and_the_settings_are_told(
    baseline: Path, runs: Callable[[], Any], stored: Callable[..., Path]
) -> None:
    """As when one sweep was run with `--set iterations=5`, the other with 50."""
    stores = list[Path]()
    for iterations in (5, 50):
        one = runs()
        for index, run in enumerate(one.runs):
            axes = {**run.axes, "iterations": float(iterations)}
            one.change(index, run_id=f"{100 * iterations + index:016x}", axes=axes)
        stores.append(stored(f"of-{iterations}", one))
    of_five, of_fifty = stores
    report = compare_stores(of_five, of_fifty, BY_AXES)
    assert report.pairs.paired == len(runs().runs)
    told = {each.what: (each.baseline, each.candidate) for each in report.differences}
    assert told["settings"] == ("iterations 5", "iterations 50")
    report = compare_stores(baseline, of_five, BY_AXES)
    told = {each.what: (each.baseline, each.candidate) for each in report.differences}
    assert told["settings"] == ("iterations by default", "iterations 5")


OTHERS = {
    "one value": lambda run: {"axes": {**run.axes, "iterations": 5.0}},
    "no step in common": lambda run: {"axes": {**run.axes, "timestep": 7.0 + run.index}},
    "other axes": lambda run: {"axes": {"margin": 1e-3 * run.index}},
    "a word": lambda run: {"axes": {**run.axes, "timestep": str(run.index)}},
    "another seed": lambda run: {"seed": run.seed + 7},
    "none told apart": lambda run: {"axes": {"cone": run.axes["cone"]}},
}


@pytest.mark.parametrize("name", OTHERS)
def test_matching_by_axes_is_advised_where_it_works(
    baseline: Path, runs: Callable[[], Any], stored: Callable[..., Path], name: str
) -> None:
    """Of stores without a common id, whatever their axes; else the refusals say the same."""
    other = runs()
    for index, run in enumerate(other.runs):
        other.change(index, run_id=f"{index + 100:016x}", **OTHERS[name](run))
    candidate = stored("other", other)
    with pytest.raises(StoreError) as refused:
        compare_stores(baseline, candidate, BY_ID)
    if str(refused.value).endswith("add --match axes"):
        assert compare_stores(baseline, candidate, BY_AXES).pairs.paired == len(other.runs)
    else:
        with pytest.raises(StoreError) as again:
            compare_stores(baseline, candidate, BY_AXES)
        why = re.sub("^no run of .* is in [^:]*: ", "", str(again.value))
        assert str(refused.value).endswith(f"; {why}")


def test_the_axis_without_a_common_value_is_named(
    baseline: Path, runs: Callable[[], Any], stored: Callable[..., Path]
) -> None:
    other = runs()
    for index, run in enumerate(other.runs):
        other.change(index, run_id=f"{index + 100:016x}", **OTHERS["no step in common"](run))
    with pytest.raises(StoreError, match="no timestep in common; sweep the same values in both"):
        compare_stores(baseline, stored("other", other))


def test_words_and_numbers_cannot_be_matched(
    baseline: Path, runs: Callable[[], Any], stored: Callable[..., Path]
) -> None:
    other = runs()
    for index, run in enumerate(other.runs):
        other.change(index, axes={**run.axes, "timestep": str(run.axes["timestep"])})
    with pytest.raises(StoreError, match="axis 'timestep' is text in one store only"):
        compare_stores(baseline, stored("other", other), BY_AXES)
