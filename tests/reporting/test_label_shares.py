"""Shares of draws have an interval, and those of a grid none."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from contactlab.rendering.amounts import format_percent
from contactlab.reporting.label_shares import share_words
from contactlab.schema.sweep_schema import Sweep
from contactlab.shares import wilson_interval
from contactlab.store.finished_store import Store


def store_of(**changes: Any) -> Store:
    """Return what the words read of a store: its sweep."""
    resolved = {"version": 1, "scene": "?", "axes": {"tilt": [1, 2]}, **changes}
    return cast("Store", SimpleNamespace(sweep=Sweep.model_validate(resolved)))


@pytest.mark.parametrize(
    "changes",
    [
        {"seeds": 20, "axes": {}},
        {"axes": {"tilt": {"uniform": [1, 2]}}, "sample": {"method": "random", "n": 9}},
    ],
)
def test_draws_have_wilsons_interval(changes: dict[str, Any]) -> None:
    low, high = map(format_percent, wilson_interval(16, 20))
    assert share_words(store_of(**changes))(16, 20) == f"80 % ({low[:-2]} to {high})"


@pytest.mark.parametrize("changes", [{}, {"seeds": 20}])
def test_a_grid_has_none(changes: dict[str, Any]) -> None:
    """Runs of a grid are no independent draws, whatever their seeds."""
    assert share_words(store_of(**changes))(1, 8) == "12 %"
