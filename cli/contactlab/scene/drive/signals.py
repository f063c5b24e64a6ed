"""Signals that drive runs over time: noise, and an excitation by controls and pushes.

Both consist of knots at times in seconds, so that they are the same at every timestep.
"""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.scene.part_bodies import AT_JOINT
from contactlab.scene.timed_inputs import Signals
from contactlab.schema.drive import NoiseDrive

_FIXED_GAIN = int(mujoco.mjtGain.mjGAIN_FIXED)
_AFFINE_BIAS = int(mujoco.mjtBias.mjBIAS_AFFINE)
_INTEGRATOR_DYNAMICS = int(mujoco.mjtDyn.mjDYN_INTEGRATOR)
_MUSCLE_DYNAMICS = int(mujoco.mjtDyn.mjDYN_MUSCLE)


def control_ranges(model: mujoco.MjModel) -> Floats:
    """Return (nu, 2) the least and largest control of each actuator.

    It is the range of a limited control. Otherwise it follows from the actuator: the limits of its
    joint for a position servo, a speed of 1 for a velocity servo, the range of its force for a
    motor or, without one, the control that accelerates its joint by 10 rad/s^2 or m/s^2.
    """
    ranges = np.array(model.actuator_ctrlrange, dtype=np.float64)
    limited = np.asarray(model.actuator_ctrllimited).astype(bool)
    for actuator in np.flatnonzero(~limited):
        ranges[actuator] = _range_without_limits(model, int(actuator))
    return ranges


def _range_without_limits(model: mujoco.MjModel, actuator: int) -> tuple[float, float]:
    gain, bias = float(model.actuator_gainprm[actuator, 0]), model.actuator_biasprm[actuator]
    dynamics = model.actuator_dyntype[actuator]
    affine = model.actuator_biastype[actuator] == _AFFINE_BIAS
    if dynamics == _MUSCLE_DYNAMICS:
        return 0.0, 1.0
    # Limits of an actuator without a range: length [rad or m], speed [rad/s or m/s], and
    # acceleration of its joint [rad/s^2 or m/s^2].
    default_length, default_speed, default_acceleration = 0.5, 1.0, 10.0
    if model.actuator_gaintype[actuator] != _FIXED_GAIN or not gain:
        ends = -1.0, 1.0
    elif dynamics == _INTEGRATOR_DYNAMICS or (affine and bias[2] and not bias[1]):
        ends = -default_speed, default_speed
    elif affine and bias[1]:
        joint = int(model.actuator_trnid[actuator, 0])
        if model.actuator_trntype[actuator] in AT_JOINT and model.jnt_limited[joint]:
            lengths = model.jnt_range[joint] * model.actuator_gear[actuator, 0]
        else:
            middle = model.actuator_length0[actuator]
            lengths = np.array([-default_length, default_length]) + middle
        ends = _servo_control(model, actuator, lengths)
    elif model.actuator_forcelimited[actuator]:
        ends = model.actuator_forcerange[actuator] / gain
    else:
        rate = abs(gain) * float(model.actuator_acc0[actuator])
        ends = np.array([-1.0, 1.0]) * (default_acceleration / rate if rate else 1.0)
    return float(min(ends)), float(max(ends))


def _servo_control(model: mujoco.MjModel, actuator: int, lengths: Floats) -> Floats:
    """Return the controls for zero force of position servos at rest at some lengths."""
    bias = model.actuator_biasprm[actuator]
    return (-bias[1] * lengths - bias[0]) / model.actuator_gainprm[actuator, 0]


def neutral_controls(model: mujoco.MjModel, qpos: Floats) -> Floats:
    """Return (nu,) the controls of a posture (nq,) that has no controls of its own.

    They are zero, or the middle of a range that excludes zero. A position servo holds a posture
    that differs from the model's reference, because its author intends that posture.
    """
    low, high = np.asarray(model.actuator_ctrlrange, dtype=np.float64).reshape(-1, 2).T
    limited = np.asarray(model.actuator_ctrllimited).astype(bool)
    outside = limited & ((low > 0) | (high < 0))
    controls = np.where(outside, (low + high) / 2, 0.0)
    position_actuators = np.flatnonzero(
        (np.asarray(model.actuator_gaintype) == _FIXED_GAIN)
        & (np.asarray(model.actuator_biastype) == _AFFINE_BIAS)
        & (np.asarray(model.actuator_dyntype) != _INTEGRATOR_DYNAMICS)
        & (np.asarray(model.actuator_biasprm)[:, 1] < 0)
        & (np.asarray(model.actuator_gainprm)[:, 0] > 0)
    )
    if not position_actuators.size or np.array_equal(qpos, model.qpos0):
        return controls
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_fwdPosition(model, data)
    for actuator in position_actuators:
        control = _servo_control(model, int(actuator), data.actuator_length[actuator])
        ends = (low[actuator], high[actuator]) if limited[actuator] else (-np.inf, np.inf)
        controls[actuator] = np.clip(control, *ends)
    return controls


def pushed_bodies(model: mujoco.MjModel) -> NDArray[np.intp]:
    """Return the bodies that an excitation pushes: free ones.

    If there are neither free bodies nor actuators, it pushes the last bodies of every chain,
    because nothing would move otherwise.
    """
    free = np.asarray(model.jnt_type) == int(mujoco.mjtJoint.mjJNT_FREE)
    if free.any() or model.nu:
        return np.asarray(model.jnt_bodyid)[free].astype(np.intp)
    jointed = np.asarray(model.body_weldid) > 0
    last = ~np.isin(np.arange(model.nbody), np.asarray(model.body_parentid)[1:])
    return np.flatnonzero(jointed & last & (np.asarray(model.body_mass) > 0))


def excitation_signals(
    model: mujoco.MjModel, rest: Floats, span: tuple[float, float], seed: int
) -> Signals:
    """Return sines of controls around the middle of their ranges, and pushes of bodies.

    Controls start from the rest values (nu,) at the begin of their span [s], and are held for
    20 ms each. Frequencies and phases come from the seed. A body is pushed once, by its weight
    (with everything that it carries) across gravity, for 50 ms, in the first part of the span.
    """
    begin, end = span
    random = np.random.default_rng([seed, 4])  # other streams of a seed perturb, or make noise
    hertz = random.uniform(0.5, 1.5, model.nu)  # of slow motions, which most joints can follow
    phases = random.uniform(0, 2 * np.pi, model.nu)
    low, high = control_ranges(model).reshape(-1, 2).T
    # Share of a control's range that a sine covers.
    middle, reach = (low + high) / 2, 0.7 * (high - low) / 2

    control_rate = 50.0  # changes of the controls [Hz], as of a policy; they are held in between
    hold_times = np.arange(max(int(np.ceil((end - begin) * control_rate)), 1)) / control_rate
    push_time = 0.05  # duration of a push [s]
    push_moments = 8  # different times of pushes: each adds two knots to the signals of all
    moments = random.uniform(0, 1, push_moments) * max(end - begin - 2 * push_time, 0.0) / 2
    bodies = pushed_bodies(model)
    own = np.arange(len(bodies)) % push_moments
    edges = [moments[np.unique(own)], moments[np.unique(own)] + push_time] if len(bodies) else []
    times = np.unique(np.concatenate([hold_times, *edges]))
    # A control is constant between its own knots; the pushes of bodies have knots in between.
    since = hold_times[np.searchsorted(hold_times, times, side="right") - 1]

    waves = np.sin(2 * np.pi * hertz[:, None] * since + phases[:, None])
    # Growth time of sines to full amplitude [s].
    growth = np.minimum(since / 0.2, 1.0)
    aims = middle[:, None] + reach[:, None] * waves
    controls = rest[:, None] + growth * (aims - rest[:, None])
    # Forces as large as the bodies' weights, across gravity [N].
    gravity = np.array(model.opt.gravity)
    size = float(np.linalg.norm(gravity))
    down = gravity / size if size else np.zeros(3)
    ways = random.normal(size=(len(bodies), 3))
    ways -= (ways @ down)[:, None] * down
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    standard_gravity = 9.81  # in place of none: the push of a body in space is as large
    weights = np.asarray(model.body_subtreemass)[bodies] * (size or standard_gravity)
    forces = weights[:, None] * ways
    active = (times >= moments[own][:, None]) & (times < moments[own][:, None] + push_time)
    pushes = (forces[:, :, None] * active[:, None, :]).reshape(-1, len(times))
    places = [np.arange(model.nu), (model.nu + 6 * bodies[:, None] + np.arange(3)).ravel()]
    levels = np.concatenate([controls, pushes])
    before = np.concatenate([rest, np.zeros(len(pushes))])
    knots = np.repeat(begin + times, 2)
    knot_levels = np.concatenate([before[:, None], levels], axis=1)
    return Signals(
        np.concatenate(places).astype(np.intp),
        knots[None],
        np.repeat(knot_levels, 2, axis=1)[:, 1:-1],
    )


def noise_signals(
    rest: Floats, half: Floats, noise: NoiseDrive, end: float, seeds: Sequence[int]
) -> list[Signals]:
    """Return noise of each seed around rest controls (nu,): sines of equal size with random phases.

    Their frequencies, 64 or more, are evenly spaced up to the highest, and so close that the sum
    repeats only after the end of the run, a time [s]. Its root mean square is a share of half the
    range of each control (nu,). It grows over the first period of its highest frequency.
    """
    # Fewest sines of each control; their sum is nearly normal.
    sines = 64
    while sines < end * noise.rate:
        sines *= 2
    shape = len(half), sines
    # Other streams of a seed perturb the start, or excite.
    streams = [np.random.default_rng([seed, 3]) for seed in seeds]
    phases = [random.uniform(0, 2 * np.pi, shape) for random in streams]
    # Knots per period of the highest frequency; linear interpolation loses 1.4 % of it.
    knots_per_period = 12
    spectrum = np.zeros((len(seeds), len(half), sines * knots_per_period // 2 + 1), np.complex128)
    spectrum[:, :, 1 : sines + 1] = np.exp(1j * np.array(phases))
    count = int(np.ceil(end * noise.rate * knots_per_period)) + 1
    # A sine of size 1 has the mean square 1/2; `irfft` divides by the number of knots.
    wave = np.fft.irfft(spectrum)[:, :, :count] * sines * knots_per_period / np.sqrt(2 * sines)
    knots = np.arange(wave.shape[2]) / (noise.rate * knots_per_period)
    wave *= np.minimum(knots * noise.rate, 1.0)
    levels = rest[:, None] + noise.noise * half[:, None] * wave
    return [Signals(np.arange(len(half)), knots[None], level) for level in levels]
