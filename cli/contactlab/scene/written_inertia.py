"""Inertias as written in a model file, before MuJoCo accepts, rejects or changes them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from mujoco._specs import MjsBody

from contactlab.contact.trace_arrays import Floats

Kind = Literal[
    "not_positive", "triangle", "balanced", "density", "outside", "too_large", "too_small"
]


@dataclass(frozen=True)
class InertiaFault:
    """A body whose mass or inertia no real body has.

    The value violates the limit, both in the unit; the reason is the whole fault in words.
    """

    body: str
    kind: Kind
    value: float
    limit: float
    unit: str
    reason: str


def written_inertia_faults(spec: mujoco.MjSpec) -> Iterator[InertiaFault]:
    """Yield the faults of the inertias that a model file writes out, before it is compiled."""
    compiler = spec.compiler
    if compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE:
        return
    for body in spec.bodies[1:]:
        # With joints, and no body fixed to it that could bring the inertia.
        alone = bool(body.joints) and all(child.joints for child in body.bodies)
        if not body.explicitinertial and (body.geoms or not alone):
            continue
        name = body.name or f"body {body.id}"
        mass = max(float(body.mass), compiler.boundmass or -np.inf)
        moments = np.maximum(_moments(body), compiler.boundinertia or -np.inf)
        # A body fixed to another may have no inertia of its own, but not a negative one.
        lower = mujoco.mjMINVAL if alone else -np.finfo(float).tiny
        if not np.min([mass, *moments]) > lower:
            yield not_positive(name, mass, moments)
        elif not closes(moments):
            yield open_triangle(name, moments, balanced=bool(compiler.balanceinertia))


def _moments(body: MjsBody) -> Floats:
    xx, yy, zz, xy, xz, yz = (float(each) for each in body.fullinertia)
    # The first number is NaN where diaginertia gives the moments.
    if np.isnan(xx):
        return np.array(body.inertia, np.float64)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return np.linalg.eigvalsh(tensor) if np.isfinite(tensor).all() else np.full(3, np.nan)


def not_positive(name: str, mass: float, moments: Floats) -> InertiaFault:
    """Return the fault of a body whose mass or inertia is zero or negative."""
    reason = (
        f"its mass is {mass:g} kg and its principal moments are {_listed(moments)} kg m^2; "
        "write all of them above 0"
    )
    least = float(np.min([mass, *moments]))
    return InertiaFault(name, "not_positive", least, 0.0, "kg or kg m^2", reason)


def closes(moments: Floats) -> bool:
    """Return whether no principal moment exceeds the sum of the other two."""
    low, middle, high = np.sort(moments)
    return bool(low + middle >= high)


def open_triangle(name: str, moments: Floats, *, balanced: bool) -> InertiaFault:
    """Return the fault of principal moments [kg m^2] that violate the triangle inequality.

    Balanced ones were replaced by their mean, by the compiler.
    """
    low, middle, high = np.sort(moments).tolist()
    end = f"; balanceinertia replaced all three by their mean, {np.mean(moments):g}"
    reason = (
        f"its principal moments are {_listed(moments)} kg m^2, and no mass distribution has "
        f"{low:g} + {middle:g} < {high:g}" + (end if balanced else "")
    )
    kind = "balanced" if balanced else "triangle"
    return InertiaFault(name, kind, high, low + middle, "kg m^2", reason)


def _listed(moments: Floats) -> str:
    return ", ".join(f"{each:g}" for each in moments)
