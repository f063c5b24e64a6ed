"""Label of bodies that do not move as their scene or sweep requires."""

from collections import defaultdict
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.expected_motion import ExpectedMotion
from contactlab.contact.rotations import rotate_vectors
from contactlab.contact.trace_arrays import NO_CONTACT, Floats
from contactlab.measure.context import Context, cached, first_step, runs_where
from contactlab.measure.entries import MeasuredRuns, Onset, OnsetIterator, label
from contactlab.measure.required_contact import (
    MODE_HOLD,
    long_stretches,
    longest_stretch,
    steps_that_count,
)
from contactlab.numerical_tolerance import COARSE_ROUNDING

_DEPARTURE_VERBS = {
    "held": "moves in its grip by",
    "still": "moves by",
    "stays": "goes",
    "upright": "tilts by",
}
Fault = tuple[str, int]
"""The observation that violates a requirement, and its first state."""


@label(
    "noted",
    rank=6,
    thresholds=(MODE_HOLD,),
    judged_on=(("requirement_margin", ""),),
    letter="7",
    colour="#8cbf7a",
    advice="fix the model, or correct the requirement in `must`",
    traits=("required",),
)
def broken_requirement(runs: MeasuredRuns) -> OnsetIterator:
    """A body is not held, still, upright, passing or staying although it must be."""
    context, hold = runs.context, runs.limits["mode_hold"]
    faults = defaultdict[int, list[tuple[int, str, int]]](list)
    for path in _required_paths(context):
        for condition, state in _find_faults(context, path, hold):
            step = min(state, context.trace.steps - 1)
            faults[path.run].append((step, f"{path.expected.name}: {condition}", state))
    for run, run_faults in sorted(faults.items()):
        run_faults.sort()
        times = context.trace.time[run]
        reasons = [f"{reason}, from {times[state]:.4g} s on" for _, reason, state in run_faults]
        yield run, Onset("; ".join(reasons), run_faults[0][0])


class _RequiredPath(NamedTuple):
    """Poses of a body of a run, in states with a requirement."""

    expected: ExpectedMotion
    run: int
    states: NDArray[np.intp]  # (M,)
    place: Floats  # (M, 3) [m]
    turn: Floats  # (M, 4)


@cached
def _required_paths(context: Context) -> list[_RequiredPath]:
    paths, time = list[_RequiredPath](), context.trace.time
    slack = COARSE_ROUNDING * context.trace.timestep[:, None]
    for expected in context.setup.expected:
        if isinstance(expected, ExpectedMotion):
            start, stop = np.moveaxis(expected.window[:, :, None], 1, 0)
            inside = (time >= start - slack) & (time <= stop + slack)
            for run in runs_where(inside.any(axis=1)):
                states = np.flatnonzero(inside[run])
                poses = expected.placing[run](context.trace.qpos[run, states])
                paths.append(_RequiredPath(expected, run, states, *poses))
    return paths


def motion_margins(context: Context, hold: float) -> Floats:
    """Return (n,) the least margin of the requirements of bodies, as a share of the limit.

    For the holder of a body, 1 less the longest time [s] without contact over the shortest that
    counts, `hold`. Infinite without requirements; NaN if a state is NaN.
    """
    least = np.full(context.trace.runs, np.inf)
    for path in _required_paths(context):
        limit, word = path.expected.limit, path.expected.word
        if word == "passes":
            _, offset = _plane_crossings(path.place)
            # The nearest crossing counts, or the distance of a path without one from the plane.
            height = np.abs(path.place[:, 2])
            margin = float(1 - offset.min() / limit if len(offset) else -height.min() / limit)
        else:
            amount, _ = _path_departure(path)
            margin = float(1 - amount.max() / limit)
        if word == "held":
            width = steps_that_count(context, path.run, hold)
            apart = _steps_without_contact(context, path)[1]
            margin = float(np.minimum(margin, 1 - longest_stretch(apart) / width))
        least[path.run] = np.minimum(least[path.run], margin)
    return least


def _steps_without_contact(
    context: Context, path: _RequiredPath
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return steps, and a mask of those without contact of holder and body."""
    rows = context.pairs.rows[[*path.expected.pairs]]
    steps = path.states[path.states < context.trace.steps]
    touching = (context.net.series.mode[rows, path.run] != NO_CONTACT).any(axis=0)
    return steps, ~touching[steps]


def _find_faults(context: Context, path: _RequiredPath, hold: float) -> Iterator[Fault]:
    expected, states = path.expected, path.states
    if expected.word == "passes":
        before, offset = _plane_crossings(path.place)
        if not len(before):
            away = _amount_text(float(np.nanmin(np.abs(path.place[:, 2]))), "m")
            yield f"it stays on one side, {away} away", int(states[-1])
        elif not (offset <= expected.limit).any():
            nearest = int(np.nanargmin(offset))
            least = float(offset[nearest])
            far = _amount_text(least - expected.limit, "m")
            fault = f"it passes at {_amount_text(least, 'm')}, which is {far} too far"
            yield fault, int(states[before[nearest]])
        return
    amount, unit = _path_departure(path)
    # A state with NaN departs by more than any tolerance.
    beyond = ~(amount <= expected.limit)
    if beyond.any():
        worst = float(np.nanmax(np.where(np.isfinite(amount), amount, np.inf)))
        state = int(states[first_step(beyond)])
        far = _amount_text(worst, unit)
        over = _amount_text(worst - expected.limit, unit)
        where = " from where it was" if expected.word == "stays" else ""
        yield f"{_DEPARTURE_VERBS[expected.word]} up to {far}{where}, {over} too much", state
        return
    if expected.word == "held":
        steps, free = _steps_without_contact(context, path)
        apart = long_stretches(free, steps_that_count(context, path.run, hold))
        if apart.any():
            seconds = np.count_nonzero(apart) * float(context.trace.timestep[path.run])
            yield f"its holder does not touch it for {seconds:.3g} s", int(steps[first_step(apart)])


def _path_departure(path: _RequiredPath) -> tuple[Floats, str]:
    """Return (M,) the departure of a body from its required pose, and the unit."""
    expected, run, _, place, turn = path
    if expected.word == "upright":
        axis = np.broadcast_to(expected.axis[run], (len(turn), 3))
        cosine = rotate_vectors(turn, axis) @ expected.up[run]
        return np.arccos(np.clip(cosine, -1, 1)), "rad"
    moved = np.linalg.norm(place - place[0], axis=1)
    if expected.word != "still":
        return moved, "m"
    # The angle between two quaternions is half that between their rotations.
    half = np.arccos(np.clip(np.abs(turn @ turn[0]), 0, 1))
    if expected.angular:
        return 2 * half, "rad"
    return moved + 2 * np.sin(half) * expected.reach, "m"


def _plane_crossings(place: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Return the states after crossings of a path (M, 3) and a hole's plane, and the offsets.

    The path is in the frame of the hole, with the plane across its z axis; offsets are distances to
    that axis.
    """
    height = place[:, 2]
    before = np.flatnonzero(np.sign(height[:-1]) * np.sign(height[1:]) <= 0)
    before = before[height[before] != height[before + 1]]
    share = (height[before] / (height[before] - height[before + 1]))[:, None]
    crossing = (1 - share) * place[before, :2] + share * place[before + 1, :2]
    return before, np.linalg.norm(crossing, axis=1)


def _amount_text(amount: float, unit: str) -> str:
    if unit == "rad":
        return f"{np.degrees(amount):.3g} deg"
    return f"{amount * 1e3:.3g} mm" if amount < 1 else f"{amount:.3g} m"
