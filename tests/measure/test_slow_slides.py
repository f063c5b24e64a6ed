"""A slide so slow that its mode wavers does not switch; one that holds in between does."""

from typing import Any

import numpy as np
import pytest

from contactlab.contact.trace_arrays import SLIDE, STICK
from contactlab.measure import assess_runs

STEPS, PERIOD = 500, 10


def wavering(pair_of: Any, trace_of: Any, held: float) -> Any:
    """Return a trace that slides at 6 mm/s and at 1 mm/s in turn, using `held` when slow."""
    fast = (np.arange(STEPS) // PERIOD % 2 == 0)[None, :, None, None]
    pair = pair_of(
        1,
        STEPS,
        normal=1.0,
        tangential=np.where(fast, 0.5, 0.5 * held) * [1.0, 0.0],
        velocity=np.where(fast, 6e-3, 1e-3) * [1.0, 0.0],
    )
    return trace_of(1, STEPS, pairs=(pair,))


@pytest.mark.parametrize(("held", "switches"), [(0.999, 0), (0.9, 0), (0.89, 49), (0.1, 49)])
def test_only_sticking_inside_the_bound_counts(
    pair_of: Any, trace_of: Any, setup_of: Any, held: float, switches: int
) -> None:
    trace = wavering(pair_of, trace_of, held)
    found = assess_runs(trace, setup_of(trace))
    assert set(found.series[0].mode[0].tolist()) == {STICK, SLIDE}
    assert found.metrics["mode_switches"][0] == pytest.approx(switches / 1.0)
    assert found.labels[0][0].label == ("chatter" if switches else "stable")


def test_sticking_for_a_moment_inside_the_bound_is_enough(
    pair_of: Any, trace_of: Any, setup_of: Any
) -> None:
    trace = wavering(pair_of, trace_of, 0.99)
    trace.pairs[0].slots[0, 3 * PERIOD + 4, 0, 2] = 0.1
    assert assess_runs(trace, setup_of(trace)).metrics["mode_switches"][0] == pytest.approx(2.0)


def test_a_slide_that_ends_at_the_bound_has_not_stopped(
    pair_of: Any, trace_of: Any, setup_of: Any
) -> None:
    trace = wavering(pair_of, trace_of, 0.99).select([0], PERIOD * 2)
    assert assess_runs(trace, setup_of(trace)).metrics["mode_switches"][0] == 0
