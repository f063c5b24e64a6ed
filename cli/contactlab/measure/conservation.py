"""Metrics of what must not grow by itself: energy, speed, momentum."""

import numpy as np

from contactlab.contact import Floats
from contactlab.measure.context import (
    Context,
    budget,
    energy,
    kinetic,
    least_energy,
    peak_kinetic,
    shared,
    speed_squared,
)
from contactlab.measure.metric import Metric

_SETTLED = 1e-6
_LENGTH = 1e-3
_SPEED = 1e-3


@shared
def energy_scale(context: Context) -> Floats:
    """Return (n,) the energy [J] that energy gains are a share of."""
    return np.maximum(budget(context), least_energy(context))


@shared
def energy_gain(context: Context) -> Floats:
    """Return (n,) the largest rise of energy above the start, over the energy scale."""
    if not context.setup.passive:
        return context.nothing()
    values = energy(context)
    return (values.max(axis=1) - values[:, 0]) / energy_scale(context)


def _energy_drift(context: Context) -> Floats:
    if not context.setup.passive:
        return context.nothing()
    values = energy(context)
    scale = np.maximum(peak_kinetic(context), least_energy(context))
    return (values[:, -1] - values[:, 0]) / (scale * context.seconds)


def speed_bound(context: Context, mass: Floats) -> Floats:
    """Return (n,) the speed [m/s] that a body of this mass has with all of the energy budget."""
    return np.maximum(np.sqrt(2 * budget(context) / mass), _SPEED)


def _speed_ratio(context: Context) -> Floats:
    bodies = context.setup.free_bodies
    if not context.setup.passive or not bodies:
        return context.nothing()
    return np.maximum.reduce(
        [
            np.sqrt(speed_squared(context, body).max(axis=1)) / speed_bound(context, body.mass)
            for body in bodies
        ]
    )


def _momentum_scale(context: Context) -> Floats:
    """Return (n,) a bound [kg m/s] on the momentum that the peak kinetic energy allows."""
    mass = sum((body.mass for body in context.setup.free_bodies), np.zeros(context.trace.runs))
    return np.sqrt(2 * mass * np.maximum(peak_kinetic(context), least_energy(context)))


def _largest_change(vectors: Floats) -> Floats:
    return np.sqrt(((vectors - vectors[:, :1]) ** 2).sum(axis=2).max(axis=1))


def _momentum_drift(context: Context) -> Floats:
    if context.trace.momentum is None:
        return context.nothing()
    return _largest_change(context.trace.momentum) / _momentum_scale(context)


def _spin_drift(context: Context) -> Floats:
    spin = context.trace.angular_momentum
    if spin is None:
        return context.nothing()
    largest = np.sqrt((spin**2).sum(axis=2).max(axis=1))
    return _largest_change(spin) / np.maximum(largest, _momentum_scale(context) * _LENGTH)


def _settle_time(context: Context) -> Floats:
    limit = _SETTLED * np.maximum(peak_kinetic(context), least_energy(context))
    moving = kinetic(context) > limit[:, None]
    settled = context.trace.steps - moving[:, ::-1].argmax(axis=1)
    steps = np.where(moving.any(axis=1), settled, 0)
    never = moving[:, -1] | ~np.isfinite(limit)
    return np.where(never, np.nan, steps * context.trace.timestep)


def _final_speed(context: Context) -> Floats:
    bodies = context.setup.free_bodies
    if not bodies:
        return context.nothing()
    last = context.trace.qvel[:, -1]
    speeds = [np.linalg.norm(last[:, body.dof : body.dof + 3], axis=1) for body in bodies]
    return np.maximum.reduce(speeds)


CONSERVATION = (
    Metric(
        "energy_gain",
        "1",
        "lower",
        1e-9,
        1,
        "Largest mechanical energy over that at the start, less 1, in a passive scene. The datum "
        "is the lowest potential energy that the run reaches; the energy at the start counts as "
        "at least what lifts every free body by 1 mm. Contact must not add energy.",
        energy_gain,
    ),
    Metric(
        "energy_drift",
        "1/s",
        "none",
        1e-12,
        1,
        "Mechanical energy at the end minus at the start, over peak kinetic energy and time, in a "
        "passive scene. Free motion should stay within 0.1 %/s; contact dissipates.",
        _energy_drift,
    ),
    Metric(
        "speed_ratio",
        "1",
        "lower",
        1e-6,
        1,
        "Largest speed of a free body over the speed that it would have with all the energy of "
        "the start, in a passive scene; sqrt(v0^2 + 2 g H) for one body that falls by H. Above 1, "
        "a body was ejected.",
        _speed_ratio,
    ),
    Metric(
        "momentum_drift",
        "1",
        "lower",
        1e-12,
        1,
        "Largest change of linear momentum in a free system, over sqrt(2 m K) of its total mass "
        "and peak kinetic energy. Contact forces are equal and opposite.",
        _momentum_drift,
    ),
    Metric(
        "spin_drift",
        "1",
        "lower",
        1e-12,
        1,
        "Largest change of angular momentum about the centre of mass in a free system, over its "
        "largest magnitude, which counts as at least 1 mm times sqrt(2 m K).",
        _spin_drift,
    ),
    Metric(
        "settle_time",
        "s",
        "lower",
        0,
        1,
        "Time after which kinetic energy stays below 1e-6 of its peak; not defined where it still "
        "moves at the end.",
        _settle_time,
    ),
    Metric(
        "final_speed",
        "m/s",
        "none",
        1e-9,
        1,
        "Speed of the fastest free body in the last state.",
        _final_speed,
    ),
)
