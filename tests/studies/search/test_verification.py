"""What is verified next after a candidate failed."""

import pytest

from contactlab.studies.search.configuration import Configuration
from contactlab.studies.search.settings_search import Evaluation
from contactlab.studies.search.verification import (
    FailureBound,
    step_fraction,
)
from contactlab.tasks.reference_error import ErrorEstimate


@pytest.mark.parametrize("ladder", [0.25, 0.02, 5.0])
def test_what_failed_is_followed_by_steps_that_hold_in_first_order(ladder: float) -> None:
    """An error of `ladder` a step keeps a limit of 0.1 after one more verdict, not after many."""
    step, limit, verdicts = 10.0, 0.1, 0
    while ladder * step > limit:
        step *= step_fraction(ladder * step, limit)
        verdicts += 1
    assert verdicts <= 1 + (0.6 < limit / (ladder * 10.0) < 1)
    # Nothing that the judge told no share of, or that failed within its limit, is tried unchanged.
    assert step_fraction(None, limit) == step_fraction(0.05, limit) < 1


def _tried(multiple: int, share: float, integrator: str = "RK4") -> Evaluation:
    error = ErrorEstimate(share, "body", "phase", 0.0, share, share)
    return Evaluation(Configuration({"integrator": integrator}, multiple), error)


def test_no_step_is_tried_again_that_was_too_long_for_its_integrator() -> None:
    """Where errors fall fast with steps, a smaller one is no reason for a step that failed."""
    below = FailureBound().tightened_by(_tried(25, 0.03), 0.6)
    assert not below.admits(_tried(25, 0.01))
    assert not below.admits(_tried(28, 0.01))
    assert not below.admits(_tried(24, 0.018))  # within 20 % of one that failed
    assert below.admits(_tried(20, 0.018))
    assert below.admits(_tried(15, 0.03))
    assert not below.admits(_tried(20, 0.02))
    # Of another integrator, only the last one that failed tells.
    after = below.tightened_by(_tried(6, 0.1, "Euler"), 0.6)
    assert not after.admits(_tried(28, 0.046))
    assert after.admits(_tried(20, 0.046))
    assert after.admits(_tried(28, 0.046, "implicit"))
