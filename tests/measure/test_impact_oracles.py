"""Impact depth and the plate with rolling balls, against motions that obey them exactly."""

from typing import Any

import numpy as np
import pytest

from contactlab.contact.trace_setup import FreeBody
from contactlab.measure import assess_runs


def found(trace: Any, setup: Any) -> list[float]:
    metrics = assess_runs(trace, setup).metrics
    return [metrics[f"oracle_{part}"][0] for part in ("expected", "measured", "error")]


@pytest.mark.parametrize(
    ("solref", "depth"),
    [
        # Critical damping: v tc / e. Without damping: v / w. Measured: 46.1 mm at 6.264 m/s.
        ((0.02, 1.0), 6.264 * 0.02 / np.e),
        ((-1e4, 0.0), 6.264 / 100),
    ],
)
def test_impact_depth(
    pair_of: Any, trace_of: Any, setup_of: Any, solref: Any, depth: float
) -> None:
    steps, timestep = 50, 1e-3
    distance = np.zeros((1, steps, 1))
    distance[0, 20] = -depth
    trace = trace_of(
        1, steps, timestep, pairs=(pair_of(1, steps, normal=distance < 0, distance=distance),)
    )
    setup = setup_of(
        trace, oracle="impact_depth", settings={"solref": [solref], "speed": [6.264]}, passive=False
    )
    travel = 6.264 * timestep
    assert found(trace, setup) == pytest.approx([depth / travel, depth / travel, 0], abs=1e-9)
    assert depth == pytest.approx(46.1e-3, abs=5e-5) or solref[1] == 0
    trace.pairs[0].slots[0, 20, 0, 7] -= travel
    assert found(trace, setup)[2] == pytest.approx(1.0)


def test_speculative_contacts_have_no_depth(pair_of: Any, trace_of: Any, setup_of: Any) -> None:
    trace = trace_of(1, 50, pairs=(pair_of(1, 50, normal=1.0, distance=-1.0),))
    setup = setup_of(
        trace,
        oracle="impact_depth",
        oracle_tolerance=1,
        settings={"solref": [(0.02, 1.0)], "speed": [5.0]},
        speculative=np.array([True]),
    )
    assert np.isnan(found(trace, setup)).all()
    assert assess_runs(trace, setup).labels[0][0].label != "oracle_miss"


def rolling(pair_of: Any, trace_of: Any, setup_of: Any, error: float) -> tuple[Any, Any]:
    """Return 1 s of a plate and 25 balls at their accelerations, the plate's off by `error`."""
    steps, timestep = 1000, 1e-3
    bodies = tuple(
        FreeBody(f"body{k}", 7 * k, 6 * k, np.array([10.0 if k == 0 else 1.0])) for k in range(26)
    )
    time = timestep * np.arange(steps + 1)
    velocity = np.zeros((1, steps + 1, 26 * 6))
    for k in range(26):
        pace = (0.7385 if k == 0 else 0.211) * time
        velocity[0, :, 6 * k], velocity[0, :, 6 * k + 1] = 0.6 * pace, 0.8 * pace
    velocity[0, 1:, 2] += error
    trace = trace_of(
        1,
        steps,
        timestep,
        qpos=np.zeros((1, steps + 1, 26 * 7)),
        qvel=velocity,
        pairs=(pair_of(1, steps, normal=1.0, friction=0.4),),
    )
    heading = np.degrees(np.arctan2(0.8, 0.6))
    setup = setup_of(
        trace,
        free_bodies=bodies,
        quaternions=(),
        passive=False,
        oracle="rolling_plate",
        settings={"force": [150.0], "direction": [heading]},
    )
    return trace, setup


def test_rolling_plate(pair_of: Any, trace_of: Any, setup_of: Any) -> None:
    """The published accelerations are rounded to four digits: no error to 1e-4 m/s in 1 s."""
    expected, _, error = found(*rolling(pair_of, trace_of, setup_of, 0.0))
    assert expected == 0
    assert error < 1e-8
    assert found(*rolling(pair_of, trace_of, setup_of, 0.1))[2] == pytest.approx(0.01, rel=1e-3)
