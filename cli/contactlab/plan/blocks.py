"""The factors of the product: axes, zip blocks and sample points, with canonical values."""

from collections.abc import Sequence
from typing import cast

from contactlab.plan.document import KeyPath
from contactlab.plan.names import UNREADABLE, Context
from contactlab.plan.rows import Block
from contactlab.plan.values import drawn, listed, points
from contactlab.schema import FORMS, Axis, Loguniform, Sample, Uniform, is_sampled

Column = tuple[object, ...]


def read_blocks(context: Context) -> tuple[Block, ...] | None:
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


def _column(context: Context, path: KeyPath, name: str, axis: Axis) -> Column:
    """Return the canonical values of a listed axis, each mistake noted at its own value."""
    data = context.document.at(path)
    form = next((key for key in FORMS if isinstance(data, dict) and key in data), None)
    below = (*path, form) if form else path
    written = form in {None, "values"}
    column: list[object] = []
    for index, value in enumerate(listed(axis)):
        place = context.document.value((*below, index) if written else below)
        canonical = context.canonical(name, value, place)
        if canonical is UNREADABLE and not written:
            break
        column.append(canonical)
    return tuple(column)


def _zipped(context: Context, path: KeyPath, axes: dict[str, Axis]) -> Block:
    columns: dict[str, Column] = {}
    for name, axis in axes.items():
        if is_sampled(axis):
            message = f"'{name}' is sampled, so it cannot advance with others"
            place = context.document.key((*path, name))
            context.document.add("sampled-in-zip", place, message, "move it to `axes`")
        else:
            columns[name] = _column(context, (*path, name), name, axis)
    first = next(iter(columns), "")
    for name, axis in axes.items():
        expected = len(listed(axes[first])) if first else 0
        if name in columns and len(listed(axis)) != expected:
            message = f"'{name}' has {len(listed(axis))} values, but '{first}' has {expected}"
            context.document.add("zip-length", (*path, name), message)
    return Block(tuple(columns), tuple(zip(*columns.values(), strict=False)))


def _sampled(context: Context) -> list[Block]:
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


def _looks_sampled(context: Context, name: str) -> bool:
    form = context.document.mapping("axes", name)
    return "uniform" in form or "loguniform" in form


def _drawn(context: Context, axes: dict[str, Uniform | Loguniform], sample: Sample) -> Block:
    cube = points(sample, len(axes))
    columns: list[Sequence[object]] = []
    for index, (name, axis) in enumerate(axes.items()):
        spec = context.find(name)
        path = ("axes", name, "uniform" if isinstance(axis, Uniform) else "loguniform")
        if spec is None or not _bounds_fit(context, path, axis):
            continue
        values = drawn(axis, spec, cube[:, index])
        columns.append(_canonical(context, path, values))
    return Block(tuple(axes), tuple(zip(*columns, strict=False)))


def _bounds_fit(context: Context, path: KeyPath, axis: Uniform | Loguniform) -> bool:
    bounds = axis.uniform if isinstance(axis, Uniform) else axis.loguniform
    places = [context.document.value((*path, index)) for index in range(2)]
    parsed = [
        context.canonical(str(path[1]), bound, place)
        for bound, place in zip(bounds, places, strict=True)
    ]
    return UNREADABLE not in parsed


def _canonical(context: Context, path: KeyPath, values: list[object]) -> list[object]:
    column: list[object] = []
    for value in values:
        column.append(context.canonical(str(path[1]), value, context.document.value(path)))
        if column[-1] is UNREADABLE:
            break
    return column
