"""How far a box slides before friction stops it."""

import numpy as np

from contactlab.contact import Floats, FreeBody
from contactlab.measure.context import Context
from contactlab.measure.oracles.oracle import Oracle, setting


def _sliding_distance(context: Context) -> tuple[Floats, Floats]:
    setup, speed = context.setup, setting(context, "speed")
    gravity = np.linalg.norm(setup.gravity, axis=1)
    friction = setting(context, "friction").reshape(context.trace.runs, -1)[:, 0]
    # Semi-implicit steps apply friction before they move the box: half a step's travel less.
    explicit = np.array([name == "RK4" for name in setup.settings["integrator"]])
    early = np.where(explicit, 0, speed * setting(context, "timestep") / 2)
    return speed**2 / (2 * friction * gravity) - early, _displacement(context, gravity)


def _displacement(context: Context, gravity: Floats) -> Floats:
    """Return (n,) how far [m] the first pair's free body is from its start, across gravity."""
    start = _slider(context).qpos
    ends = context.trace.qpos[:, [0, -1], start : start + 3]
    moved = ends[:, 1] - ends[:, 0]
    down = context.setup.gravity / gravity[:, None]
    return np.linalg.norm(moved - (moved * down).sum(axis=1, keepdims=True) * down, axis=1)


def _slider(context: Context) -> FreeBody:
    barriers = [each.body for each in context.setup.barriers if each.pair == 0]
    return (barriers or context.setup.free_bodies)[0]


SLIDING_DISTANCE = Oracle(
    name="sliding_distance",
    unit="m",
    relative=True,
    definition=(
        "D = v0^2 / (2 mu g) - v0 timestep / 2, Coulomb friction under semi-implicit Euler; RK4 "
        "has no second term. Measured: displacement across gravity of the first pair's free body "
        "over the whole run, which must be long enough for it to stop."
    ),
    settings=("speed", "friction", "timestep", "integrator"),
    function=_sliding_distance,
)
