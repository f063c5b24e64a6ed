"""Bodies that should stay: how far they went, how fast they still are, and when a scene minds."""

from typing import Any

import numpy as np
import pytest

from contactlab.contact.trace_setup import FreeBody
from contactlab.measure import THRESHOLDS, assess_runs, threshold_values

TILTED = np.array([[3.0, 0.0, -4.0]])


def found(trace: Any, setup: Any) -> dict[str, float]:
    return {name: float(values[0]) for name, values in assess_runs(trace, setup).metrics.items()}


def labels(trace: Any, setup: Any) -> list[tuple[str, int]]:
    return [(outcome.label, outcome.step) for outcome in assess_runs(trace, setup).labels[0]]


def test_drift_is_across_gravity_and_drop_along_it(trace_of: Any, setup_of: Any) -> None:
    trace = trace_of()
    trace.qpos[0, -1, :3] = 0.03, 0.04, -0.5
    metrics = found(trace, setup_of(trace))
    assert (metrics["drift"], metrics["drop"]) == (pytest.approx(0.05), pytest.approx(0.5))


@pytest.mark.parametrize("way", [(1.0, 2.0, 3.0), (3.0, 0.0, -4.0), (-4.0, 0.5, -3.0)])
def test_drift_and_drop_make_up_the_way(trace_of: Any, setup_of: Any, way: Any) -> None:
    trace = trace_of()
    trace.qpos[0, -1, :3] = way
    metrics = found(trace, setup_of(trace, gravity=TILTED))
    assert metrics["drop"] == pytest.approx(np.dot(way, TILTED[0]) / 5)
    assert np.hypot(metrics["drift"], metrics["drop"]) == pytest.approx(np.linalg.norm(way))


def test_the_body_that_moved_most_counts(trace_of: Any, setup_of: Any) -> None:
    trace = trace_of(qpos=np.zeros((1, 101, 14)), qvel=np.zeros((1, 101, 12)))
    bodies = tuple(FreeBody(f"box{k}", 7 * k, 6 * k, np.ones(1)) for k in range(2))
    trace.qpos[0, -1, 7] = 0.2
    trace.qpos[0, -1, 2] = 0.1
    trace.qvel[0, -1, 6] = 3.0
    metrics = found(trace, setup_of(trace, free_bodies=bodies, quaternions=()))
    assert metrics["drift"] == pytest.approx(0.2)
    assert metrics["drop"] == pytest.approx(0.0)
    assert metrics["rest_speed"] == pytest.approx(3.0)


def test_rest_is_the_last_fifth(trace_of: Any, setup_of: Any) -> None:
    trace = trace_of(1, 100)
    trace.qvel[0, :81, 0] = 1.0
    trace.qvel[0, 90, 1] = 0.25
    assert found(trace, setup_of(trace))["rest_speed"] == pytest.approx(0.25)


def test_without_free_bodies_nothing_is_known(trace_of: Any, setup_of: Any) -> None:
    trace = trace_of()
    metrics = found(trace, setup_of(trace, free_bodies=()))
    assert all(np.isnan(metrics[name]) for name in ("drift", "drop", "rest_speed"))


def test_only_scenes_that_set_a_limit_mind(trace_of: Any, setup_of: Any) -> None:
    trace = trace_of(1, 100)
    trace.qpos[0, 40:, 0] = 0.2
    trace.qvel[0, 95, 0] = 0.1
    passive = {"passive": False}
    assert labels(trace, setup_of(trace, **passive)) == [("stable", 0)]
    setup = setup_of(trace, thresholds={"drift": 0.1, "rest_speed": 0.05}, **passive)
    assert labels(trace, setup) == [("drift", 39), ("unsettled", 94)]
    setup = setup_of(trace, thresholds={"drift": 0.3, "rest_speed": 0.2}, **passive)
    assert labels(trace, setup) == [("stable", 0)]


def test_limits_without_a_default_are_absent() -> None:
    unset = {name for name, each in THRESHOLDS.items() if each.default is None}
    assert {"drift", "rest_speed"} <= unset
    assert not unset & set(threshold_values({}))
    assert threshold_values({"drift": 0.5})["drift"] == 0.5
