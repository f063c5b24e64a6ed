"""The closed-form boundary that some scenes draw through their maps."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from contactlab.contact.contact_laws import damping_ratio, restitution_of
from contactlab.contact.trace_arrays import Floats
from contactlab.reporting.report_columns import GridAxis
from contactlab.store.finished_store import Store


class BoundaryLaw(NamedTuple):
    """A closed form that separates two outcomes along an axis.

    Attributes:
        critical: the critical value, from friction and restitution.
    """

    axis: str
    meaning: str
    critical: Callable[[float, float], float]


_LAWS: Mapping[str, BoundaryLaw] = MappingProxyType(
    {
        "incline": BoundaryLaw(
            "tilt",
            "the angle of friction, atan μ; steeper slopes slide",
            lambda friction, _: math.degrees(math.atan(friction)),
        ),
        "oblique_impact": BoundaryLaw(
            "angle",
            "the boundary of Coulomb's cone, tan = μ (1 + e); smaller angles stick",
            lambda friction, restitution: math.degrees(math.atan(friction * (1 + restitution))),
        ),
    }
)


@dataclass(frozen=True)
class Boundary:
    """A closed form's boundary in n runs.

    Attributes:
        values: (n,) the critical value of each run, in the axis' unit.
    """

    axis: GridAxis
    meaning: str
    values: Floats

    def along(self, values: Floats) -> Floats:
        """Return where values lie along the axis, in cells; NaN beyond its ends."""
        middles = np.arange(len(self.axis.tick_values)) + 0.5
        return np.interp(values, self.axis.tick_values, middles, left=np.nan, right=np.nan)


def read_boundary(store: Store, axes: tuple[GridAxis, ...]) -> Boundary | None:
    """Return the boundary of a store's scene, where it has one and sweeps its axis."""
    law = _LAWS.get(store.manifest.sweep.scene)
    axis = next((each for each in axes if law and each.name == law.axis), None)
    if law is None or axis is None or not np.isfinite(axis.tick_values).all():
        return None
    codes, pairs = store.columns.strings("pairs")
    critical = np.array([_critical(law, each) for each in pairs])
    return Boundary(axis, law.meaning, critical[codes])


def _critical(law: BoundaryLaw, pairs: str) -> float:
    """Return the critical value of a run, from the parameters of its only pair."""
    contacts = list(json.loads(pairs).values())
    if len(contacts) != 1:
        return math.nan
    restitution = float(restitution_of(damping_ratio(contacts[0]["solref"])))
    return law.critical(contacts[0]["friction"][0], restitution)
