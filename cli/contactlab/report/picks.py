"""Which runs a page has the time series of."""

from collections.abc import Iterator

import numpy as np

from contactlab.report.cells import Plane
from contactlab.report.outcomes import Outcomes
from contactlab.schema import TradeoffReport
from contactlab.store import Store

_PER_LABEL = 3
_OTHERS = 60


def picked(
    store: Store, outcomes: Outcomes, plane: Plane | None, report: TradeoffReport | None, most: int
) -> list[int]:
    """Return the rows of at most so many runs that a reader will ask for first.

    What is recommended comes first, then a few of each label, the worst ones first, then one of
    each cell of the default map, then the others in the order of the plan.
    """
    if not most:
        return []
    ids = store.columns.keys("run_id")
    wanted = dict.fromkeys(_ordered(ids, outcomes, plane, report))
    return list(wanted)[:most]


def _ordered(
    ids: np.ndarray, outcomes: Outcomes, plane: Plane | None, report: TradeoffReport | None
) -> Iterator[int]:
    picks = [report.recommendation, report.robust] if report else []
    for pick in picks:
        if pick is not None:
            yield from np.flatnonzero(ids == pick.run_id.encode()).tolist()
    for code in range(len(outcomes.names)):
        yield from np.flatnonzero(outcomes.codes == code)[:_PER_LABEL].tolist()
    if plane is not None:
        yield from np.sort(np.unique(plane.cells, return_index=True)[1]).tolist()
    yield from range(min(len(ids), _OTHERS))
