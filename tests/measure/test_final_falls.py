"""A body that lost its support and falls until the run ends is in a note of the run."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from contactlab.contact.trace_arrays import Floats
from contactlab.measure.context import context_of
from contactlab.measure.motion import list_final_falls

STEP, STEPS, LEAVES, G, TOP = 2e-3, 400, 200, 9.81, 1.0


def note_on(makers: Any, heights: Floats, *, touching: Any) -> str:
    """Return the note on a run of a box at these heights (N + 1,) [m]."""
    pair_of, trace_of, setup_of = makers
    pair = pair_of(1, STEPS, touching=np.reshape(touching, (1, STEPS, 1)))
    trace = trace_of(steps=STEPS, timestep=STEP, pairs=(pair,))
    trace.qpos[..., 2] = heights
    trace.qvel[..., 2] = np.gradient(heights, STEP)
    setup = replace(setup_of(trace), sides=(("box",),))
    return list_final_falls(context_of(trace, setup)).get(0, "")


@pytest.fixture
def makers(pair_of: Any, trace_of: Any, setup_of: Any) -> Any:
    return pair_of, trace_of, setup_of


def path_of_fall(acceleration: float) -> Floats:
    """Return the height of a body that leaves a table halfway."""
    time = STEP * np.maximum(np.arange(STEPS + 1) - LEAVES, 0)
    return TOP - acceleration * time**2 / 2


on_table = np.arange(STEPS) < LEAVES


def test_a_fall_is_noted_with_its_depth(makers: Any) -> None:
    """It has fallen by g t^2 / 2 in .4 s."""
    note = note_on(makers, path_of_fall(G), touching=on_table)
    assert note == "box falls at the end, 785 mm below all of its contacts"


def test_only_a_fall_at_the_end_is(makers: Any) -> None:
    never, fall = np.zeros(STEPS, bool), path_of_fall(G)
    lands = np.where(np.arange(STEPS + 1) < STEPS - 50, fall, fall[STEPS - 50])
    bounce = TOP + np.abs(np.sin(np.arange(STEPS + 1) / 40))
    for heights, touching in (
        (np.full(STEPS + 1, TOP), on_table),  # it hovers
        (fall, never),  # a drop without a start on anything
        (lands, on_table | (np.arange(STEPS) >= STEPS - 50)),
        (bounce, bounce[:-1] < TOP + 0.01),
        (path_of_fall(G / 4), on_table),  # a parachute
        (path_of_fall(0.1 * G), on_table),  # by less than its size
    ):
        assert note_on(makers, heights, touching=touching) == ""
