"""A hold: what is measured in its window alone, and what it is called."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.contact.trace_arrays import (
    FORCE,
    LINEAR_VELOCITY,
    NORMAL,
    SLIDE,
    TANGENT,
    HeldPose,
    PairTrace,
    Trace,
)
from contactlab.contact.trace_setup import HoldWindow, Setup
from contactlab.measure import METRICS, assess_runs
from contactlab.measure.context import context_of, hold_window
from contactlab.measure.friction import hold_switch_masks

Make = Callable[..., Any]
HELD = [name for name in METRICS if name.startswith("hold_")]


def held_setup(make: Make, trace: Trace, start: float, stop: float, **changes: Any) -> Setup:
    runs = trace.runs
    hold = HoldWindow(np.full(runs, start), np.full(runs, stop))
    return make(trace, hold=hold, passive=False, **changes)


def measured(trace: Trace, setup: Setup, name: str) -> float:
    return float(assess_runs(trace, setup).metrics[name][0])


@given(
    timestep=st.sampled_from([5e-4, 1e-3, 2e-3, 3e-3, 4e-3, 7e-3]),
    first=st.integers(0, 40),
    length=st.integers(1, 60),
    nudge=st.floats(-1e-9, 1e-9),
)
def test_a_window_holds_the_steps_that_begin_in_it(
    timestep: float, first: int, length: int, nudge: float, trace_of: Make, setup_of: Make
) -> None:
    """Times that rounding puts beside a whole step count as that step."""
    trace = trace_of(steps=100, timestep=timestep)
    start, stop = first * timestep + nudge * timestep, (first + length) * timestep
    found = hold_window(context_of(trace, held_setup(setup_of, trace, start, stop)))[0]
    expected = [first <= step < first + length for step in range(100)]
    assert found.tolist() == expected


def test_nothing_is_measured_without_a_hold_or_when_a_run_ends_before(
    trace_of: Make, setup_of: Make, pair_of: Make
) -> None:
    pair = pair_of(1, 100, normal=1.0, distance=-4e-3)
    trace = trace_of(pairs=(pair,))
    for setup in (setup_of(trace, passive=False), held_setup(setup_of, trace, 0.1, 0.3)):
        found = assess_runs(trace, setup)
        assert all(np.isnan(found.metrics[name][0]) for name in HELD)
        assert [each.label for each in found.labels[0]] == ["stable"]


def test_each_run_has_its_own_window(trace_of: Make, setup_of: Make, pair_of: Make) -> None:
    depth = np.repeat(np.arange(100)[None, :, None] * -1e-5, 3, axis=0)
    trace = trace_of(runs=3, pairs=(pair_of(3, 100, normal=1.0, distance=depth),))
    trace.timestep[:] = 1e-3, 2e-3, 1e-3
    hold = HoldWindow(np.array([0.01, 0.02, 0.05]), np.array([0.02, 0.04, 0.30]))
    setup = setup_of(trace, hold=hold, passive=False)
    found = assess_runs(trace, setup).metrics["hold_penetration"]
    # Depth is 1e-5 k, k from 10 to 19 in the first two runs; the third ends before its window.
    assert found[:2] == pytest.approx([14.5e-5] * 2, rel=1e-12)
    assert np.isnan(found[2])
    one = trace.select([1]), setup.select([1])
    assert measured(*one, "hold_penetration") == pytest.approx(14.5e-5, rel=1e-12)


def unit(draw: Callable[[Any], Any]) -> np.ndarray:
    vector = np.array(draw(st.tuples(*[st.floats(-1, 1)] * 3)))
    length = np.linalg.norm(vector)
    return vector / length if length > 1e-3 else np.array([1.0, 0, 0])


@st.composite
def moving_pairs(draw: st.DrawFn) -> PairTrace:
    """Return a pair of two contacts with any frames, forces and velocities."""
    steps = 30
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    slots = np.zeros((1, steps, 2, 23))
    slots[..., 0] = 2
    for slot in range(2):
        normal = unit(draw)
        tangent = np.cross(normal, unit(draw))
        length = np.linalg.norm(tangent)
        tangent = tangent / length if length > 1e-3 else np.cross(normal, [0.36, 0.48, 0.8])
        slots[0, :, slot, NORMAL] = normal
        slots[0, :, slot, TANGENT] = tangent / np.linalg.norm(tangent)
    slots[..., LINEAR_VELOCITY] = random.normal(size=(1, steps, 2, 3))
    slots[..., FORCE.start] = np.maximum(random.normal(size=(1, steps, 2)), 0)
    return PairTrace("pad-mug", slots, np.tile([1.0, 1.0, 0.005, 1e-4, 1e-4], (1, 1)))


@given(pair=moving_pairs())
def test_slip_equals_the_slow_sum(pair: PairTrace, trace_of: Make, setup_of: Make) -> None:
    """The farthest that a pair gets from where it was, in the tangent planes, by force's weight."""
    trace = trace_of(steps=30, timestep=1e-3, pairs=(pair,))
    found = measured(trace, held_setup(setup_of, trace, 0.005, 0.025), "hold_slip")
    place, farthest = np.zeros(3), 0.0
    for step in range(5, 25):
        way, total = np.zeros(3), 0.0
        for slot in pair.slots[0, step]:
            second = np.cross(slot[NORMAL], slot[TANGENT])
            _, along, across = slot[LINEAR_VELOCITY]
            way += slot[FORCE.start] * (along * slot[TANGENT] + across * second)
            total += slot[FORCE.start]
        if total > 0:
            place = place + 1e-3 * way / total
        farthest = max(farthest, float(np.linalg.norm(place)))
    assert found == pytest.approx(farthest, rel=1e-9, abs=1e-9)


def test_jitter_cancels_and_creep_adds_up(trace_of: Make, setup_of: Make, pair_of: Make) -> None:
    jitter = np.zeros((1, 100, 1, 2))
    jitter[0, ::2, 0, 0], jitter[0, 1::2, 0, 0] = 0.01, -0.01
    for extra, expected in ((0.0, 0.01 * 2e-3), (1e-3, 1e-3 * 0.1)):
        pair = pair_of(1, 100, normal=1.0, velocity=jitter + extra * np.array([0, 1.0]))
        trace = trace_of(pairs=(pair,))
        found = measured(trace, held_setup(setup_of, trace, 0.05, 0.15), "hold_slip")
        assert found == pytest.approx(expected, rel=0.02)


def turn_of(vector: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the quaternion of a turn about a unit vector, and its matrix by Rodrigues' formula."""
    quaternion = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * vector])
    cross = np.cross(np.eye(3), vector)
    matrix = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return quaternion, matrix


@given(data=st.data(), angle=st.floats(-3, 3), sink=st.floats(-0.1, 0.1), side=st.floats(0, 0.1))
def test_drop_is_along_gravity_however_the_holder_is_turned(
    data: st.DataObject, angle: float, sink: float, side: float, trace_of: Make, setup_of: Make
) -> None:
    """In the world the subject sinks by `sink` within the window, and moves sideways as well."""
    quaternion, matrix = turn_of(unit(data.draw), angle)
    share = np.clip((np.arange(100) - 20) / 49, 0, 1)[:, None]
    world = np.array([0.1, 0.2, 0.3]) + share * np.array([side, 0, -sink])
    held = HeldPose((world @ matrix)[None], np.tile(quaternion, (1, 100, 1)))
    trace = trace_of(held_pose=held)
    setup = held_setup(setup_of, trace, 20 * 2e-3, 70 * 2e-3)
    assert measured(trace, setup, "hold_drop") == pytest.approx(sink, abs=2e-9)
    offset = measured(trace, setup, "hold_offset")
    assert offset == pytest.approx(float(np.hypot(sink, side)), abs=2e-9)


def test_offset_is_from_the_start_of_the_run(trace_of: Make, setup_of: Make) -> None:
    place = np.zeros((1, 100, 3))
    place[0, 10:, 2] = -0.05
    still = np.tile([1.0, 0, 0, 0], (1, 100, 1))
    trace = trace_of(held_pose=HeldPose(place, still))
    setup = held_setup(setup_of, trace, 0.1, 0.2)
    assert measured(trace, setup, "hold_offset") == pytest.approx(0.05)
    assert measured(trace, setup, "hold_drop") == 0
    limited = replace(setup, thresholds={"hold_offset": 2e-3})
    (label,) = assess_runs(trace, limited).labels[0]
    assert label.label == "slipping"
    assert label.step == 10
    assert "50 mm" in label.reason
    assert assess_runs(trace, setup).labels[0][0].label == "stable"


def bouncing(pair_of: Make, start: int, stop: int) -> PairTrace:
    """Return a pair that loses its contact in every second step of a stretch."""
    normal = np.ones((1, 100, 1))
    normal[0, start:stop:2] = 0
    return pair_of(1, 100, normal=normal)


def test_lost_contact_counts_in_a_hold_alone(trace_of: Make, setup_of: Make, pair_of: Make) -> None:
    trace = trace_of(pairs=(bouncing(pair_of, 51, 95),))
    setup = held_setup(setup_of, trace, 0.1, 0.2)
    # Steps 51, 53 ... 93: each is left and entered once, in 0.1 s.
    assert measured(trace, setup, "hold_switches") == pytest.approx(2 * 22 / 0.1)
    assert assess_runs(trace, setup).labels[0][0].label == "chatter"
    plain = setup_of(trace, passive=False)
    assert measured(trace, plain, "mode_switches") == 0
    assert assess_runs(trace, plain).labels[0][0].label == "stable"


def test_chatter_outside_the_hold_is_none(trace_of: Make, setup_of: Make, pair_of: Make) -> None:
    trace = trace_of(pairs=(bouncing(pair_of, 3, 47),))
    setup = held_setup(setup_of, trace, 0.1, 0.2)
    assert measured(trace, setup, "hold_switches") == 0
    assert assess_runs(trace, setup).labels[0][0].label == "stable"


def test_what_slides_hops_and_does_not_switch(
    trace_of: Make, setup_of: Make, pair_of: Make
) -> None:
    normal = np.ones((1, 100, 1))
    normal[0, 1::2] = 0
    sliding = np.zeros((1, 100, 1, 2))
    sliding[..., 0] = 1.0
    pair = pair_of(
        1, 100, normal=normal, tangential=0.5 * sliding * normal[..., None], velocity=sliding
    )
    trace = trace_of(pairs=(pair,))
    context = context_of(trace, held_setup(setup_of, trace, 0.1, 0.2))
    assert (context.series[0].mode[0] == SLIDE).all()
    assert not hold_switch_masks(context)[0].any()
    labels = [each.label for each in assess_runs(trace, context.setup).labels[0]]
    # It moves by 1 m/s in half of the steps.
    assert "slipping" in labels
    assert "chatter" not in labels


@pytest.mark.parametrize(
    ("depth", "expected"),
    [
        (1.9, set()),
        (2.1, {"exploited", "deep_penetration"}),
        (4.1, {"exploited", "broken", "deep_penetration", "tunneling"}),
    ],
)
def test_bands_of_depth(
    depth: float, expected: set[str], trace_of: Make, setup_of: Make, pair_of: Make
) -> None:
    """A grip may be half as deep as what rests, whose half extent is 4 in any unit."""
    trace = trace_of(pairs=(pair_of(1, 100, normal=1.0, distance=-depth),))
    setup = held_setup(setup_of, trace, 0.1, 0.2, thickness=np.array([4.0]))
    labels = assess_runs(trace, setup).labels[0]
    assert {each.label for each in labels} - {"stable"} == expected


def test_the_mean_counts_and_not_a_single_step(
    trace_of: Make, setup_of: Make, pair_of: Make
) -> None:
    depth = np.full((1, 100, 1), -1e-3)
    depth[0, 60] = -8e-3
    trace = trace_of(pairs=(pair_of(1, 100, normal=1.0, distance=depth),))
    setup = held_setup(setup_of, trace, 0.1, 0.2)
    assert measured(trace, setup, "hold_penetration") == pytest.approx((49 + 8) / 50 * 1e-3)
    assert assess_runs(trace, setup).labels[0][0].label == "stable"


def test_what_nothing_touches_is_not_held(trace_of: Make, setup_of: Make, pair_of: Make) -> None:
    normal = np.ones((1, 100, 1))
    normal[0, 40:] = 0
    trace = trace_of(pairs=(pair_of(1, 100, normal=normal),))
    setup = held_setup(setup_of, trace, 0.1, 0.2)
    assert measured(trace, setup, "hold_contact") == 0
    (label,) = assess_runs(trace, setup).labels[0]
    assert label.label == "slipping"
    assert "no contact carried force in 100 %" in label.reason


def test_contacts_beyond_the_slots_are_said(trace_of: Make, setup_of: Make, pair_of: Make) -> None:
    pair = pair_of(1, 100, slots=2, normal=1.0)
    pair.slots[0, 30:33, :, 0] = 5
    trace = trace_of(pairs=(pair,))
    found = assess_runs(trace, setup_of(trace))
    assert found.metrics["contacts_cut"][0] == 3
    (label,) = found.labels[0]
    assert (label.label, label.step) == ("contacts_cut", 30)
    assert "up to 5 contacts, but only 2 were recorded, in 3 steps" in label.reason
    assert assess_runs(trace, setup_of(trace, slots=np.array([5]))).labels[0][0].label == "stable"


@pytest.mark.parametrize(
    ("asked", "found"), [({}, True), ({"pierced": 3e-3}, False), ({"pierced": 1e-3}, True)]
)
def test_a_scene_may_say_how_deep_is_through(
    asked: dict[str, float], found: bool, trace_of: Make, setup_of: Make, pair_of: Make
) -> None:
    """2.5 mm, where the thinner is 4 mm thick."""
    distance = np.zeros((1, 100, 1))
    distance[0, 40] = -2.5e-3
    trace = trace_of(pairs=(pair_of(1, 100, normal=1.0, distance=distance),))
    setup = setup_of(trace, passive=False, thickness=np.array([2e-3]), thresholds=asked)
    labels = assess_runs(trace, setup).labels[0]
    assert ("tunneling" in {each.label for each in labels}) == found
    assert not found or labels[0].step == 40
