"""How far a constant load moves a box against dry friction."""

from collections.abc import Callable

import numpy as np

from contactlab.contact import Floats
from contactlab.measure.context import Context
from contactlab.measure.oracles.motion import along, fall, moved, pulled, sliding_friction
from contactlab.measure.oracles.oracle import Oracle, setting


def _incline(context: Context) -> tuple[Floats, Floats]:
    tilt = np.radians(setting(context, "tilt"))
    weight = setting(context, "weight") / context.setup.free_bodies[0].mass
    return _share(context, weight * np.sin(tilt), weight * np.cos(tilt))


def _pushed_box(context: Context) -> tuple[Floats, Floats]:
    load = setting(context, "push") / context.setup.free_bodies[0].mass
    return _share(context, load, fall(context))


def _share(context: Context, load: Floats, pressure: Floats) -> tuple[Floats, Floats]:
    """Return what a load moves, with friction, of the way that it would go without.

    Args:
        context: the runs.
        load: (n,) tangential load over mass [m/s^2].
        pressure: (n,) normal load over mass [m/s^2].
    """
    free = load * pulled(context, context.trace.steps)
    expected = np.maximum(1 - sliding_friction(context) * pressure / load, 0)
    return expected, along(context, moved(context)) / free


def _oracle(
    name: str,
    load: str,
    settings: tuple[str, ...],
    function: Callable[[Context], tuple[Floats, Floats]],
) -> Oracle:
    return Oracle(
        name=name,
        unit="1",
        relative=False,
        definition=(
            f"{load} A load F moves a box, pressed on by N, by max(1 - mu N / F, 0) of the way "
            "F t^2 / (2 m) that it would go without friction (Coulomb; t^2 is (h n) h (n + 1) "
            "after n semi-implicit steps). Measured: displacement of the first free body along "
            "the load over that way. What sticks creeps in soft contact, and that counts."
        ),
        settings=(*settings, "direction", "friction", "integrator"),
        function=function,
    )


INCLINE = _oracle(
    "incline",
    "On a slope of the angle `tilt`, F = `weight` sin(tilt) and N = `weight` cos(tilt).",
    ("tilt", "weight"),
    _incline,
)
PUSHED_BOX = _oracle("pushed_box", "Pushed by F = `push`, with N = m g.", ("push",), _pushed_box)
