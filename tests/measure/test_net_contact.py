"""Net force and slip of a pair, against a sum over contacts spelled out."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactlab.contact.trace_arrays import Floats, PairTrace
from contactlab.measure import context_of
from contactlab.measure.net_contact import net_contact

PULL = np.array([9.81])
ELLIPTIC, PYRAMIDAL = np.array([True]), np.array([False])
STEP = np.array([1e-3])


def random_pair(seed: int, slots: int, *, common: bool, stretch: float = 1) -> PairTrace:
    """Contacts in a random number of slots, with random or common frames; forces in the cone."""
    rng, steps, mu = np.random.default_rng(seed), 12, 0.6
    block = np.zeros((1, steps, slots, 23))
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    for k in range(steps):
        count = int(rng.integers(0, slots + 1))
        for s in range(count):
            axes = frame if common else np.linalg.qr(rng.normal(size=(3, 3)))[0]
            block[0, k, s] = rng.normal(size=23)
            block[0, k, s, 0] = count
            block[0, k, s, 1] = rng.uniform(0.1, 5)
            block[0, k, s, 11:14], block[0, k, s, 14:17] = axes[0], axes[1]
    return PairTrace("a-b", block, np.array([[mu, mu / stretch, 0.005, 1e-4, 1e-4]]))


def slow_fold(pair: PairTrace, step: int, *, elliptic: bool) -> dict[str, Any]:
    rows = [row for row in pair.slots[0, step] if row[0] > 0]
    if not rows:
        return dict.fromkeys(("normal", "tangential", "usage", "grip", "slip", "distance"), 0.0)
    frames = [(row[14:17], np.cross(row[11:14], row[14:17])) for row in rows]
    normal = sum(row[1] for row in rows)
    force: Floats = np.zeros(3)
    drift: Floats = np.zeros(3)
    for row, (first, second) in zip(rows, frames, strict=True):
        force += row[2] * first + row[3] * second
        drift += row[1] * (row[18] * first + row[19] * second) / normal
    mu, across_mu = pair.friction[0, :2]
    each = [(abs(row[2]) / mu, abs(row[3]) / across_mu) for row in rows]
    along, across = (float(force @ axis) for axis in frames[0])
    rest = float(force @ force) - along**2 - across**2
    if elliptic:
        used = np.sqrt((along / mu) ** 2 + (across / across_mu) ** 2 + rest / mu**2)
    else:
        used = abs(along) / mu + abs(across) / across_mu
    return {
        "normal": normal,
        "tangential": np.linalg.norm(force),
        "usage": used / normal,
        "grip": sum(np.hypot(*one) if elliptic else sum(one) for one in each) / normal,
        "slip": np.linalg.norm(drift),
        "distance": min(row[7] for row in rows),
    }


@settings(deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 4), st.booleans(), st.booleans(), st.booleans())
def test_equal_to_the_sum_over_contacts(
    seed: int, slots: int, common: bool, elliptic: bool, stretched: bool
) -> None:
    pair = random_pair(seed, slots, common=common, stretch=1.7 if stretched else 1)
    folded = net_contact([pair], PULL, np.array([elliptic]), STEP, pair.slots.shape[1])
    for step in range(pair.slots.shape[1]):
        for name, value in slow_fold(pair, step, elliptic=elliptic).items():
            # A dozen sums and products of numbers of order 1 to 10.
            found = folded.grip if name == "grip" else getattr(folded.series, name)
            assert found[0, 0, step] == pytest.approx(value, abs=1e-11), name


def test_opposite_pads_do_not_cancel(pair_of: Any) -> None:
    pair = pair_of(1, 1, slots=2, normal=1.0, tangential=(0.3, 0.0))
    pair.slots[0, 0, 1, 11:14] *= -1
    folded = net_contact([pair], PULL, ELLIPTIC, STEP, pair.slots.shape[1])
    assert folded.series.normal[0, 0, 0] == 2
    assert folded.series.tangential[0, 0, 0] == pytest.approx(0.6)


def test_the_cone_has_its_own_norm(pair_of: Any) -> None:
    pair = pair_of(1, 1, normal=1.0, tangential=(0.25, 0.25), friction=0.5)
    assert net_contact([pair], PULL, PYRAMIDAL, STEP, pair.slots.shape[1]).series.usage[
        0, 0, 0
    ] == pytest.approx(1)
    assert net_contact([pair], PULL, ELLIPTIC, STEP, pair.slots.shape[1]).series.usage[
        0, 0, 0
    ] == pytest.approx(np.sqrt(0.5))


@pytest.mark.parametrize("slots", [1, 3])
def test_excess_is_of_the_worst_contact_with_force(pair_of: Any, slots: int) -> None:
    pair = pair_of(1, 4, slots=slots, normal=1.0, tangential=(0.4, 0.0), friction=0.5)
    assert net_contact([pair], PULL, ELLIPTIC, STEP, pair.slots.shape[1]).excess[0, 0] == 0
    pair.slots[0, 2, -1, 2] = 0.55
    assert net_contact([pair], PULL, ELLIPTIC, STEP, pair.slots.shape[1]).excess[
        0, 0
    ] == pytest.approx(0.1)
    pair.slots[0, 3, 0, 1:3] = 1e-12, 1
    assert net_contact([pair], PULL, ELLIPTIC, STEP, pair.slots.shape[1]).excess[
        0, 0
    ] == pytest.approx(0.1)


def test_force_without_touch_is_detached_work(pair_of: Any) -> None:
    pair = pair_of(1, 3, slots=2, normal=2.0, distance=-1e-3)
    assert net_contact([pair], PULL, ELLIPTIC, STEP, pair.slots.shape[1]).detached[0, 0] == 0
    pair.slots[0, 1, 1, 7] = 1e-3
    assert net_contact([pair], PULL, ELLIPTIC, STEP, pair.slots.shape[1]).detached[
        0, 0
    ] == pytest.approx(2e-3)


def test_slots_that_lie_apart_in_memory_are_read_alike() -> None:
    pair = random_pair(3, 2, common=False)
    scattered = PairTrace(pair.name, np.asfortranarray(pair.slots), pair.friction)
    assert (
        net_contact([scattered], PULL, ELLIPTIC, STEP, scattered.slots.shape[1]).series.usage
        == net_contact([pair], PULL, ELLIPTIC, STEP, pair.slots.shape[1]).series.usage
    ).all()


@pytest.mark.parametrize("steps", [0, 1])
@pytest.mark.parametrize("slots", [1, 2])
def test_series_of_next_to_nothing(
    pair_of: Any, trace_of: Any, setup_of: Any, steps: int, slots: int
) -> None:
    pair = pair_of(2, steps, slots=slots)
    trace = trace_of(2, steps, pairs=(pair,))
    (series,) = context_of(trace, setup_of(trace)).series
    assert series.mode.shape == (2, steps)
    assert not series.contacts.any()


def test_pairs_and_runs_that_are_reduced_together_do_not_mix() -> None:
    """Of other numbers of slots and forms of the cone, and runs and pairs without contact."""
    made = [random_pair(seed, 1 + seed % 4, common=seed % 2 == 0) for seed in range(12)]
    pairs = [
        PairTrace(
            "a-b",
            np.concatenate([first.slots, second.slots, 0 * first.slots]),
            np.concatenate([first.friction, 2 * second.friction, first.friction]),
        )
        for first, second in zip(made[:8], made[4:], strict=True)
    ]
    elliptic, ones = np.array([True, False, False]), np.ones(3)
    found = net_contact(pairs, 9.81 * ones, elliptic, 1e-3 * ones, 12)
    for row, pair in enumerate(pairs):
        for run in range(3):
            one = PairTrace("a-b", pair.slots[[run]], pair.friction[[run]])
            alone = net_contact([one], PULL, elliptic[[run]], STEP, 12)
            for name, value in [*vars(found).items(), *vars(found.series).items()]:
                if isinstance(value, np.ndarray):
                    own = getattr(alone, name, None)
                    own = getattr(alone.series, name) if own is None else own
                    assert np.array_equal(value[row, run], own[0, 0]), name
