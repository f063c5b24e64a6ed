"""What is summed in another way than NumPy's keeps every bit."""

import numpy as np
import pytest

from contactlab.contact.trace_arrays import squared_lengths


@pytest.mark.parametrize("width", [1, 2, 3])
def test_squared_lengths_are_sums_to_the_last_bit(width: int) -> None:
    rng = np.random.default_rng(width)
    rows = rng.normal(size=(5, 301, 14)) * 10.0 ** rng.integers(-9, 9, (5, 301, 14))
    vectors = rows[:, :, 4 : 4 + width]
    found = squared_lengths(vectors)
    assert found.tobytes() == (vectors * vectors).sum(axis=-1).tobytes()
    assert np.sqrt(found).tobytes() == np.linalg.norm(vectors, axis=-1).tobytes()
