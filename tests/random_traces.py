"""Random traces of any size, for tests of what writes and reads them."""

from typing import Any

import numpy as np
from hypothesis import strategies as st

from contactlab.contact.trace_arrays import FOUND, SLOT_WIDTH, PairSeries, PairTrace, Trace

SPECIALS = (np.nan, np.inf, -np.inf, 0.0, -0.0, 5e-324, 1.7976931348623157e308)


def trace_sizes(steps: int, runs: int) -> st.SearchStrategy[dict[str, Any]]:
    """Return what draws the arguments of a random trace, of so many steps and runs at most."""
    return st.fixed_dictionaries(
        {
            "nq": st.integers(0, 9),
            "nv": st.integers(0, 9),
            "pairs": st.lists(st.text("abc-/ é%", max_size=5), unique=True, max_size=3).map(tuple),
            "slots": st.integers(0, 4),
            "steps": st.integers(0, steps),
            "runs": st.integers(1, runs),
            "momentum": st.booleans(),
            "seed": st.integers(0, 2**32 - 1),
        }
    )


class Sampler:
    """Random arrays, a tenth of whose numbers are the awkward ones."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def floats(self, *shape: int) -> np.ndarray[Any, np.dtype[np.float64]]:
        values = self.rng.standard_normal(shape) * 10.0 ** self.rng.integers(-9, 9, shape)
        awkward = self.rng.random(shape) < 0.1
        return np.where(awkward, self.rng.choice(SPECIALS, shape), values)

    def counts(self, *shape: int) -> np.ndarray[Any, np.dtype[np.int32]]:
        return self.rng.integers(0, 1000, shape).astype(np.int32)

    def time(self, runs: int, rows: int) -> np.ndarray[Any, np.dtype[np.float64]]:
        start = self.rng.choice([0.0, 1.5], (runs, 1))
        return np.cumsum(np.hstack([start, self.rng.uniform(1e-6, 0.1, (runs, rows - 1))]), axis=1)

    def pair(self, name: str, runs: int, steps: int, slots: int) -> tuple[PairTrace, PairSeries]:
        values = self.floats(runs, steps, slots, SLOT_WIDTH)
        counts = (self.rng.random((runs, steps, slots)) < self.rng.choice([0.0, 0.3, 0.9])).sum(
            axis=2
        )
        touching = np.arange(slots) < counts[..., None]
        found = touching.sum(axis=2, keepdims=True) + self.rng.integers(0, 3, (runs, steps, 1))
        values[..., FOUND] = np.where(touching, found, 0)
        net = [self.floats(runs, steps) for _ in range(5)]
        mode = self.rng.integers(0, 3, (runs, steps)).astype(np.int8)
        contacts = touching.sum(axis=2).astype(np.int32)
        series = PairSeries(name, contacts, *net, mode=mode)
        return PairTrace(name, values, np.ones((runs, 5))), series


def random_trace(
    *,
    nq: int = 7,
    nv: int = 6,
    pairs: tuple[str, ...] = ("floor-ball",),
    slots: int = 3,
    steps: int = 20,
    runs: int = 1,
    momentum: bool = False,
    seed: int = 0,
) -> tuple[Trace, list[PairSeries]]:
    make = Sampler(seed)
    sampled = [make.pair(name, runs, steps, slots) for name in pairs]
    trace = Trace(
        timestep=make.rng.uniform(1e-4, 1e-2, runs),
        steps_asked=steps,
        time=make.time(runs, steps + 1),
        qpos=make.floats(runs, steps + 1, nq),
        qvel=make.floats(runs, steps + 1, nv),
        kinetic=make.floats(runs, steps),
        potential=make.floats(runs, steps),
        contacts=make.counts(runs, steps),
        least_distance=make.floats(runs, steps),
        iterations=make.counts(runs, steps),
        iterations_most=make.counts(runs, steps),
        momentum=make.floats(runs, steps, 3) if momentum else None,
        angular_momentum=make.floats(runs, steps, 3) if momentum else None,
        pairs=tuple(pair for pair, _ in sampled),
        warnings=({},) * runs,
    )
    return trace, [series for _, series in sampled]
