"""How far a damped joint turns before it stands."""

from contactlab.contact import Floats
from contactlab.measure.context import Context, kinetic
from contactlab.measure.oracles.oracle import Oracle, setting


def _braking_angle(context: Context) -> tuple[Floats, Floats]:
    speed = context.trace.qvel[:, 0, 0]
    inertia = 2 * kinetic(context)[:, 0] / speed**2
    damping = setting(context, "joint_damping") + setting(context, "servo_gain")
    turned = context.trace.qpos[:, -1, 0] - context.trace.qpos[:, 0, 0]
    return speed * inertia / damping, turned


BRAKING_ANGLE = Oracle(
    name="braking_angle",
    unit="rad",
    relative=True,
    definition=(
        "A hinge of inertia I with damping c turns by w I / c before it stands, w its speed at the "
        "start: I w + c q is constant, which every implicit and every Runge-Kutta step keeps to "
        "the last digit. I is twice the kinetic energy at the start over w^2. Measured: change of "
        "the first joint's angle over the whole run."
    ),
    settings=("joint_damping", "servo_gain"),
    function=_braking_angle,
)
