"""What shakes from step to step is told from what moves or is hit."""

import numpy as np
import pytest

from contactlab.contact.trace_arrays import motion_at_rest

STEPS = np.arange(400)


@pytest.mark.parametrize("amplitude", [1e-3, 2.0])
def test_amplitude_is_that_of_what_alternates(amplitude: float) -> None:
    speed = np.where(STEPS % 2, 0.5 - amplitude, 0.5 + amplitude)[:, None]
    rms, found = motion_at_rest(speed)[:, 0]
    assert rms == pytest.approx(np.hypot(0.5, amplitude))
    assert found == pytest.approx(amplitude)


def test_period_of_k_steps_counts_by_the_square_of_its_sine() -> None:
    """A second difference of cos(2 pi n / k) is -4 sin(pi / k)^2 times it; |cos| has median .71."""
    found = motion_at_rest(np.cos(2 * np.pi * STEPS / 16.1)[:, None])[1, 0]
    assert found == pytest.approx(np.sin(np.pi / 16.1) ** 2 / np.sqrt(2), rel=0.05)


def test_single_blows_do_not_alternate() -> None:
    assert motion_at_rest(np.where(STEPS % 50 < 25, 1.0, -1.0)[:, None])[1, 0] == 0
