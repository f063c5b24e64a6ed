"""Where a scene's closed form draws a line through its maps."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from contactlab.contact import Floats, damping_ratio, restitution_of
from contactlab.report.map_cells import MapAxes
from contactlab.report.report_columns import GridAxis
from contactlab.store import Store

Rows = list[dict[str, Any]]


class BoundaryLaw(NamedTuple):
    """A critical value.

    Attributes:
        axis: the axis that it is a value of.
        told: what it is.
        critical: the value, from friction and restitution.
    """

    axis: str
    told: str
    critical: Callable[[float, float], float]


LAWS: Mapping[str, BoundaryLaw] = MappingProxyType(
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
        axis: the axis that it is a value of.
        told: what it is.
        values: (n,) the critical value of each run, in the axis' unit.
    """

    axis: GridAxis
    told: str
    values: Floats

    def along(self, values: Floats) -> Floats:
        """Return where values lie along the axis, in cells; NaN beyond its ends."""
        middles = np.arange(len(self.axis.marks)) + 0.5
        return np.interp(values, self.axis.marks, middles, left=np.nan, right=np.nan)


def read_boundary(store: Store, axes: tuple[GridAxis, ...]) -> Boundary | None:
    """Return the boundary of a store's scene, where it has one and sweeps its axis."""
    law = LAWS.get(store.manifest.sweep.scene)
    axis = next((each for each in axes if law and each.name == law.axis), None)
    if law is None or axis is None or not np.isfinite(axis.marks).all():
        return None
    codes, words = store.columns.strings("pairs")
    known = np.array([_critical(law, word) for word in words])
    return Boundary(axis, law.told, known[codes])


def _critical(law: BoundaryLaw, pairs: str) -> float:
    """Return the critical value of a run, from the parameters of its only pair."""
    found = list(json.loads(pairs).values())
    if len(found) != 1:
        return math.nan
    restitution = float(restitution_of(damping_ratio(found[0]["solref"])))
    return law.critical(found[0]["friction"][0], restitution)


def boundary_rows(plane: MapAxes, boundary: Boundary | None) -> Rows:
    """Return the ends of the lines to draw: two for each cell across the axis, at most.

    Where the runs of a row, or of a column, differ in their critical value, the least and the
    largest are drawn.
    """
    if boundary is None or boundary.axis.name not in {plane.x.name, plane.y and plane.y.name}:
        return []
    is_across = plane.x.name == boundary.axis.name
    other = plane.y if is_across else plane.x
    codes = other.codes if other else np.zeros(len(boundary.values), dtype=np.int64)
    rows: Rows = []
    for code in np.unique(codes).tolist():
        own = boundary.values[codes == code]
        for place in np.unique(boundary.along(np.array([own.min(), own.max()]))).tolist():
            if math.isfinite(place):
                rows += _line(place, code, len(rows) // 2, is_across=is_across)
    return rows


def _line(place: float, code: int, part: int, *, is_across: bool) -> Rows:
    ends = [(place, code), (place, code + 1)] if is_across else [(code, place), (code + 1, place)]
    return [
        {"x": x, "y": y, "order": order, "part": str(part)} for order, (x, y) in enumerate(ends)
    ]
