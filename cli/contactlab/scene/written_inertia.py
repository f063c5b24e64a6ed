"""Inertias as a model's file gives them, before MuJoCo accepts, refuses or changes them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from mujoco._specs import MjsBody

from contactlab.contact import Floats

Kind = Literal[
    "not_positive", "triangle", "balanced", "density", "outside", "too_large", "too_small"
]


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
class _Written:
    """The inertia of one body as numbers of its file.

    Attributes:
        name: the body.
        mass: [kg].
        moments: (3,) principal moments [kg m^2], less than nothing too.
        least: what mass and moments must be above.
        balanced: whether moments that no body has are replaced by their mean.
    """

    name: str
    mass: float
    moments: Floats
    least: float
    balanced: bool


def written_inertia_faults(spec: mujoco.MjSpec) -> tuple[InertiaFault, ...]:
    """Return what is wrong with the inertias that a model gives as numbers, before it compiles."""
    return tuple(fault for each in _written_inertias(spec) for fault in _written_faults(each))


def _written_faults(written: _Written) -> Iterator[InertiaFault]:
    if not np.min([written.mass, *written.moments]) > written.least:
        yield not_positive(written.name, written.mass, written.moments)
    elif not closes(written.moments):
        yield open_triangle(written.name, written.moments, balanced=written.balanced)


def _written_inertias(spec: mujoco.MjSpec) -> Iterator[_Written]:
    """Yield the bodies whose inertia is written, or lacks where there must be one."""
    compiler = spec.compiler
    if compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE:
        return
    for body in spec.bodies[1:]:
        alone = _moves_alone(body)
        if body.explicitinertial or (alone and not body.geoms):
            yield _Written(
                body.name or f"body {body.id}",
                max(float(body.mass), compiler.boundmass or -np.inf),
                np.maximum(_moments(body), compiler.boundinertia or -np.inf),
                # What is fixed to others may have no inertia of its own, but no less than none.
                mujoco.mjMINVAL if alone else -np.finfo(float).tiny,
                bool(compiler.balanceinertia),
            )


def _moves_alone(body: MjsBody) -> bool:
    """Say whether a body has joints, and no body fixed to it that could bring the inertia."""
    return bool(body.joints) and all(child.joints for child in body.bodies)


def _moments(body: MjsBody) -> Floats:
    xx, yy, zz, xy, xz, yz = (float(each) for each in body.fullinertia)
    # The first number is not one where the moments are given along axes.
    if np.isnan(xx):
        return np.array(body.inertia, np.float64)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return np.linalg.eigvalsh(tensor) if np.isfinite(tensor).all() else np.full(3, np.nan)


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


def _listed(moments: Floats) -> str:
    return ", ".join(f"{each:g}" for each in moments)
