"""What no real body's mass and inertia can be, rule by rule.

For a body of mass m and principal moments A <= B <= C about its centre of mass:

* A > 0 and A + B >= C, since moments are integrals of squared distances;
* m over the volume of its geoms is the density of some material;
* half of A + B + C less one moment is m times the mean square distance from the plane across that
  moment's axis, which in a shape of length L is at most (L / 2)^2 (Popoviciu's inequality);
* (A + B + C) / 2 is m times the mean square distance from the centre, which is least for a ball.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from contactlab.contact import Floats
from contactlab.scene.shape import extent, solid_geoms, volume

Kind = Literal[
    "not_positive", "triangle", "balanced", "density", "outside", "too_large", "too_small"
]
# Foam and hollow shells to osmium and its like [kg/m^3].
LIGHTEST, DENSEST = 50.0, 20000.0
# Shapes are simplified: a centre of mass may lie this share of a shape's length outside of it, and
# distances may be this many times what would fit.
_OUTSIDE = 0.05
_SLACK = 2.0
# Of a uniform rod it is 0.29; nothing built has all its mass within a tenth of its length.
_LEAST_SPREAD = 1 / 30


@dataclass(frozen=True)
class InertiaFault:
    """A body whose mass or inertia cannot be real.

    Attributes:
        body: its name.
        kind: what is wrong.
        value: the number that shows it.
        limit: what the number would have to keep.
        unit: of both.
        reason: all of it in words.
    """

    body: str
    kind: Kind
    value: float
    limit: float
    unit: str
    reason: str


@dataclass(frozen=True)
class Body:
    """A body, its inertia about its centre of mass.

    Attributes:
        name: its name.
        mass: [kg].
        moments: (3,) about the axes [kg m^2].
        axes: (3, 3) principal axes as columns, in the body's frame.
        centre: (3,) of mass, in the body's frame [m].
    """

    name: str
    mass: float
    moments: Floats
    axes: Floats
    centre: Floats


def not_positive(name: str, mass: float, moments: Floats) -> InertiaFault:
    """Return the fault of a body without mass or inertia, or with less than none."""
    return InertiaFault(
        name,
        "not_positive",
        float(np.min([mass, *moments])),
        0.0,
        "kg or kg m^2",
        f"its mass is {mass:g} kg and its principal moments are {_listed(moments)} kg m^2; "
        "write all of them above 0",
    )


def closes(moments: Floats) -> bool:
    """Say whether no principal moment is above the sum of the others."""
    low, middle, high = np.sort(moments)
    return bool(low + middle >= high)


def open_triangle(name: str, moments: Floats, *, balanced: bool) -> InertiaFault:
    """Return the fault of moments that no body has, which the compiler may have replaced."""
    low, middle, high = np.sort(moments).tolist()
    end = f"; balanceinertia replaced all three by their mean, {np.mean(moments):g}"
    return InertiaFault(
        name,
        "balanced" if balanced else "triangle",
        high,
        low + middle,
        "kg m^2",
        f"its principal moments are {_listed(moments)} kg m^2, and no mass distribution has "
        f"{low:g} + {middle:g} < {high:g}" + (end if balanced else ""),
    )


def density_faults(model: mujoco.MjModel, index: int, body: Body) -> Iterator[InertiaFault]:
    """Yield where a body's geoms are of no material that there is."""
    space = sum(volume(model, geom) for geom in solid_geoms(model, index))
    density = body.mass / space if space else LIGHTEST
    if LIGHTEST <= density <= DENSEST:
        return
    light = density < LIGHTEST
    limit = LIGHTEST if light else DENSEST
    words = "lighter than foam" if light else "denser than any metal"
    yield InertiaFault(
        body.name,
        "density",
        density,
        limit,
        "kg/m^3",
        f"its mass of {body.mass:g} kg in the {space:.3g} m^3 of its geoms makes "
        f"{density:.3g} kg/m^3, {words} ({limit:g})",
    )


def shape_faults(model: mujoco.MjModel, index: int, body: Body) -> Iterator[InertiaFault]:
    """Yield where a body's mass would have to lie outside its shape, or all in one place."""
    spreads = np.sqrt(np.maximum(body.moments.sum() / 2 - body.moments, 0) / body.mass)
    length = 0.0
    if solid_geoms(model, index):
        spans = [extent(model, index, body.axes[:, axis]) for axis in range(3)]
        lengths = [high - low for low, high in spans]
        length = max(lengths)
        yield from _outside(body, spans)
        worst = int(np.argmax(spreads / lengths))
        if spreads[worst] > _SLACK * lengths[worst] / 2:
            yield _too_large(body, float(spreads[worst]), lengths[worst])
    yield from _too_small(body, float(np.sqrt((spreads**2).sum())), length)


def _outside(body: Body, spans: list[tuple[float, float]]) -> Iterator[InertiaFault]:
    places = body.axes.T @ body.centre
    beyond = [
        max(low - place, place - high, 0.0)
        for (low, high), place in zip(spans, places, strict=True)
    ]
    worst = int(np.argmax(beyond))
    allowed = _OUTSIDE * (spans[worst][1] - spans[worst][0])
    if beyond[worst] > allowed:
        yield InertiaFault(
            body.name,
            "outside",
            beyond[worst],
            allowed,
            "m",
            f"its centre of mass lies {beyond[worst]:.3g} m outside its geoms",
        )


def _too_large(body: Body, spread: float, length: float) -> InertiaFault:
    return InertiaFault(
        body.name,
        "too_large",
        spread,
        _SLACK * length / 2,
        "m",
        f"its inertia puts its mass {spread:.3g} m (rms) from its centre along an axis on which "
        f"its geoms are {length:.3g} m long, where at most {length / 2:.3g} m would fit",
    )


def _too_small(body: Body, spread: float, length: float) -> Iterator[InertiaFault]:
    ball = math.sqrt(3 / 5) * (3 * body.mass / (4 * math.pi * DENSEST)) ** (1 / 3)
    # A body without a moment of its own is a point that is fixed to others.
    limit = max(ball, _LEAST_SPREAD * length)
    if 0 < spread < limit:
        yield InertiaFault(
            body.name,
            "too_small",
            spread,
            limit,
            "m",
            f"its inertia puts its mass within {spread:.3g} m (rms) of its centre; "
            + (
                f"a ball of {body.mass:g} kg of the densest metal has {ball:.3g} m"
                if limit == ball
                else f"its geoms are {length:.3g} m long"
            ),
        )


def _listed(moments: Floats) -> str:
    return ", ".join(f"{each:g}" for each in moments)
