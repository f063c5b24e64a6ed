"""How fast a top precesses."""

import numpy as np

from contactlab.contact import Floats, rotate
from contactlab.measure.context import Context
from contactlab.measure.oracles.oracle import Oracle

_AXIS = np.array([0.0, 0.0, 1.0])


def _precession(context: Context) -> tuple[Floats, Floats]:
    # Of a ball joint and of a free joint that comes first, w starts where the quaternion does.
    first = context.setup.quaternions[0]
    attitude = context.trace.qpos[:, :, first : first + 4]
    turning = context.trace.qvel[:, 0, first : first + 3]
    axis = rotate(attitude, _AXIS)
    start = axis[:, 0]
    moving = np.cross(rotate(attitude[:, 0], turning), start)
    rate = (start[:, 0] * moving[:, 1] - start[:, 1] * moving[:, 0]) / (start[:, :2] ** 2).sum(1)
    azimuth = np.unwrap(np.arctan2(axis[..., 1], axis[..., 0]), axis=1)
    return rate, (azimuth[:, -1] - azimuth[:, 0]) / context.seconds


PRECESSION = Oracle(
    name="precession",
    unit="rad/s",
    relative=True,
    definition=(
        "A symmetric top that starts in steady precession keeps its rate, which is that of its "
        "axis in the first state. The scene's start must have it: the slow root W of "
        "I1 cos(tilt) W^2 - I3 spin W + m g l = 0, with moments about the pivot. Measured: azimuth "
        "of the axis, z of the body on the model's first joint, over the whole run and time."
    ),
    settings=("timestep",),
    function=_precession,
)
