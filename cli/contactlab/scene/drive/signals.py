"""What controls do over time around those that hold a posture: noise, and an exercise.

Both are made of knots at times in seconds, so that they are the same at every timestep.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.scene.drive.hold import Posture, Servos, is_integrated
from contactlab.scene.timed_inputs import Signals
from contactlab.schema.drive import NoiseDrive

_LEAST_SINES = 64  # sines of each control at least; their sum is nearly normal
# Knots of a period of the highest frequency: linear between them, 1.4 % of it is lost.
_KNOTS = 12
_STREAM = 3  # the seed's stream of random numbers for controls; the first perturbs the start

# Peak speed of joints [rad/s or m/s], and how far those without limits go [rad or m].
_SPEED = 6.0
_WAY = 0.5
_ALONE = 0.7
_LEAST_WINDOW = 0.4
"""How long each actuator moves at least [s]; with less time for each, they overlap."""
_KNOTS_OF_LEG = 13  # knots of each of the three legs of a way: to one end, to the other, and back


def exercise_duration(model: mujoco.MjModel) -> float:
    """Return how long an exercise of a model takes [s], where nothing else says."""
    return min(1.0 + 0.5 * model.nu, 10.0) if model.nu else 2.0


@dataclass(frozen=True)
class ControlRoom:
    """What controls may do."""

    half: Floats  # (nu,) half the range of each; 0 where there is none
    travel: Floats  # (nu, 2) how far an exercise goes from those held, to both sides
    speed: Floats  # (nu,) how fast it moves each at most [1/s]; 0 where any speed will do


def control_room(model: mujoco.MjModel, servos: Servos, posture: Posture) -> ControlRoom:
    """Return what the controls of a model may do around those that hold a posture."""
    usable = np.where(posture.gain == 0, np.inf, posture.gain)
    stiffness = np.where(model.actuator_biastype == 0, 0.0, -model.actuator_biasprm[:, 1])
    stiffness[servos.actuators] += servos.stiffness
    slope = stiffness / usable
    ways = _ways(model, posture) - posture.lengths[:, None]
    ranges = (
        (model.actuator_ctrllimited, model.actuator_ctrlrange, 1.0),
        (model.actuator_forcelimited, model.actuator_forcerange, usable),
    )
    half = np.abs(np.ptp(ways, axis=1) / 2 * slope)
    for limited, bounds, by in reversed(ranges):
        half = np.where(limited, np.abs(np.ptp(bounds, axis=1) / 2 / by), half)
    # What has no length goes through its controls.
    low, high = _offsets(model, servos, posture)
    straight = np.stack([low, high], axis=1)
    straight[~np.isfinite(straight)] = 0.0
    travel = np.where(slope[:, None] != 0, np.sort(ways * slope[:, None]), straight)
    speed = _SPEED * np.abs(slope) * posture.rates
    rated = is_integrated(model) & model.actuator_ctrllimited.astype(bool)
    most = np.abs(model.actuator_ctrlrange).min(axis=1, initial=np.inf)
    speed[rated] = np.minimum(speed, most)[rated]
    return ControlRoom(half, np.clip(travel, low[:, None], high[:, None]), speed)


def _offsets(model: mujoco.MjModel, servos: Servos, posture: Posture) -> tuple[Floats, Floats]:
    """Return (nu,) how far controls may go down and up, integrated ones as activations."""
    integrated = is_integrated(model)[:, None]
    limited = np.where(
        integrated, model.actuator_actlimited[:, None], model.actuator_ctrllimited[:, None]
    )
    bounds = np.where(integrated, model.actuator_actrange, model.actuator_ctrlrange)
    offsets = np.where(limited, bounds - posture.inputs[:, None], [-np.inf, np.inf])
    # What has a spring is limited by its force.
    offsets[servos.actuators] = -np.inf, np.inf
    return np.minimum(offsets[:, 0], 0.0), np.maximum(offsets[:, 1], 0.0)


def _ways(model: mujoco.MjModel, posture: Posture) -> Floats:
    """Return (nu, 2) the lengths of actuators between limits of their joint or tendon."""
    lengths = posture.lengths
    ways = lengths[:, None] + np.array([-_WAY, _WAY]) * posture.rates[:, None]
    kinds, items = np.asarray(model.actuator_trntype), np.asarray(model.actuator_trnid)[:, 0]
    tables = (
        (mujoco.mjtTrn.mjTRN_JOINT, model.jnt_limited, model.jnt_range),
        (mujoco.mjtTrn.mjTRN_JOINTINPARENT, model.jnt_limited, model.jnt_range),
        (mujoco.mjtTrn.mjTRN_TENDON, model.tendon_limited, model.tendon_range),
    )
    for kind, limited, ranges in tables:
        for actuator in np.flatnonzero(kinds == int(kind)):
            if limited[items[actuator]]:
                ends = ranges[items[actuator]] * model.actuator_gear[actuator, 0]
                reached = [*ends, lengths[actuator]]
                ways[actuator] = min(reached), max(reached)
    return ways


def noise_signals(
    posture: Posture,
    half: Floats,
    noise: NoiseDrive,
    span: tuple[float, float],
    seeds: Sequence[int],
) -> list[Signals]:
    """Return noise of each seed around held controls: a sum of sines of equal size, random phases.

    Their frequencies are evenly spaced up to the highest, 64 or more, and so close that the sum
    repeats after the run only. Its root mean square is a share of half the range of each control,
    (nu,). It grows over the first period of its highest frequency in its span, begin and end [s].
    """
    begin, end = span
    sines = _LEAST_SINES
    while sines < (end - begin) * noise.rate:
        sines *= 2
    shape = len(half), sines
    phases = [np.random.default_rng([seed, _STREAM]).uniform(0, 2 * np.pi, shape) for seed in seeds]
    spectrum = np.zeros((len(seeds), len(half), sines * _KNOTS // 2 + 1), np.complex128)
    spectrum[:, :, 1 : sines + 1] = np.exp(1j * np.array(phases))
    count = int(np.ceil(max(end - begin, 0.0) * noise.rate * _KNOTS)) + 1
    # A sine of size 1 has the mean square 1/2; `irfft` divides by the number of knots.
    wave = np.fft.irfft(spectrum)[:, :, :count] * sines * _KNOTS / np.sqrt(2 * sines)
    knots = np.arange(wave.shape[2]) / (noise.rate * _KNOTS)
    wave *= np.minimum(knots * noise.rate, 1.0)
    levels = posture.ctrl[:, None] + noise.noise * half[:, None] * wave
    return [Signals(np.arange(len(half)), begin + knots[None], each) for each in levels]


def exercise_signals(
    model: mujoco.MjModel, posture: Posture, room: ControlRoom, begin: float, end: float
) -> Signals:
    """Return controls that go through their ranges one by one, then all together.

    A control goes to one end of its travel, to the other, and back, as far as there is time for at
    a moderate speed, between a begin and an end [s]. If there is little time for each, one begins
    before the last one ends.
    """
    count, alone = model.nu, begin + _ALONE * (end - begin)
    stride = (alone - begin) / max(count, 1)
    window = min(max(stride, _LEAST_WINDOW), alone - begin)
    starts = np.minimum(begin + stride * np.arange(count), alone - window)
    integrated = is_integrated(model)
    lines: list[tuple[Floats, Floats]] = []
    for each, start in enumerate(starts):
        own, together = _way(room, each, start, window), _way(room, each, alone, end - alone)
        times, offsets = np.concatenate([own, together], axis=1)
        lines.append((times, offsets) if not integrated[each] else _rates(times, offsets))
    most = max(len(times) for times, _ in lines)
    padded = [[np.pad(part, (0, most - len(part)), "edge") for part in line] for line in lines]
    times, levels = np.moveaxis(np.array(padded), 1, 0)
    return Signals(np.arange(count), times, posture.ctrl[:, None] + levels)


def _way(room: ControlRoom, actuator: int, begin: float, window: float) -> Floats:
    """Return (2, K) times, and how far from its held value a control is then.

    It goes to one end of its travel, to the other, and back: each leg half a period of a cosine, at
    one peak speed, so that its time is as its length.
    """
    low, high = room.travel[actuator]
    stops = np.array([0.0, high, low, 0.0])
    lengths = np.abs(np.diff(stops))
    whole, speed = lengths.sum(), room.speed[actuator]
    peak = np.pi / 2 * whole / window if window > 0 else np.inf
    shrink = min(1.0, speed / peak) if speed and whole else 1.0
    along = np.linspace(0.0, 1.0, _KNOTS_OF_LEG)
    ease = (1 - np.cos(np.pi * along)) / 2
    ends = np.cumsum([0.0, *lengths]) / max(whole, np.finfo(float).tiny)
    times = ends[:-1, None] + np.diff(ends)[:, None] * along
    offsets = stops[:-1, None] + np.diff(stops)[:, None] * ease
    return np.stack([begin + window * times.ravel(), shrink * offsets.ravel()])


def _rates(times: Floats, offsets: Floats) -> tuple[Floats, Floats]:
    """Return the knots of a control that is the rate of what goes along some offsets."""
    steps = np.diff(times)
    rates = np.where(steps > 0, np.diff(offsets) / np.where(steps > 0, steps, 1.0), 0.0)
    return np.append(np.repeat(times, 2)[1:-1], times[-1]), np.append(np.repeat(rates, 2), 0.0)
