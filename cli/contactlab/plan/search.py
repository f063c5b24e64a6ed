"""`search` of a sweep file: the worst of a metric, sought among the points of a plan."""

import math
from collections.abc import Callable, Mapping, Sequence

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import suggestion
from contactlab.plan.names import add_not_swept
from contactlab.plan.rows import SweepContext, listed_values
from contactlab.schema.sweep_schema import Sweep
from contactlab.schema.vocabulary import (
    Axis,
    Linspace,
    Logspace,
    Loguniform,
    Range,
    Sampled,
    Uniform,
)

# Cells of the unit cube shrink to this before the search gives up.
_LEAST_SIDE = 1e-9
# Points that it may propose for each trial: several may be nearest to one of the plan.
_PROPOSALS = 100
_UNMEASURED = 1e12
# Less than anything that is measured: with it the optimiser is done.
_END = -1e30


def searched_axes(sweep: Sweep) -> tuple[str, ...]:
    """Return the axes that are searched: those named, or all that are drawn, or else all grids."""
    assert sweep.search is not None
    if sweep.search.axes:
        return sweep.search.axes
    drawn = [name for name, axis in sweep.axes.items() if isinstance(axis, Sampled)]
    grids = (name for name, axis in sweep.axes.items() if isinstance(axis, _GRIDS))
    return tuple(drawn or grids)


_GRIDS = Linspace | Logspace | Range


def coordinates(sweep: Sweep, name: str) -> Callable[[object], float]:
    """Return what places the values of an axis between 0 and 1."""
    axis = sweep.axes[name]
    match axis:
        case Uniform(uniform=(low, high)):
            return lambda value: (_number(value) - low) / (high - low)
        case Loguniform(loguniform=(low, high)):
            return lambda value: math.log(_number(value) / low) / math.log(high / low)
        case _:
            return _steps(axis)


def _steps(axis: Axis) -> Callable[[object], float]:
    places: dict[object, int] = {value: step for step, value in enumerate(listed_values(axis))}
    return lambda value: places.get(value, math.nan) / max(1, len(places) - 1)


def _number(value: object) -> float:
    assert isinstance(value, int | float)
    return float(value)


def next_trials(
    points: Floats, measured: Mapping[int, float | None], sign: float, most: int
) -> list[int]:
    """Return the points to try next; none once as many were tried as may be.

    The optimiser is DIRECT, locally biased (D. R. Jones et al., 1993; J. M. Gablonsky and
    C. T. Kelley, 2001), as SciPy has it. It divides the cube again from the start, and takes what
    is known at the points next to its own, so that the same are tried whatever was interrupted.

    Args:
        points: (n, k) of a plan, between 0 and 1.
        measured: what was found at points, by place; None where it could not be measured.
        sign: 1 to find the least, -1 the largest.
        most: number of points that may be tried.
    """
    # Both take a while to load.
    from scipy.optimize import direct  # noqa: PLC0415
    from scipy.spatial import KDTree  # noqa: PLC0415

    tree, tried, waiting = KDTree(points), dict[int, float](), list[int]()
    ended = False

    def cost(proposed: Floats) -> float:
        nonlocal ended
        place = int(tree.query(proposed)[1]) if not ended else -1
        ended = ended or (place not in tried and len(tried) == most)
        if ended:
            return _END
        if place not in tried:
            if place not in measured:
                waiting.append(place)
            value = measured.get(place)
            tried[place] = _UNMEASURED if value is None else sign * value
        return tried[place]

    def end(_: Floats) -> None:
        nonlocal ended
        ended = bool(waiting)

    direct(
        cost,
        [(0.0, 1.0)] * points.shape[1],
        locally_biased=True,
        callback=end,
        # It is the only way to stop that all releases have: not all let an error through.
        f_min=_END,
        maxfun=_PROPOSALS * most,
        maxiter=_PROPOSALS * most,
        vol_tol=0.0,
        len_tol=_LEAST_SIDE,
    )
    return waiting


def check_search(context: SweepContext) -> None:
    """Add the mistakes of what is searched, and where."""
    search, document = context.sweep.search, context.document
    if search is None:
        return
    key, metric = (
        ("maximise", search.maximise) if search.maximise else ("minimise", search.minimise)
    )
    metrics = context.vocabulary.metrics
    if metric not in metrics:
        hint = suggestion(str(metric), metrics) or "`contactlab list metrics` has them all"
        place = document.value(("search", key))
        document.add("unknown-metric", place, f"unknown metric '{metric}'", hint)
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


CHOICES: Sequence[str] = ("refine", "until", "search")
