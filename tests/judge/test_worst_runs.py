"""The worst run of a label is the one that is farthest beyond the label's limit."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from contactlab.judge.worst_runs import order_worst_first, worst_first
from contactlab.measure import LABELS, METRICS, THRESHOLDS
from contactlab.store.run_columns import NumberColumn

RUNS = 40


def store_of(
    metrics: dict[str, Any], labels: list[str], thresholds: dict[str, float] | None = None
) -> Any:
    names = [*dict.fromkeys(labels)]
    columns = SimpleNamespace(
        metric_columns={name: SimpleNamespace(better=METRICS[name].better) for name in metrics},
        numbers=lambda name: NumberColumn(metrics[name], np.isfinite(metrics[name])),
        read_codes=lambda _: (np.array([names.index(each) for each in labels]), tuple(names)),
    )
    sweep = SimpleNamespace(resolved={"thresholds": thresholds or {}})
    return SimpleNamespace(columns=columns, manifest=SimpleNamespace(sweep=sweep))


def test_every_measure_of_a_label_is_a_metric_with_a_known_limit_or_none() -> None:
    for label in LABELS.values():
        for metric, limit in label.measures:
            assert metric in METRICS, label.name
            assert limit in {*THRESHOLDS, ""}, label.name


@pytest.mark.parametrize(
    "label", [label for label in LABELS.values() if len(label.measures) == 1], ids=lambda e: e.name
)
def test_runs_are_in_the_order_of_their_metric(label: Any) -> None:
    """Equal values keep the order of the runs; runs without a value are last."""
    ((metric, _),) = label.measures
    values = np.random.default_rng(5).integers(1, 9, RUNS) / 2.0
    values[3] = np.nan
    rows = np.arange(1, RUNS)
    order = rows[order_worst_first(store_of({metric: values}, []), label.name, rows)]
    sign = 1 if METRICS[metric].better == "higher" else -1
    expected = sorted(rows.tolist(), key=lambda row: (row == 3, sign * values[row], row))
    assert order.tolist() == expected


def test_the_deepest_stable_run_comes_first() -> None:
    metrics = {"penetration_max": np.array([1e-4, np.nan, 3e-3, 1e-4])}
    assert order_worst_first(store_of(metrics, []), "stable", np.arange(4)).tolist() == [2, 0, 3, 1]
    assert order_worst_first(store_of({}, []), "stable", np.arange(3)).tolist() == [0, 1, 2]


def test_of_several_metrics_the_one_farthest_beyond_its_limit_counts() -> None:
    """A factor of 4 beyond one limit is worse than a factor of 3 beyond a larger one."""
    metrics = {
        "constraint_violation": np.array([1.5, 0.1, 0.0, 0.6]),
        "constraint_violation_rest": np.array([0.0, 0.4, 0.2, np.nan]),
    }
    rows = np.arange(4)
    order = order_worst_first(store_of(metrics, []), "constraint_violated", rows)
    assert order.tolist() == [1, 0, 2, 3]
    stated = store_of(metrics, [], {"constraint_violation": 0.05})
    assert order_worst_first(stated, "constraint_violated", rows).tolist() == [0, 3, 1, 2]


def test_a_metric_within_its_limit_does_not_outweigh_one_whose_limit_is_the_scenes() -> None:
    metrics = {
        "hold_slip": np.array([0.001, 0.1, 0.01]),
        "hold_contact": np.array([0.1, 1.0, 0.8]),
    }
    order = order_worst_first(store_of(metrics, []), "slipping", np.arange(3))
    assert order.tolist() == [0, 1, 2]


def test_rows_of_several_labels_begin_with_the_worst_label() -> None:
    metrics = {"penetration_max": np.array([1.0, 3.0, 2.0, 9.0])}
    store = store_of(metrics, ["tunneling", "tunneling", "haunted", "stable"])
    assert worst_first(store, np.arange(4)).tolist() == [2, 1, 0, 3]
