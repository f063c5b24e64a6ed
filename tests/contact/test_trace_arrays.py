"""What is computed in another way than NumPy's keeps every bit."""

import warnings

import numpy as np
import pytest
from tests.random_traces import Sampler

from contactlab.contact.trace_arrays import fast_median, squared_lengths


@pytest.mark.parametrize("width", [1, 2, 3])
def test_squared_lengths_are_sums_to_the_last_bit(width: int) -> None:
    rng = np.random.default_rng(width)
    rows = rng.normal(size=(5, 301, 14)) * 10.0 ** rng.integers(-9, 9, (5, 301, 14))
    vectors = rows[:, :, 4 : 4 + width]
    found = squared_lengths(vectors)
    assert found.tobytes() == (vectors * vectors).sum(axis=-1).tobytes()
    assert np.sqrt(found).tobytes() == np.linalg.norm(vectors, axis=-1).tobytes()


@pytest.mark.parametrize("count", [0, 1, 2, 5, 40, 375])
def test_medians_are_those_of_numpy(count: int) -> None:
    values = Sampler(count).floats(3, 20, count)
    values[:, ::2] = np.nan_to_num(values[:, ::2], nan=-0.0)
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of numbers of which there are none
        expected, found = np.median(values, axis=-1), fast_median(values)
    unknown = np.isnan(expected)
    assert np.isnan(found).tolist() == unknown.tolist()
    assert found[~unknown].tobytes() == expected[~unknown].tobytes()
