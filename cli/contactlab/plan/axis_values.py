"""The values of axes, and the factors of the product that they, zip blocks and samples make.

Values of `linspace` and `range` are computed exactly and rounded once: the third step of 0.1 is
0.3. Others are rounded to 12 digits: they then do not depend on the machine's math library, and
runs of two machines pair up.
"""

import math
from collections.abc import Callable, Sequence
from decimal import Decimal
from fractions import Fraction
from typing import cast

import numpy as np
from numpy.typing import NDArray

from contactlab.plan.grid import Block
from contactlab.plan.names import UNREADABLE, SweepContext
from contactlab.plan.yaml_document import KeyPath
from contactlab.schema import (
    FORMS,
    Axis,
    AxisSpec,
    Linspace,
    Logspace,
    Loguniform,
    Range,
    Sample,
    Uniform,
    Values,
    is_sampled,
)

_DIGITS = 12


def listed_values(axis: Axis) -> list[object]:
    """Return the values of an axis that is not sampled, in order, not yet canonical."""
    match axis:
        case Linspace(linspace=(first, last, count)):
            return list(_linspace(first, last, count))
        case Logspace(logspace=(first, last, count)):
            return list(_logspace(first, last, count))
        case Range(range=(first, last, step)):
            return list(_range(first, last, step))
        case Values(values=values):
            return list(values)
        case tuple():
            return list(axis)
        case _:
            raise TypeError(f"{type(axis).__name__} is sampled")


def sample_points(sample: Sample, dimensions: int) -> NDArray[np.float64]:
    """Return (n, dimensions) points in the unit cube [0, 1)."""
    # Importing it takes half a second; sweeps without samples do not wait for it.
    from scipy.stats import qmc  # noqa: PLC0415

    if sample.method == "random":
        return np.random.default_rng(sample.seed).random((sample.n, dimensions))
    if sample.method == "lhs":
        return qmc.LatinHypercube(dimensions, rng=sample.seed).random(sample.n)
    # The first n points of a Sobol sequence are the same however many are drawn.
    power = math.ceil(math.log2(sample.n)) if sample.n > 1 else 0
    return qmc.Sobol(dimensions, rng=sample.seed).random_base2(power)[: sample.n]


def sampled_values(
    axis: Uniform | Loguniform, spec: AxisSpec, units: NDArray[np.float64]
) -> list[object]:
    """Return values for points in [0, 1); whole numbers where the axis takes no others."""
    low, high = axis.uniform if isinstance(axis, Uniform) else axis.loguniform
    whole = _takes_whole_only(spec, low, high)
    stop = high + 1 if whole else high
    if isinstance(axis, Uniform):
        scaled = low + units * (stop - low)
    else:
        scaled = np.exp(math.log(low) + units * (math.log(stop) - math.log(low)))
    return [_within(value, low, high, whole) for value in scaled.tolist()]


def _within(value: float, low: float, high: float, whole: bool) -> object:
    rounded = math.floor(value) if whole else _rounded(value)
    return min(max(rounded, low), high)


def _takes_whole_only(spec: AxisSpec, low: float, high: float) -> bool:
    """Return whether an axis accepts its whole bounds, but no number between two of them."""
    if not (low.is_integer() and high.is_integer() and _accepts(spec.parse, low)):
        return False
    return not _accepts(spec.parse, low + 0.5)


def _accepts(parse: Callable[[object], object], value: float) -> bool:
    try:
        parse(value)
    except ValueError:
        return False
    return True


def _linspace(first: float, last: float, count: int) -> list[float]:
    start, end = _exact(first), _exact(last)
    return [_plain(start + (end - start) * Fraction(k, count - 1)) for k in range(count)]


def _logspace(first: float, last: float, count: int) -> list[float]:
    steps, low, high = count - 1, math.log(first), math.log(last)
    inner = [_rounded(math.exp(low + (high - low) * k / steps)) for k in range(1, steps)]
    return [_plain(_exact(value)) for value in (first, *inner, last)]


def _range(first: float, last: float, step: float) -> list[float]:
    start, end, stride = _exact(first), _exact(last), _exact(step)
    return [_plain(start + k * stride) for k in range((end - start) // stride + 1)]


def _exact(value: float) -> Fraction:
    """Return the decimal number that a value was written as."""
    return Fraction(Decimal(repr(value)))


def _plain(value: Fraction) -> float:
    return value.numerator if value.denominator == 1 else float(value)


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


AxisColumn = tuple[object, ...]


def read_blocks(context: SweepContext) -> tuple[Block, ...] | None:
    """Return the blocks of the product, or None where the file only lists rows to include."""
    sweep = context.sweep
    blocks = [
        Block((name,), tuple((value,) for value in _column(context, ("axes", name), name, axis)))
        for name, axis in sweep.axes.items()
        if not is_sampled(axis)
    ]
    for index, columns in enumerate(sweep.zip):
        blocks.append(_zipped(context, context.draft.path("zip", index), columns))
    blocks.extend(_sampled(context))
    return tuple(blocks) if blocks or not sweep.include else None


def _column(context: SweepContext, path: KeyPath, name: str, axis: Axis) -> AxisColumn:
    """Return the canonical values of a listed axis; each mistake is at its own value."""
    data = context.document.at(path)
    form = next((key for key in FORMS if isinstance(data, dict) and key in data), None)
    below = (*path, form) if form else path
    written = form in {None, "values"}
    column: list[object] = []
    for index, value in enumerate(listed_values(axis)):
        place = context.document.value((*below, index) if written else below)
        canonical = context.canonical(name, value, place)
        if canonical is UNREADABLE and not written:
            break
        column.append(canonical)
    return tuple(column)


def _zipped(context: SweepContext, path: KeyPath, axes: dict[str, Axis]) -> Block:
    columns: dict[str, AxisColumn] = {}
    for name, axis in axes.items():
        if is_sampled(axis):
            message = f"'{name}' is sampled, so it cannot advance with others"
            place = context.document.key((*path, name))
            context.document.add("sampled-in-zip", place, message, "move it to `axes`")
        else:
            columns[name] = _column(context, (*path, name), name, axis)
    first = next(iter(columns), "")
    for name, axis in axes.items():
        expected = len(listed_values(axes[first])) if first else 0
        if name in columns and len(listed_values(axis)) != expected:
            message = (
                f"'{name}' has {len(listed_values(axis))} values, but '{first}' has {expected}"
            )
            context.document.add("zip-length", (*path, name), message)
    return Block(tuple(columns), tuple(zip(*columns.values(), strict=False)))


def _sampled(context: SweepContext) -> list[Block]:
    document, sample = context.document, context.sweep.sample
    axes = {
        name: cast("Uniform | Loguniform", axis)
        for name, axis in context.sweep.axes.items()
        if is_sampled(axis)
    }
    if axes and "sample" not in document.mapping():
        name = next(iter(axes))
        message = f"'{name}' is sampled, but there is no `sample`"
        hint = "add sample: {method: sobol, n: 64}"
        document.add("sample-missing", document.key(("axes", name)), message, hint)
    if not any(_looks_sampled(context, name) for name in document.mapping("axes")) and sample:
        hint = "give an axis as {uniform: [low, high]} or {loguniform: [low, high]}"
        document.add("sample-unused", document.key(("sample",)), "no axis is sampled", hint)
    return [_drawn(context, axes, sample)] if axes and sample else []


def _looks_sampled(context: SweepContext, name: str) -> bool:
    form = context.document.mapping("axes", name)
    return "uniform" in form or "loguniform" in form


def _drawn(context: SweepContext, axes: dict[str, Uniform | Loguniform], sample: Sample) -> Block:
    cube = sample_points(sample, len(axes))
    columns: list[Sequence[object]] = []
    for index, (name, axis) in enumerate(axes.items()):
        spec = context.find(name)
        path = ("axes", name, "uniform" if isinstance(axis, Uniform) else "loguniform")
        if spec is None or not _bounds_fit(context, path, axis):
            continue
        values = sampled_values(axis, spec, cube[:, index])
        columns.append(_canonical_column(context, path, values))
    return Block(tuple(axes), tuple(zip(*columns, strict=False)))


def _bounds_fit(context: SweepContext, path: KeyPath, axis: Uniform | Loguniform) -> bool:
    bounds = axis.uniform if isinstance(axis, Uniform) else axis.loguniform
    places = [context.document.value((*path, index)) for index in range(2)]
    parsed = [
        context.canonical(str(path[1]), bound, place)
        for bound, place in zip(bounds, places, strict=True)
    ]
    return UNREADABLE not in parsed


def _canonical_column(context: SweepContext, path: KeyPath, values: list[object]) -> list[object]:
    column: list[object] = []
    for value in values:
        column.append(context.canonical(str(path[1]), value, context.document.value(path)))
        if column[-1] is UNREADABLE:
            break
    return column
