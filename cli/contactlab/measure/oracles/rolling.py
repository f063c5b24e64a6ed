"""How a homogeneous sphere rolls: down a slope, from a slide, and against rolling friction."""

import numpy as np

from contactlab.contact import Floats
from contactlab.measure.context import Context
from contactlab.measure.oracles.motion import (
    along,
    fall,
    moved,
    pulled,
    sliding_friction,
    speed,
    spin,
)
from contactlab.measure.oracles.oracle import Oracle, setting

_LEFT = 0.05
"""Share of the slip at the start that counts as rolling: well above the creep of soft contact."""


def _roll_down(context: Context) -> tuple[Floats, Floats]:
    tilt = np.radians(setting(context, "tilt"))
    slides = 1 - sliding_friction(context) / np.tan(tilt)
    weight = setting(context, "weight") / context.setup.free_bodies[0].mass
    free = weight * np.sin(tilt) * pulled(context, context.trace.steps)
    return np.maximum(5 / 7, slides), along(context, moved(context)) / free


def _slide_to_roll(context: Context) -> tuple[Floats, Floats]:
    pace = speed(context)
    slip = pace - context.setup.thickness[0] * spin(context)
    rolls = slip <= _LEFT * pace[:, :1]
    time = rolls.argmax(axis=1) * context.trace.timestep
    stop = 2 * pace[:, 0] / (7 * sliding_friction(context) * fall(context))
    return (1 - _LEFT) * stop, np.where(rolls.any(axis=1), time, np.nan)


def _roll_friction(context: Context) -> tuple[Floats, Floats]:
    pace, radius = speed(context), context.setup.thickness[0]
    arm = setting(context, "friction").reshape(context.trace.runs, -1)[:, 3]
    return arm * fall(context) / (1.4 * radius), (pace[:, 0] - pace[:, -1]) / context.seconds


def _spin_down(context: Context) -> tuple[Floats, Floats]:
    rate, radius = spin(context), context.setup.thickness[0]
    arm = setting(context, "friction").reshape(context.trace.runs, -1)[:, 2]
    return arm * fall(context) / (0.4 * radius**2), (rate[:, 0] - rate[:, -1]) / context.seconds


ROLL_DOWN = Oracle(
    name="roll_down",
    unit="1",
    relative=True,
    definition=(
        "A homogeneous sphere on a slope of the angle `tilt` goes 5/7 of the way that it would go "
        "without friction, if mu >= (2/7) tan(tilt), and else 1 - mu / tan(tilt) of it. Measured: "
        "displacement of the first free body down the slope over g sin(tilt) t^2 / 2, with m g "
        "the scene's `weight`."
    ),
    settings=("tilt", "weight", "direction", "friction", "integrator"),
    function=_roll_down,
)

SLIDE_TO_ROLL = Oracle(
    name="slide_to_roll",
    unit="s",
    relative=True,
    definition=(
        "A homogeneous sphere that starts to slide at v0 without spin slips at "
        "v0 - (7/2) mu g t until it rolls. Measured: the time at which |v| - r |w| of the first "
        "free body is down to 5 % of v0; the last percents are creep."
    ),
    settings=("friction",),
    function=_slide_to_roll,
)

ROLL_FRICTION = Oracle(
    name="roll_friction",
    unit="m/s^2",
    relative=True,
    definition=(
        "A homogeneous sphere of radius r that rolls loses mu_r g / (1.4 r) of its speed a second: "
        "the moment mu_r N turns m r^2 7/5. Measured: mean loss of speed of the first free body, "
        "which must not stop within the run."
    ),
    settings=("friction",),
    function=_roll_friction,
)

SPIN_DOWN = Oracle(
    name="spin_down",
    unit="rad/s^2",
    relative=True,
    definition=(
        "A homogeneous sphere of radius r that spins about the normal loses mu_t g / (0.4 r^2) of "
        "its spin a second: the moment mu_t N turns m r^2 2/5. Measured: mean loss of spin of the "
        "first free body, which must not stop within the run."
    ),
    settings=("friction",),
    function=_spin_down,
)
