"""Stick or slide, against the rule spelled out sample by sample."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import NO_CONTACT, SLIDE, STICK, Floats
from contactlab.measure.stick_slip import contact_modes, find_spans

LEVELS_USAGE = st.sampled_from([0.0, 0.979, 0.98, 0.99, 0.999, 1.0, np.nan])
LEVELS_SLIP = st.sampled_from([0.0, 2.4e-4, 2.5e-4, 4e-4, 5e-4, 1.0, np.nan])


def switches(mode: NDArray[np.int8]) -> int:
    """Count changes between stick and slide from one sample to the next."""
    return int((np.abs(np.diff(mode)) * (mode[:, 1:] * mode[:, :-1] > 0)).sum())


def slow_modes(
    bearing: Floats, usage: Floats, grip: Floats, slip: Floats, longest: int
) -> list[int]:
    """The rule for one run: first what each contact does, then what gaps hold."""
    found, last, gap = [NO_CONTACT] * len(bearing), NO_CONTACT, longest + 1
    for k, touches in enumerate(bearing):
        if not touches:
            gap += 1
            continue
        if gap > longest:
            last = STICK
        else:
            found[k - gap : k] = [last] * gap
        gap = 0
        if last == STICK and usage[k] >= 0.999 and slip[k] >= 5e-4:
            last = SLIDE
        elif last == SLIDE and (grip[k] < 0.98 or slip[k] < 2.5e-4):
            last = STICK
        found[k] = last
    if gap <= longest:
        found[len(found) - gap :] = [last] * gap
    return found


@given(st.data(), st.integers(0, 40), st.integers(1, 4), st.integers(1, 6))
def test_equal_to_the_rule_sample_by_sample(
    data: st.DataObject, steps: int, runs: int, longest: int
) -> None:
    shape = (runs, steps)
    bearing = data.draw(arrays(np.bool_, shape))
    usage = data.draw(arrays(np.float64, shape, elements=LEVELS_USAGE))
    grip = np.fmax(usage, data.draw(arrays(np.float64, shape, elements=LEVELS_USAGE)))
    slip = data.draw(arrays(np.float64, shape, elements=LEVELS_SLIP))
    timestep = np.full(runs, 0.1 / longest)
    expected = [slow_modes(bearing[k], usage[k], grip[k], slip[k], longest) for k in range(runs)]
    assert contact_modes(bearing, usage, grip, slip, timestep).tolist() == expected


@given(arrays(np.bool_, st.tuples(st.integers(1, 3), st.integers(0, 30))))
def test_spans_cover_a_mask(mask: np.ndarray) -> None:
    found = find_spans(mask)
    painted = np.zeros_like(mask)
    for run, start, stop in zip(found.run, found.start, found.stop, strict=True):
        assert start < stop
        assert not painted[run, max(start - 1, 0) : stop + 1].any()
        painted[run, start:stop] = True
    assert (painted == mask).all()


@pytest.mark.parametrize("contact_share", [0.52, 0.78])
def test_a_slide_with_micro_hops_that_stops_is_one_switch(contact_share: float) -> None:
    steps, timestep = 500, 2e-3
    rng = np.random.default_rng(1)
    slip = np.maximum(1 - 4.905 * timestep * np.arange(steps), 0)
    bearing = (rng.random(steps) < contact_share) | (slip == 0)
    usage = np.where(slip > 0, 1.0, 0.0)
    mode = contact_modes(bearing[None], usage[None], usage[None], slip[None], np.array([timestep]))
    assert switches(mode) == 1
    assert (mode[0, bearing.argmax() : 90] == SLIDE).all()
    assert (mode[0, 110:] == STICK).all()
    naive = np.where(bearing, np.where(usage > 0.999, SLIDE, STICK), NO_CONTACT)
    assert np.count_nonzero(np.diff(naive)) > 20


def test_a_pad_that_alternates_switches_at_every_change() -> None:
    slip = np.where(np.arange(200) // 20 % 2, 1e-3, 0.0)
    touching, usage = np.ones((1, 200), dtype=np.bool_), slip[None] * 1e3
    mode = contact_modes(touching, usage, usage, slip[None], np.array([2e-3]))
    assert switches(mode) == 9


def test_gaps_hold_up_to_a_tenth_of_a_second_and_no_longer() -> None:
    bearing = np.ones((2, 200), dtype=np.bool_)
    bearing[0, 50:100] = bearing[1, 50:101] = False
    sliding = np.ones((2, 200))
    mode = contact_modes(bearing, sliding, sliding, sliding, np.full(2, 2e-3))
    assert (mode[0] == SLIDE).all()
    assert (mode[1, 50:101] == NO_CONTACT).all()
    assert switches(mode) == 0
