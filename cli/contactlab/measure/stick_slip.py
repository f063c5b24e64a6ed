"""Stick or slide: the mode of a pair over time, from its net force and slip.

The rule, with hysteresis, for samples that carry force:

* slide from the sample where the friction bound is in full use (usage >= .999) and the pair slips
  at least as fast as after a free fall of 0.5 ms, 4.9 mm/s on Earth; stick from the sample where
  usage is below .98 or slip below half of that; between the two nothing changes. For entering,
  usage is that of the net force, because single contacts of a body at rest may be at their bound;
  for leaving, it is that of the contacts one by one, because those of a body that turns as it
  slides pull in different directions;
* a contact that begins, or begins again after more than 100 ms, sticks unless it meets the rule
  for sliding;
* a gap between contacts of up to 100 ms holds the last mode: sliding bodies hop by micrometers,
  and touch in half of the steps only. Longer gaps, and the time before the first contact, are
  NO_CONTACT throughout. A gap that the end of the run cuts off counts by its length so far.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import NO_CONTACT, SLIDE, STICK, Floats
from contactlab.numerical_tolerance import COARSE_ROUNDING

ENTER_SLIP, LEAVE_SLIP = 5e-4, 2.5e-4  # slip speeds over gravity: times of a free fall [s]
IMPACT = 10 * ENTER_SLIP
"""Fall time that gives the least speed of an impact [s]; hops of resting bodies are slower."""
HELD_USAGE = 0.9  # a sticking pair holds below this share of the friction bound
Modes = NDArray[np.int8]
Rows = NDArray[np.intp]


@dataclass(frozen=True)
class Spans:
    """Stretches of steps [start, stop) with a condition, in order of run and time."""

    run: Rows
    start: Rows
    stop: Rows


def find_spans(mask: NDArray[np.bool_]) -> Spans:
    """Return the stretches of true steps in `mask` (n, N)."""
    runs, steps = mask.shape
    padded_mask = np.zeros((runs, steps + 2), dtype=np.bool_)
    padded_mask[:, 1:-1] = mask
    edges = np.flatnonzero(padded_mask[:, 1:] != padded_mask[:, :-1])
    run, step = np.divmod(edges, steps + 1)
    return Spans(run[::2], step[::2], step[1::2])


def contact_modes(
    bearing: NDArray[np.bool_], usage: Floats, grip: Floats, slip: Floats, timestep: Floats
) -> Modes:
    """Return the modes (..., n, N) of pairs by the rule of this module.

    (..., n, N) each: whether they carry a normal force, the share of the friction bound that the
    net force uses and that the single contacts use, and slip over gravity [s]; and timesteps (n,)
    [s].
    """
    *shape, steps = bearing.shape
    longest_gap = 0.1  # longest gap between contacts [s] that holds the mode
    longest = np.broadcast_to(np.floor(longest_gap / timestep + COARSE_ROUNDING), shape).ravel()
    enter_usage, leave_usage = 0.999, 0.98
    enter = (usage >= enter_usage) & (slip >= ENTER_SLIP) & bearing
    leave = ((grip < leave_usage) | (slip < LEAVE_SLIP)) & bearing
    events = (enter * np.int8(SLIDE) + leave * np.int8(STICK)).reshape(len(longest), steps)
    # Long gaps, and contacts that begin again, are events, too.
    carries = bearing.reshape(events.shape)
    gaps = find_spans(~carries)
    long = (gaps.start == 0) | (gaps.stop - gaps.start > longest[gaps.run])
    separated = 3  # stands for NO_CONTACT among the events, where 0 means that nothing happens
    events[gaps.run[long], gaps.start[long]] = separated
    again = long & (gaps.stop < steps)
    _begin_contact(events, gaps.run[again], gaps.stop[again])
    if steps:
        first = np.flatnonzero(carries[:, 0])
        _begin_contact(events, first, np.zeros_like(first))
    # At each sample, the last event at or before it; 0 means that nothing happens.
    step = np.arange(1, steps + 1, dtype=np.int32) * 4
    dated = np.where(events == 0, 0, step + events)
    last_modes = (np.maximum.accumulate(dated, axis=1) & 3).astype(np.int8)
    last_modes[last_modes == separated] = NO_CONTACT
    return last_modes.reshape(bearing.shape)


def _begin_contact(events: Modes, run: Rows, step: Rows) -> None:
    events[run, step] = np.where(events[run, step] == SLIDE, SLIDE, STICK)


def mode_changes(mode: Modes, normal: Floats, usage: Floats) -> NDArray[np.bool_]:
    """Return (n, N - 1) whether a pair changes between stick and slide at the next sample.

    (n, N) each: its mode, normal force, and share of the friction bound in use. Sticking that never
    uses less than 0.9 of the friction bound belongs to the neighboring slides: a slow slide with a
    speed near the least that counts as sliding does not stick.
    """
    stick = find_spans(mode == STICK)
    is_held = (normal > 0) & (usage < HELD_USAGE)
    before = np.zeros((mode.shape[0], mode.shape[1] + 1), dtype=np.int32)
    np.cumsum(is_held, axis=1, out=before[:, 1:])
    long_modes = mode.copy()
    for run, start, stop in zip(stick.run, stick.start, stick.stop, strict=True):
        if before[run, stop] == before[run, start]:
            long_modes[run, start:stop] = SLIDE
    return long_modes[:, 1:] + long_modes[:, :-1] == STICK + SLIDE
