"""Detects angles that are in radians although the model is compiled in degrees."""

import math
from collections.abc import Iterator

import mujoco
import numpy as np

from contactlab.scene.model_names import name_of

MIN_LIMITED_HINGES = 2
"""Smallest number of limited hinges with a meaningful majority."""


def limited_hinges(model: mujoco.MjModel) -> list[int]:
    """Return the hinges that have limits."""
    hinges = (model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE)) & (model.jnt_limited != 0)
    return np.flatnonzero(hinges).tolist()


def find_radian_angles(model: mujoco.MjModel) -> Iterator[tuple[int, str]]:
    """Yield the first hinge and a message if angles read as degrees have the size of radians."""
    hinges = limited_hinges(model)
    if len(hinges) < MIN_LIMITED_HINGES:
        return
    narrow_range_rad = math.radians(15)  # joints of robots rarely have a smaller range
    narrow = [joint for joint in hinges if np.ptp(model.jnt_range[joint]) < narrow_range_rad]
    ranges_deg = np.rad2deg(model.jnt_range[narrow])
    full_turn_rad = 2 * math.pi * (1 + 1e-3)  # a full turn, with room for rounding by hand
    if 2 * len(narrow) > len(hinges) and np.abs(ranges_deg).max() <= full_turn_rad:
        low, high = ranges_deg[0].tolist()
        first = name_of(model, "joint", narrow[0])
        message = (
            f"{len(narrow)} of {len(hinges)} hinges turn by less than 15 degrees, as joint "
            f"'{first}' from {low:.4g} to {high:.4g} degrees: these numbers are radians"
        )
        yield narrow[0], message
