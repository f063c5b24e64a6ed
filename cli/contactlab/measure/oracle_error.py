"""Errors of runs against their closed form, and closed forms of motion without contact."""

import numpy as np

from contactlab.contact.rotations import rotate_vectors, rotate_vectors_back
from contactlab.contact.trace_arrays import Floats, squared_lengths
from contactlab.errors import SceneError
from contactlab.measure.backward_error import TOLERANCE
from contactlab.measure.context import (
    Context,
    cached,
    distance_from_rest,
    energy,
    kinetic,
    runs_where,
)
from contactlab.measure.entries import (
    ORACLES,
    MeasuredRuns,
    Onset,
    OnsetIterator,
    OracleResult,
    label,
    metric,
    oracle,
)
from contactlab.measure.motion import energy_scale
from contactlab.rendering.amounts import format_percent


@metric("any", kind="detail", heading="expected")
def oracle_expected(context: Context) -> Floats:
    """Expected value by the scene's closed form, in the unit of that oracle."""
    return _oracle_result(context).expected


@metric("any", kind="detail", heading="measured")
def oracle_measured(context: Context) -> Floats:
    """Measured value of the quantity in the scene's closed form, in the same unit."""
    return _oracle_result(context).measured


@metric("any", "lower", 1e-9, equivalence=True)
def oracle_error(context: Context) -> Floats:
    """Error against the scene's closed form, as a share or in its unit as the oracle defines.

    It is the modeling error of soft contact, which no timestep removes, and discretization.
    """
    return _oracle_result(context).error


@label(
    "noted",
    rank=2,
    thresholds=(TOLERANCE,),
    judged_on=(("oracle_error", ""), ("at_rest_error", TOLERANCE.name)),
    letter="O",
    colour="#507954",
    advice="a shorter timestep; an error that remains is the model's, as of pyramidal cones",
)
def oracle_miss(runs: MeasuredRuns) -> OnsetIterator:
    """The error against the scene's closed form exceeds the limit, or nothing could be measured.

    Or pairs at rest miss the requested stiffness or depth.
    """
    setup, last = runs.context.setup, runs.context.trace.steps - 1
    names = "oracle_expected", "oracle_measured", "oracle_error"
    expected, observed, error = (runs.metrics[name] for name in names)
    unmet = np.isfinite(expected) & np.isnan(observed) & np.isfinite(setup.oracle_tolerance)
    for run in runs_where(unmet | (error > setup.oracle_tolerance)):
        reason = f"{setup.oracle}: expected {expected[run]:.4g}, "
        if unmet[run]:
            reason += "but nothing could be measured, because the motion never reached it"
        else:
            limit = f"(limit {setup.oracle_tolerance:g})"
            reason += f"measured {observed[run]:.4g}, error {error[run]:.3g} {limit}"
        yield run, Onset(reason, last)
    for run, error, limit in runs.over("at_rest_error", TOLERANCE.name):
        reason = f"at rest, the relative error of the requested value is {format_percent(error)}"
        reason = f"{reason} (limit {format_percent(limit)})"
        yield run, Onset(reason, last)


@cached
def _oracle_result(context: Context) -> OracleResult:
    name = context.setup.oracle
    if name is None:
        return OracleResult(context.undefined(), context.undefined(), context.undefined())
    rest = f"; there are {', '.join(ORACLES)}"
    SceneError.unless_known(name, ORACLES, f"no oracle '{name}'", rest=rest)
    return ORACLES[name].of(context)


@oracle("m", ("integrator",), relative=False)
def free_fall(context: Context) -> tuple[Floats, Floats]:
    """Distance of a falling body from its position under gravity alone: 0.

    After N steps of length h that is x0 + v0 h N + g h^2 N (N + 1) / 2 by semi-implicit steps, and
    x0 + v0 h N + g (h N)^2 / 2 by RK4: exact. Measured: largest distance of the first free body.
    """
    trace, body = context.trace, context.setup.free_bodies[0]
    steps = np.arange(trace.steps + 1)
    place = context.position(body)
    drifted = context.velocity(body)[:, :1] * (trace.timestep[:, None] * steps)[:, :, None]
    fallen = context.setup.gravity[:, None] * distance_from_rest(context, steps)[:, :, None]
    off = np.sqrt(squared_lengths(place - place[:, :1] - drifted - fallen))
    return np.zeros(trace.runs), off.max(axis=1)


@oracle("1", ("timestep",), relative=False)
def conserved_energy(context: Context) -> tuple[Floats, Floats]:
    """Change of the mechanical energy of free motion, without contact: 0.

    Measured: largest change either way over the energy at the start that could become motion.
    """
    values = energy(context)
    change = np.abs(values - values[:, :1]).max(axis=1)
    return np.zeros(context.trace.runs), change / energy_scale(context)


@oracle("rad", ("joint_damping", "servo_gain"), relative=True)
def braking_angle(context: Context) -> tuple[Floats, Floats]:
    """Angle w I / c by which a hinge of inertia I with damping c turns until it stands.

    I w + c q is constant, and every implicit and every Runge-Kutta step keeps it to the last digit;
    I is twice the kinetic energy at the start over w^2. Measured: turn of the first joint.
    """
    speed = context.trace.qvel[:, 0, 0]
    inertia = 2 * kinetic(context)[:, 0] / speed**2
    damping = context.setting("joint_damping") + context.setting("servo_gain")
    turned = context.trace.qpos[:, -1, 0] - context.trace.qpos[:, 0, 0]
    return speed * inertia / damping, turned


@oracle("rad/s", ("timestep",), relative=True)
def precession(context: Context) -> tuple[Floats, Floats]:
    """Rate at which a symmetric top precesses: that of its axis in the first state.

    The start must be steady: the slow root W of I1 cos(tilt) W^2 - I3 spin W + m g l = 0, with
    moments about the pivot. Measured: azimuth of z of the first joint's body over time.
    """
    # For a ball joint and for a first free joint, w starts at the index of the quaternion.
    first = context.setup.quaternions[0]
    attitude = context.trace.qpos[:, :, first : first + 4]
    turning = context.trace.qvel[:, 0, first : first + 3]
    axis = rotate_vectors(attitude, np.array([0.0, 0.0, 1.0]))
    start = axis[:, 0]
    moving = np.cross(rotate_vectors(attitude[:, 0], turning), start)
    rate = (start[:, 0] * moving[:, 1] - start[:, 1] * moving[:, 0]) / (start[:, :2] ** 2).sum(1)
    azimuth = np.unwrap(np.arctan2(axis[..., 1], axis[..., 0]), axis=1)
    return rate, (azimuth[:, -1] - azimuth[:, 0]) / context.seconds


@oracle("s", ("timestep",), relative=True)
def flip_time(context: Context) -> tuple[Floats, Floats]:
    """First time at which a free body, spun about its middle axis, turns over.

    The elliptic integral of Euler's equations without torque, from angular velocity and momentum at
    the start. The body's axes are its principal ones, the middle moment about y, and the start
    turns about all three. Measured: first change of sign of the first free body's wy.
    """
    if context.trace.angular_momentum is None or not context.setup.free_bodies:
        return context.undefined(), context.undefined()
    body = context.setup.free_bodies[0]
    turning = context.turning(body)
    attitude = context.trace.qpos[:, 0, body.qpos + 3 : body.qpos + 7]
    momentum = rotate_vectors_back(attitude, context.trace.angular_momentum[:, 0])
    start = turning[:, 0]
    # The first sign change, interpolated.
    values = turning[:, :, 1]
    crossed = values[:, 1:] * values[:, :-1] < 0
    step = crossed.argmax(axis=1)
    rows = np.arange(len(values))
    before, after = values[rows, step], values[rows, step + 1]
    time = context.trace.timestep * (step + before / (before - after))
    return middle_axis_flip(momentum / start, start), np.where(crossed.any(axis=1), time, np.nan)


def middle_axis_flip(inertia: Floats, turning: Floats) -> Floats:
    """Return (n,) the time [s] of the sign change of the rotation about the middle axis.

    Euler's equations keep ``w1^2 + b1 w2^2`` and ``w3^2 + b3 w2^2``, with axis 2 the middle one, so
    that dt = dw2 / (c sqrt(p q)), with p and q those squares: Carlson's integral R_F. `inertia` (n,
    3) are principal moments [kg m^2], and `turning` (n, 3) [rad/s] is along their axes.
    """
    first, middle, third = inertia.T
    rate = np.abs(third - first) / middle
    share1 = middle * (third - middle) / (first * (third - first))
    share3 = middle * (middle - first) / (third * (third - first))
    speed = np.abs(turning[:, 1])
    total1 = turning[:, 0] ** 2 + share1 * speed**2
    total3 = turning[:, 2] ** 2 + share3 * speed**2

    def from_zero(w: Floats) -> Floats:
        rest1 = np.maximum(1 - share1 * w**2 / total1, 0)
        rest3 = np.maximum(1 - share3 * w**2 / total3, 0)
        return w * carlson_rf(rest1, rest3, np.ones_like(w)) / (rate * np.sqrt(total1 * total3))

    highest = np.sqrt(np.minimum(total1 / share1, total3 / share3))
    rising = (third - first) * turning.prod(axis=1) > 0
    fall = from_zero(speed)
    return np.where(rising, 2 * from_zero(highest) - fall, fall)


def carlson_rf(x: Floats, y: Floats, z: Floats) -> Floats:
    """Return Carlson's integral R_F(x, y, z) of arguments >= 0.

    By the duplication theorem (B. C. Carlson, Numerical computation of real or complex elliptic
    integrals, 1995); `scipy.special.elliprf` differs from it, and so from stored evidence, in the
    last bits.
    """
    duplications = 30
    for _ in range(duplications):
        roots = np.sqrt(x), np.sqrt(y), np.sqrt(z)
        shift = roots[0] * roots[1] + roots[1] * roots[2] + roots[2] * roots[0]
        x, y, z = (x + shift) / 4, (y + shift) / 4, (z + shift) / 4
    return 1 / np.sqrt((x + y + z) / 3)
