"""Metrics of bodies that should stay where they were put."""

import numpy as np

from contactlab.contact import Floats, FreeBody
from contactlab.measure.context import Context, speed_squared
from contactlab.measure.metric import Metric


def moved(context: Context, body: FreeBody, run: int) -> Floats:
    """Return (N + 1,) how far [m] a free body's frame is from its start, across gravity."""
    place = context.trace.qpos[run, :, body.qpos : body.qpos + 3]
    return np.sqrt(_across(place - place[0], down(context)[run]))


def _drift(context: Context) -> Floats:
    bodies = context.setup.free_bodies
    if not bodies:
        return context.nothing()
    below = down(context)
    return np.sqrt(np.maximum.reduce([_across(_travel(context, body), below) for body in bodies]))


def _rest_speed(context: Context) -> Floats:
    bodies = context.setup.free_bodies
    if not bodies:
        return context.nothing()
    start = context.tail.start + 1
    squares = [speed_squared(context, body)[:, start:].max(axis=1) for body in bodies]
    return np.sqrt(np.maximum.reduce(squares))


def _drop(context: Context) -> Floats:
    bodies = context.setup.free_bodies
    if not bodies:
        return context.nothing()
    below = down(context)
    return np.maximum.reduce([(_travel(context, body) * below).sum(axis=1) for body in bodies])


def _travel(context: Context, body: FreeBody) -> Floats:
    """Return (n, 3) the way [m] from a free body's first place to its last."""
    place = context.trace.qpos[:, :, body.qpos : body.qpos + 3]
    return place[:, -1] - place[:, 0]


def down(context: Context) -> Floats:
    """Return (n, 3) the unit vector of gravity; zero without gravity."""
    gravity = context.setup.gravity
    length = np.linalg.norm(gravity, axis=1, keepdims=True)
    return gravity / np.where(length > 0, length, 1)


def _across(vectors: Floats, below: Floats) -> Floats:
    """Return the squared length of vectors (..., 3) across a unit vector or zero (..., 3)."""
    across = vectors - (vectors * below).sum(axis=-1, keepdims=True) * below
    return (across * across).sum(axis=-1)


REST = (
    Metric(
        "drift",
        "m",
        "lower",
        1e-12,
        1,
        "Distance across gravity between a free body's first and last place, of the one that "
        "moved most. Of bodies that rest it is creep: it grows with time and vanishes with "
        "impratio; of a stack that collapsed it is the fall.",
        _drift,
    ),
    Metric(
        "drop",
        "m",
        "lower",
        1e-12,
        1,
        "Distance along gravity between a free body's first and last place, of the one that sank "
        "most; negative where all rose.",
        _drop,
    ),
    Metric(
        "rest_speed",
        "m/s",
        "lower",
        1e-12,
        1,
        "Largest speed of a free body in the last fifth of the run. Bodies at rest keep the speed "
        "of their creep.",
        _rest_speed,
    ),
)
