"""`search` of a sweep file: the worst of a metric, sought among the points of a plan."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import suggestion
from contactlab.plan.names import add_not_swept
from contactlab.plan.rows import SweepContext
from contactlab.plan.sides import check_asked
from contactlab.plan.yaml_document import Document
from contactlab.schema.sweep_schema import MARGIN_OF_MUST, Sweep
from contactlab.schema.vocabulary import (
    Axis,
    Linspace,
    Logspace,
    Loguniform,
    Range,
    Sampled,
    Uniform,
)

# Share of the trials that are spread over all of the cube; the others go on from the best.
_SPREAD = 0.4
# Axes up to which the corners of the cube are tried first, 16 at most.
_MOST_CORNERED = 4
# Points that may be proposed for each trial: several may be nearest to one of the plan.
_PROPOSALS = 4
# Descents that go on at a time: so many workers have something to do.
_SIDE_BY_SIDE = 2
# A descent ends where its simplex is so small; most calls by then are of points that were tried.
_LEAST_SIDE, _MOST_CALLS = 1e-4, 1000
_UNMEASURED = 1e12


def searched_axes(sweep: Sweep) -> tuple[str, ...]:
    """Return the axes that are searched: those named, or all that are drawn, or else all grids."""
    assert sweep.search is not None
    if sweep.search.axes:
        return sweep.search.axes
    drawn = [name for name, axis in sweep.axes.items() if isinstance(axis, Sampled)]
    grids = (name for name, axis in sweep.axes.items() if isinstance(axis, _GRIDS))
    return tuple(drawn or grids)


_GRIDS = Linspace | Logspace | Range
_FORMS = ("linspace", "logspace", "range", "uniform", "loguniform")


def write_out_searched(document: Document) -> None:
    """Name the axes that a file searches, before values in units are listed, if it names none."""
    search = document.mapping("search")
    if not search or search.get("axes"):
        return
    forms = {
        name: next((form for form in _FORMS if form in document.mapping("axes", name)), "")
        for name in document.mapping("axes")
    }
    drawn = [name for name, form in forms.items() if form.endswith("uniform")]
    if names := drawn or [name for name, form in forms.items() if form]:
        search["axes"] = names


def coordinates(axis: Axis, values: Sequence[object]) -> Callable[[object], float]:
    """Return what places the values of an axis between 0 and 1; NaN of what it cannot place."""
    match axis:
        case Uniform(uniform=(low, high)):
            return lambda value: (_number(value) - low) / (high - low)
        case Loguniform(loguniform=(low, high)):
            return lambda value: math.log(_number(value, above=0) / low) / math.log(high / low)
        case _:
            return _steps(values)


def _steps(values: Sequence[object]) -> Callable[[object], float]:
    places: dict[object, int] = {value: step for step, value in enumerate(values)}
    return lambda value: places.get(value, math.nan) / max(1, len(places) - 1)


def _number(value: object, above: float = -math.inf) -> float:
    """Return a number above a bound; NaN of anything else, as of a row that a file includes."""
    return float(value) if isinstance(value, int | float) and value > above else math.nan


class Trials:
    """The points of a plan that a search tries, each chosen by what came of those before.

    The first share of them are the corners of the cube, where what grows along each axis is worst,
    and a Sobol sequence (I. M. Sobol, 1967). The others descend by the simplex of J. A. Nelder and
    R. Mead (1965), within bounds, as SciPy has it, from the best of those: a start is skipped that
    lies about as near to a better one as any has neighbours. It asks for values only, and compares
    them, so that steps, plateaus and points without a value are no trouble. What is left then goes
    on along the sequence.

    Some descents go on side by side, each by one trial in a round; where one ends, the next begins.
    Each is gone through again from its start in every round, and sees nothing of what others try in
    it, so that the same points are tried whatever was interrupted.
    """

    def __init__(self, points: Floats, sign: float, most: int) -> None:
        """Take (n, k) the points, between 0 and 1, and how many of them may be tried.

        The sign is 1 to find the least, -1 the largest.
        """
        from scipy.spatial import KDTree  # noqa: PLC0415 - it takes a while to load

        self._nearest = KDTree(points).query
        self._sign, self._most, self._axes = sign, min(most, len(points)), points.shape[1]
        self._spread, first = _spread(self._axes, _PROPOSALS * most), max(1, round(_SPREAD * most))
        self._starts = self._spread[:first]
        self._measured: Mapping[int, float | None] = {}
        self._tried = dict[int, None]()
        self._before = frozenset[int]()  # what was tried before this round
        self._waiting: list[tuple[Floats, float]] | None = None  # descents that have not ended

    def next(self, measured: Mapping[int, float | None]) -> list[int]:
        """Return the points to try next; none once as many were tried as may be, or all are.

        Measured is what was found at points, by place; None where it could not be.
        """
        self._measured = measured
        while not (unknown := [place for place in self._tried if place not in measured]):
            self._before = frozenset(self._tried)
            self._try_more()
            if len(self._tried) == len(self._before):
                break
        return unknown

    def _try_more(self) -> None:
        """Try what is next, all that was tried being measured; nothing if nothing is left."""
        if not self._tried:
            self._try(self._places(self._starts))
            return
        if self._waiting is None:
            self._waiting = self._descents(self._starts)
        going, rest = self._waiting[:_SIDE_BY_SIDE], self._waiting[_SIDE_BY_SIDE:]
        self._waiting = [descent for descent in going if not self._ends(*descent)] + rest
        if not self._waiting:
            self._try(self._places(self._spread))
        elif len(self._tried) == len(self._before) < self._most:
            self._try_more()

    def _places(self, wanted: Floats) -> list[int]:
        """Return the places of the points that are nearest to (n, k)."""
        places: list[int] = np.asarray(self._nearest(wanted)[1]).tolist()
        return places

    def _try(self, places: Iterable[int]) -> None:
        for place in places:
            if len(self._tried) < self._most:
                self._tried[place] = None

    def _cost(self, wanted: Floats) -> float:
        """Return what is minimised at the point nearest to (k,).

        A _PauseError says that it is tried in this round, or may not be any more.
        """
        (place,) = self._places(wanted[None])
        if place not in self._before:
            self._try([place])
            raise _PauseError
        value = self._measured[place]
        return _UNMEASURED if value is None else self._sign * value

    def _descents(self, starts: Floats) -> list[tuple[Floats, float]]:
        """Return starts and sides of simplexes: the best first, some way from all better ones."""
        apart = len(starts) ** (-1 / self._axes)
        found = list[tuple[Floats, float]]()
        for place in np.argsort([self._cost(start) for start in starts], kind="stable").tolist():
            if all(np.abs(starts[place] - better).max() > apart for better, _ in found):
                found.append((starts[place], apart / 2))
        return found

    def _ends(self, start: Floats, side: float) -> bool:
        """Return whether a descent from (k,) comes to its end, and needs no trial more."""
        try:
            self._descend(start, side)
        except _PauseError:
            return False
        return True

    def _descend(self, start: Floats, side: float) -> None:
        """Descend from (k,) until the simplex, of some side first, is small."""
        from scipy.optimize import minimize  # noqa: PLC0415 - it takes a while to load

        inwards = np.where(start < 0.5, side, -side)  # so that it is whole at a bound
        minimize(
            self._cost,
            start,
            method="Nelder-Mead",
            bounds=[(0.0, 1.0)] * self._axes,
            options={
                "initial_simplex": np.concatenate((start[None], start + np.diag(inwards))),
                "xatol": _LEAST_SIDE,
                "fatol": math.inf,
                "maxfev": _MOST_CALLS,
                "maxiter": _MOST_CALLS,
            },
        )


class _PauseError(Exception):
    """Ends a descent for this round."""


def _spread(axes: int, count: int) -> Floats:
    """Return (n, axes) at least so many points of a cube: its corners, if few, and a sequence."""
    from scipy.stats import qmc  # noqa: PLC0415 - it takes a while to load

    corners = product((0.0, 1.0), repeat=axes) if axes <= _MOST_CORNERED else ()
    sequence = qmc.Sobol(axes, rng=0).random_base2((count - 1).bit_length())
    return np.concatenate((np.array([*corners]).reshape(-1, axes), sequence))


def check_search(context: SweepContext) -> None:
    """Add the mistakes of what is searched, and where."""
    search, document = context.sweep.search, context.document
    if search is None:
        return
    place = document.value(("search", "maximise" if search.maximise else "minimise"))
    metrics, written = context.vocabulary.metrics, search.maximise or search.minimise
    if written == MARGIN_OF_MUST:
        check_asked(context, place)
    elif search.metric not in metrics:
        near = [*metrics, MARGIN_OF_MUST]
        hint = suggestion(search.metric, near) or "`contactlab list metrics` has them all"
        document.add("unknown-metric", place, f"unknown metric '{search.metric}'", hint)
    axes = context.sweep.axes
    for index, name in enumerate(search.axes):
        if name not in axes:
            place = document.value(("search", "axes", index))
            add_not_swept(context, name, place, tuple(axes))
    if not searched_axes(context.sweep):
        place = document.key(("search",))
        message = "no axis of the sweep has values to search among"
        hint = "give one as {linspace: [first, last, 101]} or {uniform: [low, high]}"
        document.add("search-nothing", place, message, hint)


def check_choices(context: SweepContext) -> None:
    """Add a mistake if more than one key says which runs to make."""
    sweep = context.sweep
    given = [name for name in CHOICES if getattr(sweep, name) is not None]
    if len(given) > 1:
        place = context.document.key((given[1],))
        message = f"`{given[0]}` and `{given[1]}` both choose which runs to make"
        context.document.add("two-choices", place, message, "leave one of them out")


CHOICES: Sequence[str] = ("refine", "limit", "until", "search")
