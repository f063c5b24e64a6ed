"""`search` of a sweep file: finds the worst value of a metric among the points of a plan."""

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


def searched_axes(sweep: Sweep) -> tuple[str, ...]:
    """Return the searched axes: those named, or all that are drawn, or all grids."""
    assert sweep.search is not None
    if sweep.search.axes:
        return sweep.search.axes
    sampled_axes = [name for name, axis in sweep.axes.items() if isinstance(axis, Sampled)]
    grids = (name for name, axis in sweep.axes.items() if isinstance(axis, _GRID_KINDS))
    return tuple(sampled_axes or grids)


_GRID_KINDS = Linspace | Logspace | Range
_SEARCHED_FORMS = ("linspace", "logspace", "range", "uniform", "loguniform")


def write_out_searched(document: Document) -> None:
    """Name the searched axes of a file that names none, before values in units are listed."""
    search = document.mapping_at("search")
    if not search or search.get("axes"):
        return
    forms = {
        name: next(
            (form for form in _SEARCHED_FORMS if form in document.mapping_at("axes", name)), ""
        )
        for name in document.mapping_at("axes")
    }
    sampled_axes = [name for name, form in forms.items() if form.endswith("uniform")]
    if names := sampled_axes or [name for name, form in forms.items() if form]:
        search["axes"] = names


def axis_coordinates(axis: Axis, values: Sequence[object]) -> Callable[[object], float]:
    """Return a function that maps values of an axis to 0 to 1; NaN for values off the axis."""
    match axis:
        case Uniform(uniform=(low, high)):
            return lambda value: (_number_above(value) - low) / (high - low)
        case Loguniform(loguniform=(low, high)):
            return lambda value: (
                math.log(_number_above(value, above=0) / low) / math.log(high / low)
            )
        case _:
            places: dict[object, int] = {value: step for step, value in enumerate(values)}
            return lambda value: places.get(value, math.nan) / max(1, len(places) - 1)


def _number_above(value: object, above: float = -math.inf) -> float:
    # Other values, such as those of a row that a file includes, are NaN.
    return float(value) if isinstance(value, int | float) and value > above else math.nan


class Trials:
    """The points of a plan that a search tries, each chosen by the results of those before.

    The first share of them are the corners of the cube, where a metric that grows along each axis
    is worst, and a Sobol sequence (I. M. Sobol, 1967). The others descend by the simplex of J. A.
    Nelder and R. Mead (1965), within bounds, as SciPy has it, from the best of those. A start is
    skipped if it lies about as near to a better one as any has neighbours. The simplex needs values
    only, and compares them, so that steps, plateaus and points without a value cause no problems.
    The remaining trials then continue along the sequence.

    Some descents advance in parallel, each by one trial in a round; where one ends, the next
    begins. Each is repeated from its start in every round, and sees no trials of others in that
    round, so that the same points are tried after any interruption.
    """

    def __init__(self, points: Floats, sign: float, most: int) -> None:
        """Take (n, k) the points, between 0 and 1, and the number of points that may be tried.

        The sign is 1 to find the smallest value, -1 to find the largest.
        """
        from scipy.spatial import KDTree  # noqa: PLC0415 - it takes a while to load

        self._nearest = KDTree(points).query
        self._sign, self._most, self._axes = sign, min(most, len(points)), points.shape[1]
        # Share of the trials that are spread over the cube; the others continue from the best.
        spread_share = 0.4
        # Proposed points for each trial: several may be nearest to the same point of the plan.
        proposals_per_trial = 4
        self._spread_points, first = (
            _spread_points(self._axes, proposals_per_trial * most),
            max(1, round(spread_share * most)),
        )
        self._starts = self._spread_points[:first]
        self._measured: Mapping[int, float | None] = {}
        self._tried = dict[int, None]()
        self._before = frozenset[int]()  # points tried before this round
        self._waiting: list[tuple[Floats, float]] | None = None  # descents that have not ended

    def next_points(self, results: Mapping[int, float | None]) -> list[int]:
        """Return the points to try next; none once the allowed number or all are tried.

        `results` are the metrics of points by place; None if a point could not be measured.
        """
        self._measured = results
        while not (unknown := [place for place in self._tried if place not in results]):
            self._before = frozenset(self._tried)
            self._add_next_trials()
            if len(self._tried) == len(self._before):
                break
        return unknown

    def _add_next_trials(self) -> None:
        """Try the next points after all earlier trials are measured; none if none are left."""
        if not self._tried:
            self._add_trials(self._nearest_places(self._starts))
            return
        if self._waiting is None:
            self._waiting = self._sorted_descents(self._starts)
        # Descents that advance at a time, so that this number of workers is busy.
        parallel_descents = 2
        going, rest = self._waiting[:parallel_descents], self._waiting[parallel_descents:]
        self._waiting = [descent for descent in going if not self._is_finished(*descent)] + rest
        if not self._waiting:
            self._add_trials(self._nearest_places(self._spread_points))
        elif len(self._tried) == len(self._before) < self._most:
            self._add_next_trials()

    def _nearest_places(self, points: Floats) -> list[int]:
        places: list[int] = np.asarray(self._nearest(points)[1]).tolist()
        return places

    def _add_trials(self, places: Iterable[int]) -> None:
        for place in places:
            if len(self._tried) < self._most:
                self._tried[place] = None

    def _trial_cost(self, point: Floats) -> float:
        """Return the minimised value at the point nearest to (k,).

        A _PauseError says that the point is tried in this round, or that no more trials are
        allowed.
        """
        (place,) = self._nearest_places(point[None])
        if place not in self._before:
            self._add_trials([place])
            raise _PauseError
        value = self._measured[place]
        unmeasured_cost = 1e12
        return unmeasured_cost if value is None else self._sign * value

    def _sorted_descents(self, starts: Floats) -> list[tuple[Floats, float]]:
        """Return starts and sides of simplexes: the best first, at a distance from better ones."""
        apart = len(starts) ** (-1 / self._axes)
        descents = list[tuple[Floats, float]]()
        for place in np.argsort(
            [self._trial_cost(start) for start in starts], kind="stable"
        ).tolist():
            if all(np.abs(starts[place] - better).max() > apart for better, _ in descents):
                descents.append((starts[place], apart / 2))
        return descents

    def _is_finished(self, start: Floats, side: float) -> bool:
        from scipy.optimize import minimize  # noqa: PLC0415 - it takes a while to load

        inwards = np.where(start < 0.5, side, -side)  # keeps the simplex whole at a bound
        try:
            minimize(
                self._trial_cost,
                start,
                method="Nelder-Mead",
                bounds=[(0.0, 1.0)] * self._axes,
                options={
                    "initial_simplex": np.concatenate((start[None], start + np.diag(inwards))),
                    # The simplex is then small; most calls before use points already tried.
                    "xatol": 1e-4,
                    "fatol": math.inf,
                    "maxfev": 1000,
                    "maxiter": 1000,
                },
            )
        except _PauseError:
            return False
        return True


class _PauseError(Exception):
    """Ends a descent for this round."""


def _spread_points(axes: int, count: int) -> Floats:
    from scipy.stats import qmc  # noqa: PLC0415 - it takes a while to load

    # With at most this number of axes, the corners of the cube, 16 at most, are tried first.
    most_corner_axes = 4
    corners = product((0.0, 1.0), repeat=axes) if axes <= most_corner_axes else ()
    sequence = qmc.Sobol(axes, rng=0).random_base2((count - 1).bit_length())
    return np.concatenate((np.array([*corners]).reshape(-1, axes), sequence))


def check_search(context: SweepContext) -> None:
    """Add the mistakes of the searched metric and axes."""
    search, document = context.sweep.search, context.document
    if search is None:
        return
    place = document.value_place(("search", "maximise" if search.maximise else "minimise"))
    metrics, metric = context.vocabulary.metrics, search.maximise or search.minimise
    if metric == MARGIN_OF_MUST:
        check_asked(context, place)
    elif search.metric not in metrics:
        near = [*metrics, MARGIN_OF_MUST]
        hint = suggestion(search.metric, near) or "`contactlab list metrics` has them all"
        document.add_mistake("unknown-metric", place, f"unknown metric '{search.metric}'", hint)
    axes = context.sweep.axes
    for index, name in enumerate(search.axes):
        if name not in axes:
            place = document.value_place(("search", "axes", index))
            add_not_swept(context, name, place, tuple(axes))
    if not searched_axes(context.sweep):
        place = document.key_place(("search",))
        message = "no axis of the sweep has values to search among"
        hint = "give one as {linspace: [first, last, 101]} or {uniform: [low, high]}"
        document.add_mistake("search-nothing", place, message, hint)


def check_choices(context: SweepContext) -> None:
    """Add a mistake if more than one key chooses the runs."""
    sweep = context.sweep
    choice_keys = [name for name in CHOICES if getattr(sweep, name) is not None]
    if len(choice_keys) > 1:
        place = context.document.key_place((choice_keys[1],))
        message = f"`{choice_keys[0]}` and `{choice_keys[1]}` both choose the runs of the sweep"
        context.document.add_mistake("two-choices", place, message, "leave one of them out")


CHOICES: Sequence[str] = ("refine", "limit", "until", "search")
