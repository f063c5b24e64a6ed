"""The label of bodies that do not move as their scene or sweep says that they must."""

from collections import defaultdict
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.expected_motion import ExpectedMotion
from contactlab.contact.rotations import rotate
from contactlab.contact.trace_arrays import NO_CONTACT, Floats
from contactlab.measure.context import Context, cached, first_step, runs_where
from contactlab.measure.entries import Found, MeasuredRuns, Onset, label
from contactlab.measure.required_contact import (
    MODE_HOLD,
    lasting,
    longest,
    steps_that_count,
)

_ROUNDING = 1e-6  # share of a step by which a time may miss that of a state
_DOES = {
    "held": "moves in its grip by",
    "still": "moves by",
    "stays": "goes",
    "upright": "tilts by",
}
Fault = tuple[str, int]
"""What is met instead, and the state in which it is first."""


@label(
    "noted",
    rank=6,
    thresholds=(MODE_HOLD,),
    letter="7",
    colour="#8cbf7a",
    advice="`must` says what has to hold: mend the model, or what is required of it",
    traits=("required",),
)
def broken_requirement(runs: MeasuredRuns) -> Found:
    """A body is not held, still, upright, passing or staying although it must."""
    context, hold = runs.context, runs.limits["mode_hold"]
    faults = defaultdict[int, list[tuple[int, str, int]]](list)
    for path in _paths(context):
        for met, state in _faults(context, path, hold):
            step = min(state, context.trace.steps - 1)
            faults[path.run].append((step, f"{path.expected.name}: {met}", state))
    for run, found in sorted(faults.items()):
        found.sort()
        times = context.trace.time[run]
        reasons = [f"{said}, from {times[state]:.4g} s on" for _, said, state in found]
        yield run, Onset("; ".join(reasons), found[0][0])


class _Path(NamedTuple):
    """Where a body of a run is, in states in which something is required of it."""

    expected: ExpectedMotion
    run: int
    states: NDArray[np.intp]  # (M,)
    place: Floats  # (M, 3) [m]
    turn: Floats  # (M, 4)


@cached
def _paths(context: Context) -> list[_Path]:
    """Return the path of each body that something is required of, in each run."""
    paths, time = list[_Path](), context.trace.time
    slack = _ROUNDING * context.trace.timestep[:, None]
    for expected in context.setup.expected:
        if isinstance(expected, ExpectedMotion):
            start, stop = np.moveaxis(expected.window[:, :, None], 1, 0)
            inside = (time >= start - slack) & (time <= stop + slack)
            for run in runs_where(inside.any(axis=1)):
                states = np.flatnonzero(inside[run])
                poses = expected.placing[run](context.trace.qpos[run, states])
                paths.append(_Path(expected, run, states, *poses))
    return paths


def motion_margins(context: Context, hold: float) -> Floats:
    """Return (n,) the least margin of what bodies must do, as a share of its limit.

    Of what holds a body, 1 less the longest time [s] in which that does not touch it over the
    shortest that counts, `hold`. Infinite where nothing is said of any; NaN where a state is no
    number.
    """
    least = np.full(context.trace.runs, np.inf)
    for path in _paths(context):
        least[path.run] = np.minimum(least[path.run], _margin(context, path, hold))
    return least


def _margin(context: Context, path: _Path, hold: float) -> float:
    limit = path.expected.limit
    if path.expected.word == "passes":
        _, beside = _crossings(path.place)
        height = np.abs(path.place[:, 2])
        return float(1 - beside.min() / limit if len(beside) else -height.min() / limit)
    amount, _ = _departure(path)
    margin = float(1 - amount.max() / limit)
    if path.expected.word == "held":
        width = steps_that_count(context, path.run, hold)
        apart = _let_go(context, path)[1]
        return float(np.minimum(margin, 1 - longest(apart) / width))
    return margin


def _let_go(context: Context, path: _Path) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return steps, and in which of them nothing touches the body that should hold it."""
    rows = context.pairs.rows[[*path.expected.pairs]]
    steps = path.states[path.states < context.trace.steps]
    touching = (context.net.series.mode[rows, path.run] != NO_CONTACT).any(axis=0)
    return steps, ~touching[steps]


def _faults(context: Context, path: _Path, hold: float) -> Iterator[Fault]:
    """Yield the first of what a body does otherwise."""
    expected, states = path.expected, path.states
    if expected.word == "passes":
        yield from _missed(path)
        return
    amount, unit = _departure(path)
    # A state that is no number departs by more than any tolerance.
    beyond = ~(amount <= expected.limit)
    if beyond.any():
        worst = float(np.nanmax(np.where(np.isfinite(amount), amount, np.inf)))
        state = int(states[first_step(beyond)])
        far = _worded(worst, unit)
        over = _worded(worst - expected.limit, unit)
        where = " from where it was" if expected.word == "stays" else ""
        yield f"{_DOES[expected.word]} up to {far}{where}, {over} too much", state
        return
    if expected.word == "held":
        steps, free = _let_go(context, path)
        apart = lasting(free, steps_that_count(context, path.run, hold))
        if apart.any():
            seconds = np.count_nonzero(apart) * float(context.trace.timestep[path.run])
            yield f"its holder does not touch it for {seconds:.3g} s", int(steps[first_step(apart)])


def _departure(path: _Path) -> tuple[Floats, str]:
    """Return (M,) how far a body departs from where it should be, and the unit."""
    expected, run, _, place, turn = path
    if expected.word == "upright":
        axis = np.broadcast_to(expected.axis[run], (len(turn), 3))
        cosine = rotate(turn, axis) @ expected.up[run]
        return np.arccos(np.clip(cosine, -1, 1)), "rad"
    moved = np.linalg.norm(place - place[0], axis=1)
    if expected.word != "still":
        return moved, "m"
    # Half the angle between two rotations is that between their quaternions.
    half = np.arccos(np.clip(np.abs(turn @ turn[0]), 0, 1))
    if expected.angular:
        return 2 * half, "rad"
    return moved + 2 * np.sin(half) * expected.reach, "m"


def _crossings(place: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Return before which states a path (M, 3) crosses the plane of a hole, and how far beside it.

    The path is in the frame of the hole, across whose z axis the plane lies.
    """
    height = place[:, 2]
    before = np.flatnonzero(np.sign(height[:-1]) * np.sign(height[1:]) <= 0)
    before = before[height[before] != height[before + 1]]
    share = (height[before] / (height[before] - height[before + 1]))[:, None]
    crossing = (1 - share) * place[before, :2] + share * place[before + 1, :2]
    return before, np.linalg.norm(crossing, axis=1)


def _missed(path: _Path) -> Iterator[Fault]:
    """Yield that a path does not cross the plane of a hole near enough."""
    height, limit = path.place[:, 2], path.expected.limit
    before, beside = _crossings(path.place)
    if not len(before):
        away = _worded(float(np.nanmin(np.abs(height))), "m")
        yield f"it stays on one side, {away} away", int(path.states[-1])
    elif not (beside <= limit).any():
        nearest = int(np.nanargmin(beside))
        least = float(beside[nearest])
        state = int(path.states[before[nearest]])
        yield (
            f"it passes {_worded(least, 'm')} beside it, {_worded(least - limit, 'm')} too much",
            state,
        )


def _worded(amount: float, unit: str) -> str:
    if unit == "rad":
        return f"{np.degrees(amount):.3g} deg"
    return f"{amount * 1e3:.3g} mm" if amount < 1 else f"{amount:.3g} m"
