"""Configurations are what a loop over the runs of each says."""

import statistics
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from contactlab.pareto.configurations import EvaluatedConfiguration, StoredRuns, group_runs
from contactlab.store.run_columns import CodedColumn

KNOBS = ("timestep", "cone")


def random_rows(rng: np.random.Generator, count: int) -> list[dict[str, Any]]:
    """Return runs in any order, some without a value of a knob, a time or a depth."""

    def unless(chance: float, value: float) -> float:
        return np.nan if rng.random() < chance else value

    return [
        {
            "timestep": rng.choice([1e-3, 2e-3, 4e-3]),
            "cone": ("elliptic", None)[rng.integers(2)],
            "scenario": int(rng.integers(2)),
            "seed": int(rng.integers(2)),
            "label": rng.choice(["stable", "chatter", "tunneling"], p=[0.8, 0.1, 0.1]),
            "oracle_error": unless(0.05, rng.normal()),
            "depth": unless(0.05, rng.normal()),
            "time_median": unless(0.3, rng.random()),
        }
        for _ in range(count)
    ]


@pytest.mark.parametrize("seed", range(20))
def test_a_loop_over_its_runs_says_the_same(
    weighed: Callable[..., list[EvaluatedConfiguration]], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    rows = random_rows(rng, int(rng.integers(1, 60)))
    keys = [tuple(row[name] for name in KNOBS) for row in rows]
    cases = [(row["scenario"], row["seed"]) for row in rows]
    found = weighed(rows, KNOBS, depth=1.5)
    assert [tuple(each.values.values()) for each in found] == list(dict.fromkeys(keys))
    for each in found:
        own = [place for place, key in enumerate(keys) if key == tuple(each.values.values())]
        assert (each.first, each.summary.outcomes.runs) == (own[0], len(own))
        assert each.cases == len({cases[place] for place in own})
        runs, seen = [rows[place] for place in own], each.summary
        labels = Counter(run["label"] for run in runs)
        assert list(seen.outcomes.labels.items()) == list(labels.items()), "as they occur"
        depths, errors = ([abs(run[name]) for run in runs] for name in ("depth", "oracle_error"))
        times = [run["time_median"] for run in runs if np.isfinite(run["time_median"])]
        assert seen.worst == {"depth": None if np.isnan(depths).any() else max(depths)}
        assert seen.error == (None if np.isnan(errors).any() else max(errors))
        if seen.error is not None and len(own) > 1:
            assert seen.error_spread == (min(errors), statistics.median(errors))
        assert seen.time_worst == (max(times) if times else None)
        # A sum of n terms is off by n roundings at most.
        mean = pytest.approx(np.mean(times), rel=len(own) * 2**-52) if times else None
        assert seen.time == mean
        good = [run["label"] == "stable" and abs(run["depth"]) <= 1.5 for run in runs]
        assert seen.outcomes.good == sum(good)
        assert seen.feasible == (all(good) and bool(times) and each.cases == len({*cases}))


def test_more_combinations_than_integers_stay_apart() -> None:
    rng = np.random.default_rng(3)
    values = rng.integers(1000, size=(30, 200))
    values[:, 100:] = values[:, :100]
    values[0, 150] += 1
    # Of an axis of 1,000 values.
    knobs = {str(axis): CodedColumn(row, tuple(range(1001))) for axis, row in enumerate(values)}
    same = CodedColumn(np.zeros(200, dtype=np.int64), (0,))
    groups = group_runs(StoredRuns(knobs, {}, same, same, {}))
    expected = [[place, place + 100] for place in range(100) if place != 50]
    expected[50:50] = [[50]]
    assert [each.tolist() for each in groups.split_values(groups.order)] == [*expected, [150]]
