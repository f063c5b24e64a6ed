"""Everything that a report is made of, read once."""

from dataclasses import dataclass

from contactlab.report.boundaries import Boundary, read_boundary
from contactlab.report.cells import Plane, telling_plane
from contactlab.report.grid import GridAxis, read_grid
from contactlab.report.outcomes import Outcomes, read_outcomes
from contactlab.report.quantities import Quantity, read_quantities
from contactlab.report.weighing import Weighing, weigh_store, weighing
from contactlab.store import Store
from contactlab.tradeoff import Question

_NOTHING = Question()


@dataclass(frozen=True)
class Gathered:
    """A store as a report sees it.

    Attributes:
        store: the store.
        axes: the axes that differ between its runs.
        outcomes: the labels of its runs.
        quantities: what was measured of them.
        plane: the two axes that tell most; None without axes.
        boundary: the line that the scene's closed form draws through maps; None without.
        weighing: accuracy against time; None where the store has no error.
        unweighed: why there is none.
    """

    store: Store
    axes: tuple[GridAxis, ...]
    outcomes: Outcomes
    quantities: tuple[Quantity, ...]
    plane: Plane | None
    boundary: Boundary | None
    weighing: Weighing | None
    unweighed: str


def gather(store: Store, question: Question = _NOTHING) -> Gathered:
    """Read what a report of a store needs.

    Raises:
        SweepFileError: the question names what the store does not have.
        StoreError: the store has no value of the error that is asked for.
    """
    axes, outcomes = read_grid(store), read_outcomes(store)
    quantities = read_quantities(store)
    report, unweighed = weigh_store(store, question)
    return Gathered(
        store=store,
        axes=axes,
        outcomes=outcomes,
        quantities=quantities,
        plane=telling_plane(axes, outcomes),
        boundary=read_boundary(store, axes),
        weighing=weighing(store, report, quantities) if report else None,
        unweighed=unweighed,
    )
