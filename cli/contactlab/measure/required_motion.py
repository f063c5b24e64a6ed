"""The label of bodies that do not move as their scene or sweep says that they must."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.expected_motion import ExpectedMotion
from contactlab.contact.rotations import rotate
from contactlab.contact.trace_arrays import NO_CONTACT, Floats
from contactlab.measure.context import Context, first_step
from contactlab.measure.entries import Found, MeasuredRuns, Onset, label
from contactlab.measure.required_contact import MODE_HOLD, lasting

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
    required = [each for each in context.setup.expected if isinstance(each, ExpectedMotion)]
    for run in range(context.trace.runs):
        found = [
            (min(state, context.trace.steps - 1), f"{expected.name}: {met}", state)
            for expected in required
            for met, state in _faults(context, expected, run, hold)
        ]
        if found:
            found.sort()
            times = context.trace.time[run]
            reasons = [f"{said}, from {times[state]:.4g} s on" for _, said, state in found]
            yield run, Onset("; ".join(reasons), found[0][0])


def _faults(context: Context, expected: ExpectedMotion, run: int, hold: float) -> Iterator[Fault]:
    """Yield the first of what a body does otherwise, of one run."""
    timestep = float(context.trace.timestep[run])
    time = context.trace.time[run]
    start, stop = expected.window[run]
    slack = _ROUNDING * timestep
    states = np.flatnonzero((time >= start - slack) & (time <= stop + slack))
    if not len(states):
        return
    place, turn = expected.placing[run](context.trace.qpos[run, states])
    if expected.word == "passes":
        yield from _missed(expected, place, states)
        return
    amount, unit = _departure(expected, run, place, turn)
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
        rows = context.pairs.rows[[*expected.pairs]]
        steps = states[states < context.trace.steps]
        touching = (context.net.series.mode[rows, run] != NO_CONTACT).any(axis=0)[steps]
        width = max(int(np.ceil(hold / timestep - _ROUNDING)), 1)
        apart = lasting(~touching, width)
        if apart.any():
            seconds = np.count_nonzero(apart) * timestep
            yield f"its holder does not touch it for {seconds:.3g} s", int(steps[first_step(apart)])


def _departure(
    expected: ExpectedMotion, run: int, place: Floats, turn: Floats
) -> tuple[Floats, str]:
    """Return (M,) how far a body departs from where it should be, and the unit."""
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


def _missed(expected: ExpectedMotion, place: Floats, states: NDArray[np.intp]) -> Iterator[Fault]:
    """Yield that a path (M, 3) through the frame of a hole does not cross its plane near enough."""
    height, last = place[:, 2], int(states[-1])
    before = np.flatnonzero(np.sign(height[:-1]) * np.sign(height[1:]) <= 0)
    before = before[height[before] != height[before + 1]]
    if not len(before):
        yield f"it stays on one side, {_worded(float(np.nanmin(np.abs(height))), 'm')} away", last
        return
    share = (height[before] / (height[before] - height[before + 1]))[:, None]
    crossing = (1 - share) * place[before, :2] + share * place[before + 1, :2]
    beside = np.linalg.norm(crossing, axis=1)
    if not (beside <= expected.limit).any():
        nearest = int(np.nanargmin(beside))
        least = float(beside[nearest])
        over = _worded(least - expected.limit, "m")
        state = int(states[before[nearest]])
        yield f"it passes {_worded(least, 'm')} beside it, {over} too much", state


def _worded(amount: float, unit: str) -> str:
    if unit == "rad":
        return f"{np.degrees(amount):.3g} deg"
    return f"{amount * 1e3:.3g} mm" if amount < 1 else f"{amount:.3g} m"
