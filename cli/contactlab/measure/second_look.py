"""Selects runs for a second pass although no label applies."""

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats, fast_median, squared_lengths
from contactlab.measure.backward_error import TOLERANCE
from contactlab.measure.constraint_violation import constraint_violation
from contactlab.measure.context import Context, squared_speeds
from contactlab.measure.energy_balance import (
    constraint_gain,
    constraint_loss,
    integration_gain,
    integration_loss,
)
from contactlab.measure.entries import threshold_values
from contactlab.measure.penetration import PRESSED, weights_borne
from contactlab.measure.solver_work import stuck_share

_MIN_OSCILLATION = 0.15  # smallest amplitude of a step-to-step oscillation, over the speed
_MIN_SPEEDS = 3  # fewest speeds that can show an oscillation
_MIN_MOVING_SPEED = 0.1  # smallest speed of a moving body [rad/s, or mean body sizes a second]
_MIN_SATURATED_SHARE = 0.5  # share of steps with all iterations used
_MIN_RATTLE_SHARE = 0.1  # share of the first half's steps with a change of the number of contacts
# Whether degrees of freedom are translations, by kind of joint.
_IS_TRANSLATION = {
    "free": [True] * 3 + [False] * 3,
    "ball": [False] * 3,
    "slide": [True],
    "hinge": [False],
}


def _find_oscillations(context: Context, late: Floats) -> NDArray[np.bool_]:
    """Return (n,) whether speeds oscillate from step to step, by a share of gravity.

    Free joints count only without contact, because bodies hop as they slide.
    """
    mechanism = context.setup.mechanism
    size, joints = context.setup.size, mechanism.joints if mechanism else ()
    hinged = [joint.kind != "free" for joint in joints for _ in _IS_TRANSLATION[joint.kind]] or [
        True
    ]
    aloft = context.trace.contacts.max(axis=1, initial=0)[:, None] == 0
    if late.shape[1] < _MIN_SPEEDS:
        return np.zeros(len(late), bool)
    swing = fast_median(np.swapaxes(np.abs(np.diff(late, n=2, axis=1)) / 4, 1, 2))
    swing *= (swing >= _MIN_OSCILLATION * np.sqrt((late**2).mean(axis=1))) & (
        np.array(hinged) | aloft
    )
    acceleration = 2 * size * swing.max(axis=1, initial=0) / context.trace.timestep
    return (
        acceleration
        > threshold_values(context.setup.thresholds)[TOLERANCE.name] * context.setup.pull
    )


def needs_second_pass(context: Context) -> NDArray[np.bool_]:
    """Return (n,) which runs need a second pass although no label applies.

    Such a run oscillates in its steps, is pressed hard at rest or against a limit, has a solver
    that uses all its iterations, gains or loses energy in constraints or by its steps, does not
    come to rest under constant controls, or has a body that moved far from its rest position or
    rattled.
    """
    trace, ranges = context.trace, context.trace.control_ranges
    most = threshold_values(context.setup.thresholds)
    # Speeds of the last quarter [rad/s, or mean body sizes a second].
    late, mechanism = trace.qvel[:, 3 * trace.steps // 4 :], context.setup.mechanism
    if mechanism is not None:
        along = [moves for joint in mechanism.joints for moves in _IS_TRANSLATION[joint.kind]]
        late = late / np.where(along, context.setup.size, 1.0)
    found = _find_oscillations(context, late)
    found |= weights_borne(context) > most[PRESSED.name]
    found |= stuck_share(context) >= _MIN_SATURATED_SHARE
    within = most[TOLERANCE.name]
    found |= (constraint_loss(context) > within) & (stuck_share(context) == 0)
    found |= constraint_gain(context) > within
    found |= (integration_gain(context) > within) | (integration_loss(context) > within)
    found |= constraint_violation(context) > within
    if ranges is not None and ranges.shape[1]:
        constant = (ranges[..., 0] == ranges[..., 1]).all(axis=1)
        found |= constant & (np.sqrt((late**2).mean(axis=(1, 2))) > _MIN_MOVING_SPEED)
    changes = (np.diff(trace.contacts[:, : trace.steps // 2]) != 0).sum(axis=1)
    rattles = changes > _MIN_RATTLE_SHARE * trace.steps / 2
    squares = squared_speeds(context)
    early = squares[..., : 1 + trace.steps // 10]
    first, fastest = (np.sqrt(speeds.max(axis=2)) for speeds in (early, squares))
    for body, rested in zip(context.setup.free_bodies, first < 0.01 * fastest, strict=True):
        # A body that falls or rolls from the start was not at rest.
        far = np.sqrt(squared_lengths(context.displacement(body))) > context.setup.size
        found |= (rested | rattles) & far & (trace.contacts[:, :1] > 0).any(axis=1)
    return found
