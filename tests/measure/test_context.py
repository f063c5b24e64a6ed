"""What measures share: counts of steps, and squared lengths of parts of states."""

import numpy as np
import pytest
from tests.random_traces import Sampler

from contactlab.contact.trace_arrays import squared_lengths
from contactlab.measure.context import count, share, squares_from


@pytest.mark.parametrize("shape", [(7,), (3, 0), (0, 5), (2, 3, 1), (4, 5, 63), (2, 1, 1500)])
@pytest.mark.parametrize("part", [0.0, 0.4, 1.0])
def test_steps_are_counted(shape: tuple[int, ...], part: float) -> None:
    mask = np.random.default_rng(len(shape)).random(shape) < part
    assert count(mask).tolist() == mask.sum(axis=-1).tolist()
    # Of what lies otherwise in memory, too.
    assert count(mask.T).tolist() == mask.T.sum(axis=-1).tolist()
    if mask.size:
        assert share(mask).tobytes() == mask.mean(axis=-1).tobytes()


@pytest.mark.parametrize("width", [3, 4])
def test_squares_are_those_of_each_vector(width: int) -> None:
    states = Sampler(width).floats(3, 20, 30)[:, :, 2:-1]
    starts = [0, 11, 5]
    with np.errstate(all="ignore"):
        expected = [squared_lengths(states[..., start : start + width]) for start in starts]
        assert squares_from(states, starts, width).tobytes() == np.array(expected).tobytes()
    assert squares_from(states, []).shape == (0, 3, 20)
