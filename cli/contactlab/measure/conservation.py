"""What must not grow by itself: energy, speed and momentum, and the label of what gains energy."""

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.contact.trace_setup import FreeBody
from contactlab.measure.context import (
    Context,
    cached,
    energy,
    energy_budget,
    first_step,
    kinetic,
    least_energy,
    peak_kinetic,
    speed_squared,
    worst_body,
)
from contactlab.measure.entries import Finding, Findings, MeasuredRuns, Threshold, label, metric

_SETTLED = 1e-6
_LENGTH = 1e-3
_SPEED = 1e-3


@cached
def energy_scale(context: Context) -> Floats:
    """Return (n,) the energy [J] that energy gains are a share of."""
    return np.maximum(energy_budget(context), least_energy(context))


@metric(
    unit="1", better="lower", resolution=1e-9, requires="energy", equivalence=True, heading="gain"
)
def energy_gain(context: Context) -> Floats:
    """Largest mechanical energy over that at the start, less 1, in a passive scene.

    The datum is the lowest potential energy that the run reaches; the energy at the start counts
    as at least what lifts every free body by 1 mm. Contact must not add energy.
    """
    if not context.setup.passive:
        return context.undefined()
    values = energy(context)
    return (values.max(axis=1) - values[:, 0]) / energy_scale(context)


@metric(unit="1/s", resolution=1e-12, tolerance=1e-3, requires="energy", equivalence=True)
def energy_drift(context: Context) -> Floats:
    """Change of mechanical energy over the run, over peak kinetic energy and time.

    For passive scenes. Free motion should stay within 0.1 %/s; contact dissipates.
    """
    if not context.setup.passive:
        return context.undefined()
    values = energy(context)
    scale = np.maximum(peak_kinetic(context), least_energy(context))
    return (values[:, -1] - values[:, 0]) / (scale * context.seconds)


@metric(unit="1", better="lower", resolution=1e-6, requires="energy")
def speed_ratio(context: Context) -> Floats:
    """Largest speed of a free body over the speed that all the energy of the start would give it.

    For passive scenes; the bound is sqrt(v0^2 + 2 g H) for one body that falls by H. Above 1, a
    body was ejected.
    """
    if not context.setup.passive:
        return context.undefined()

    def ratio(body: FreeBody) -> Floats:
        return np.sqrt(speed_squared(context, body).max(axis=1)) / _speed_bound(context, body.mass)

    return worst_body(context, ratio)


@metric(unit="1", better="lower", resolution=1e-12, requires="energy")
def momentum_drift(context: Context) -> Floats:
    """Largest change of linear momentum in a free system, over sqrt(2 m K).

    m is the total mass and K the peak kinetic energy. Contact forces are equal and opposite.
    """
    if context.trace.momentum is None:
        return context.undefined()
    return _largest_change(context.trace.momentum) / _momentum_scale(context)


@metric(unit="1", better="lower", resolution=1e-12, requires="energy")
def spin_drift(context: Context) -> Floats:
    """Largest change of angular momentum about the centre of mass in a free system.

    As a share of its largest magnitude, which counts as at least 1 mm times sqrt(2 m K).
    """
    momentum = context.trace.angular_momentum
    if momentum is None:
        return context.undefined()
    largest = np.sqrt((momentum**2).sum(axis=2).max(axis=1))
    return _largest_change(momentum) / np.maximum(largest, _momentum_scale(context) * _LENGTH)


@metric(unit="s", better="lower", requires="energy")
def settle_time(context: Context) -> Floats:
    """Time after which kinetic energy stays below 1e-6 of its peak.

    Not defined where the system still moves at the end.
    """
    limit = _SETTLED * np.maximum(peak_kinetic(context), least_energy(context))
    moving = kinetic(context) > limit[:, None]
    settled = context.trace.steps - moving[:, ::-1].argmax(axis=1)
    steps = np.where(moving.any(axis=1), settled, 0)
    never = moving[:, -1] | ~np.isfinite(limit)
    return np.where(never, np.nan, steps * context.trace.timestep)


@metric(unit="m/s", resolution=1e-9)
def final_speed(context: Context) -> Floats:
    """Speed of the fastest free body in the last state."""
    last = context.trace.qvel[:, -1]
    return worst_body(
        context, lambda body: np.linalg.norm(last[:, body.dof : body.dof + 3], axis=1)
    )


@label(
    severity=60,
    thresholds=(
        Threshold(
            "energy_gain",
            0.01,
            "1",
            "Largest metric energy_gain. Measured: good settings stay below 1.01 of the energy at "
            "the start, bad ones reach 3 to 1500.",
        ),
        Threshold(
            "speed_ratio", 1.05, "1", "Largest metric speed_ratio; 5 % of speed is 10 % of energy."
        ),
    ),
)
def energy_injection(runs: MeasuredRuns) -> Findings:
    """A passive scene gained energy, or ejected a body faster than its energy allows."""
    found = {
        run: Finding(
            f"a body moved {ratio:.3g} times as fast as the energy at the start allows "
            f"(limit {limit:g})",
            _first_fast_step(runs.context, run, limit),
        )
        for run, ratio, limit in runs.over("speed_ratio")
    }
    for run, gain, limit in runs.over("energy_gain"):
        values = energy(runs.context)[run]
        risen = values - values[0] > limit * energy_scale(runs.context)[run]
        reason = f"energy rose by {gain:.3%} of that at the start (limit {limit:.3g})"
        found[run] = Finding(reason, first_step(risen))
    return found


def _first_fast_step(context: Context, run: int, limit: float) -> int:
    """Return the first step after which some free body is faster than it may be."""
    steps: list[int] = []
    for body in context.setup.free_bodies:
        bound: Floats = _speed_bound(context, body.mass)
        fast = speed_squared(context, body)[run] > (limit * bound[run]) ** 2
        if fast.any():
            steps.append(max(first_step(fast) - 1, 0))
    return min(steps, default=0)


def _speed_bound(context: Context, mass: Floats) -> Floats:
    """Return (n,) the speed [m/s] that a body of this mass has with all of the energy budget."""
    return np.maximum(np.sqrt(2 * energy_budget(context) / mass), _SPEED)


def _momentum_scale(context: Context) -> Floats:
    """Return (n,) a bound [kg m/s] on the momentum that the peak kinetic energy allows."""
    mass = sum((body.mass for body in context.setup.free_bodies), np.zeros(context.trace.runs))
    return np.sqrt(2 * mass * np.maximum(peak_kinetic(context), least_energy(context)))


def _largest_change(vectors: Floats) -> Floats:
    return np.sqrt(((vectors - vectors[:, :1]) ** 2).sum(axis=2).max(axis=1))
