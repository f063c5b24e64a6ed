"""Contacts that a pair loses while it sticks: chatter, told from hops, bounces and tumbling."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from contactlab.contact.trace_arrays import LINEAR_VELOCITY, TORQUE, PairTrace, Trace
from contactlab.measure import assess_runs
from contactlab.measure.context import context_of
from contactlab.measure.friction import lost_contacts

STEPS = 500


def pad(pair_of: Any, normal: Any, usage: Any = 0.1, speed: float = 0.2, mu: float = 0.5) -> Any:
    """Return a pair with this normal force (N,) and share of its friction bound, meeting fast."""
    force = np.asarray(normal, dtype=np.float64)[None, :, None]
    tangential = np.asarray(usage) * mu * force
    pair = pair_of(
        1, force.shape[1], normal=force, tangential=tangential[..., None] * [1.0, 0.0], friction=mu
    )
    pair.slots[..., LINEAR_VELOCITY.start] = -speed
    return pair


def bouncing(touch: int, gap: int, peaks: Any = ()) -> np.ndarray:
    """Return a normal force that is lost for `gap` samples after every `touch`, for 1 s."""
    on = np.arange(STEPS) % (touch + gap) < touch
    hits = np.arange(STEPS) // (touch + gap)
    return on * (np.asarray(peaks)[hits] if len(peaks) else 1.0)


def rate(trace: Trace, setup: Any) -> float:
    return float(assess_runs(trace, setup).metrics["contact_losses"][0])


def label(trace: Trace, setup: Any) -> str:
    return assess_runs(trace, setup).labels[0][0].label


def test_a_pad_that_keeps_losing_its_contact_chatters(
    pair_of: Any, trace_of: Any, setup_of: Any
) -> None:
    trace = trace_of(1, STEPS, pairs=(pad(pair_of, bouncing(6, 1)),))
    setup = setup_of(trace)
    assert rate(trace, setup) == (STEPS - 1) // 7
    outcome = assess_runs(trace, setup).labels[0][0]
    assert (outcome.label, outcome.step) == ("chatter", 6)
    assert "lost its contact 71 times" in outcome.reason


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"usage": 0.95}, "it is about to slide"),
        ({"speed": 0.04}, "it rests, and hops by a step"),
        ({"touch": 3, "gap": 4}, "it flies longer than it touches"),
        ({"peaks": 0.98 ** np.arange(STEPS)}, "every impact is weaker than the last"),
    ],
)
def test_what_is_no_chatter(
    pair_of: Any, trace_of: Any, setup_of: Any, changes: dict[str, Any], why: str
) -> None:
    shape = {name: changes.pop(name) for name in ("touch", "gap", "peaks") if name in changes}
    normal = bouncing(shape.get("touch", 6), shape.get("gap", 1), shape.get("peaks", ()))
    trace = trace_of(1, STEPS, pairs=(pad(pair_of, normal, **changes),))
    setup = setup_of(trace)
    assert rate(trace, setup) == 0, why
    assert label(trace, setup) == "stable", why


def test_a_spinning_contact_uses_its_bound_too(pair_of: Any, trace_of: Any, setup_of: Any) -> None:
    pair: PairTrace = pad(pair_of, bouncing(6, 1))
    pair.slots[..., TORQUE.start] = 0.95 * pair.friction[0, 2] * pair.slots[..., 1]
    trace = trace_of(1, STEPS, pairs=(pair,))
    assert rate(trace, setup_of(trace)) == 0


def test_what_ends_soon_is_no_chatter(pair_of: Any, trace_of: Any, setup_of: Any) -> None:
    """As many losses as would be chatter, but within the first fifth of the time in contact."""
    normal = bouncing(6, 1)
    normal[STEPS // 5 :] = 1.0
    trace = trace_of(1, STEPS, pairs=(pad(pair_of, normal),))
    setup = setup_of(trace)
    assert rate(trace, setup) > 5
    assert label(trace, setup) == "stable"


@pytest.mark.parametrize(
    ("loses", "steered", "share", "chatters"),
    [
        (False, False, 0.09, False),  # Dry friction sticks and slides.
        (False, False, 0.11, True),
        (True, False, 0.09, True),  # A bounce that nothing feeds would die out.
        (True, True, 0.09, False),  # A drive may shake what it holds.
        (True, True, 0.11, True),
    ],
)
def test_what_the_model_does_by_itself_is_no_chatter(
    pair_of: Any,
    trace_of: Any,
    setup_of: Any,
    checks_of: Any,
    *,
    loses: bool,
    steered: bool,
    share: float,
    chatters: bool,
) -> None:
    slides = np.arange(STEPS) // 10 % 2 == 0
    slipping = pair_of(
        1,
        STEPS,
        normal=1.0,
        tangential=np.where(slides, 0.5, 0.05)[None, :, None, None] * [1.0, 0.0],
        velocity=np.where(slides, 6e-3, 1e-3)[None, :, None, None] * [1.0, 0.0],
    )
    pair = pad(pair_of, bouncing(6, 1)) if loses else slipping
    trace = trace_of(1, STEPS, pairs=(pair,))
    setup = setup_of(trace, steered=steered)
    assert label(trace, setup) == "chatter"
    found = assess_runs(trace, setup, checks_of(STEPS, backward=share)).labels[0]
    assert ("chatter" in {each.label for each in found}) == chatters


def slow_losses(normal: np.ndarray, usage: np.ndarray, longest: int) -> list[int]:
    """The rule for one run that never slides, contact by contact."""
    found: list[int] = []
    edges = np.flatnonzero(np.diff(np.concatenate([[0], normal > 0, [0]])))
    touches = list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
    for (start, stop), (begin, end) in pairwise(touches):
        gap = begin - stop
        short = gap <= min(stop - start, longest)
        held = max(usage[stop - 1], usage[begin]) < 0.9
        hard = normal[begin:end].max() >= 0.99 * normal[start:stop].max()
        if short and held and hard:
            found.append(stop)
    return found


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.tuples(st.integers(1, 4), st.integers(1, 6), st.sampled_from([1.0, 0.995, 0.9, 2.0])),
        min_size=1,
        max_size=12,
    ),
    st.integers(0, 2**32 - 1),
)
def test_equal_to_the_rule_contact_by_contact(
    trace_of: Any, setup_of: Any, stretches: list[tuple[int, int, float]], seed: int
) -> None:
    normal = np.concatenate([[0.0] * gap + [peak] * touch for gap, touch, peak in stretches])
    usage = np.random.default_rng(seed).choice([0.1, 0.89, 0.91], len(normal))
    block = np.zeros((1, len(normal), 1, 23))
    block[0, :, 0, 0] = normal > 0
    block[0, :, 0, 1] = normal
    block[0, :, 0, 2] = usage * normal
    block[0, :, 0, LINEAR_VELOCITY.start] = 1.0
    pair = PairTrace("floor-box", block, np.ones((1, 5)))
    trace = trace_of(1, len(normal), pairs=(pair,))
    context = context_of(trace, setup_of(trace))
    expected = slow_losses(normal, usage, longest=50)
    assert lost_contacts(context, 0).start.tolist() == expected
