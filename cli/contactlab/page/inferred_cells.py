"""Labels of cells without a run in maps: inferred, if a sweep refined its grid."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from contactlab.reporting.map_axes import MapAxes
from contactlab.reporting.report import ReportData
from contactlab.reporting.report_columns import Codes, tick_of

NOT_INFERRED = -1


@dataclass(frozen=True)
class InferredLabels:
    """The labels that are inferred for one seed and some values of the other axes.

    Attributes:
        shared: place among the ticks of each other axis that varies, and of the seed, by name.
        codes: (rows, columns) of a map of the refined axes, the first of them being horizontal:
            index into the names of labels, `NOT_INFERRED` of cells that ran or are not known.
    """

    shared: dict[str, int]
    codes: Codes


def inferred_labels(data: ReportData) -> Iterator[InferredLabels]:
    """Yield the inferred labels, for maps of one axis or two; none for other sweeps."""
    boundaries = data.boundaries
    if boundaries is None or boundaries.where != "label" or len(boundaries.grid.axes) > 2:
        return
    axes = {axis.name: axis for axis in data.axes}
    if not boundaries.grid.axes.keys() <= axes.keys():
        return
    places = [
        np.array([tick_of(axes[name], value) for value in values])
        for name, values in boundaries.grid.axes.items()
    ]
    shape = [len(axes[name].ticks) for name in boundaries.grid.axes]
    for sides in boundaries.sides:
        codes = np.full(shape, NOT_INFERRED, np.int64)
        names = np.array([data.labels.names.index(name) for name in sides.names])
        codes[np.ix_(*places)] = np.where(sides.ran, NOT_INFERRED, names[sides.codes])
        shared = {
            name: tick_of(axes[name], value) for name, value in sides.shared.items() if name in axes
        }
        yield InferredLabels(shared, codes.reshape(len(codes), -1).T)


def agreed_labels(data: ReportData, axes: MapAxes) -> Codes | None:
    """Return (rows, columns) the common labels of all inferred maps; None for other axes."""
    parts, grid = [part.codes for part in inferred_labels(data)], data.boundaries
    if not parts or grid is None or {*axes.names} != {*grid.grid.axes}:
        return None
    same = np.where((np.array(parts) == parts[0]).all(axis=0), parts[0], NOT_INFERRED)
    return same if axes.names[0] == next(iter(grid.grid.axes)) else same.T
