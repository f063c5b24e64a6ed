"""When a change of a metric or a label is an effect, and when it is the scene's own spread."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.errors import SceneError
from contactlab.studies.effects import ablation
from contactlab.studies.effects.configuration_runs import ConfigurationRows
from contactlab.studies.effects.effect_toggles import (
    ConfigurationDifference,
    difference,
    judged_metrics,
)
from contactlab.studies.effects.effects_request import AblationSetup, EffectsRequest

TOLERANCE = 1e-3


@pytest.fixture(scope="module")
def setup(tmp_path_factory: pytest.TempPathFactory) -> AblationSetup:
    """Return what is asked of a scene with one tolerance."""
    path = tmp_path_factory.mktemp("asked") / "asked.yaml"
    path.write_text(f"version: 1\nscene: ball_drop\ntolerances: {{drift: {TOLERANCE}}}\n")
    return EffectsRequest(str(path), seeds=2).setup


def rows(values: list[float | None], label: str = "stable") -> tuple[dict[str, Any], ...]:
    """Return rows of a store, one a seed."""
    nothing: dict[str, Any] = dict.fromkeys(judged_metrics())
    return tuple({**nothing, "drift": value, "label": label} for value in values)


def compared(setup: AblationSetup, base: Any, other: Any) -> ConfigurationDifference:
    """Compare two outcomes of one scenario."""
    first, second = (ConfigurationRows([{}], [each]) for each in (base, other))
    return difference(setup.tolerances, first, second)


@given(
    base=st.lists(st.floats(-1, 1), min_size=2, max_size=8),
    shift=st.floats(-1, 1),
)
def test_a_shift_matters_beyond_both_tolerance_and_spread(
    setup: AblationSetup, base: list[float], shift: float
) -> None:
    other = [value + shift for value in base]
    found = compared(setup, rows(list(base)), rows(list(other)))
    spread = max(base) - min(base)
    # The mean of differences is the shift, to rounding of numbers up to 2.
    if abs(shift) > max(TOLERANCE, spread) + 1e-12:
        assert found.is_significant
    elif abs(shift) < max(TOLERANCE, spread) - 1e-12:
        assert not found.is_significant


def test_a_change_within_the_spread_is_told_with_its_numbers(setup: AblationSetup) -> None:
    found = compared(setup, rows([0.0, 0.5]), rows([0.1, 0.6]))
    assert not found.is_significant
    assert found.within_spread == ("drift",)
    assert found.reason == "drift changes by 0.1 m, within the spread of 0.5 over seeds"


@pytest.mark.parametrize(
    ("base", "other", "matters"),
    [
        ([None, None], [0.1, 0.1], True),
        ([0.1, 0.1], [None, None], True),
        # What some seeds measure and others do not is the scene's own.
        ([None, 0.1], [None, None], False),
        ([None, None], [None, None], False),
    ],
)
def test_a_metric_that_appears_or_vanishes_matters(
    setup: AblationSetup, base: list[float | None], other: list[float | None], matters: bool
) -> None:
    assert compared(setup, rows(base), rows(other)).is_significant == matters


def test_a_label_that_no_seed_shows_matters(setup: AblationSetup) -> None:
    same = rows([0.1, 0.1])
    found = compared(setup, same, rows([0.1, 0.1], "tunneling"))
    assert found.labels == {"stable -> tunneling": 2}
    mixed = (*rows([0.1]), *rows([0.1], "tunneling"))
    assert not compared(setup, mixed, rows([0.1, 0.1], "tunneling")).is_significant


def test_the_scenario_that_changes_most_is_told(setup: AblationSetup) -> None:
    scenarios = [{"speed": 1.0}, {"speed": 2.0}]
    base = ConfigurationRows(scenarios, [rows([0.0]), rows([0.0])])
    other = ConfigurationRows(scenarios, [rows([0.0]), rows([0.01])])
    found = difference(setup.tolerances, base, other)
    (change,) = found.metric_changes
    assert change.scenario == {"speed": 2.0}
    assert change.ratio_to_tolerance == pytest.approx(10)


@pytest.mark.parametrize("seeds", [(0,), (0, 1, 2), (7, 3, 12)])
def test_a_set_is_verified_by_seeds_that_found_nothing(
    setup: AblationSetup, seeds: tuple[int, ...]
) -> None:
    """Ten fresh ones, none of which any run of the search had."""
    trials: Any = SimpleNamespace(setup=replace(setup, seeds=seeds))
    found = ablation._verify_set(  # pyright: ignore[reportPrivateUsage]
        trials, ablation.ChosenSet((), {}, SceneError("not written"), None, {})
    )
    assert len({*found.seeds} - {*seeds}) == len(found.seeds) == ablation.FRESH_SEEDS


def test_nothing_is_between_two_recorded_runs(tmp_path: Path) -> None:
    """What is verified on new scenarios keeps to runs that were recorded."""
    sweep = {"version": 1, "scene": "cube_toss", "axes": {"recorded_run": [5, 17, 42]}}
    (tmp_path / "toss.yaml").write_text(json.dumps(sweep))
    setup = EffectsRequest(str(tmp_path / "toss.yaml")).setup
    assert {each["recorded_run"] for each in setup.fresh_scenarios} <= {5.0, 17.0, 42.0}
