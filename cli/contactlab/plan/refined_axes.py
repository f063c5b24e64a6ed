"""`refine` of a sweep file: its axes written out in full, and its mistakes."""

import math
from typing import cast

from contactlab.plan.names import add_not_swept
from contactlab.plan.refinement import first_stride
from contactlab.plan.rows import SweepContext, listed_values
from contactlab.plan.sides import check_limit
from contactlab.plan.yaml_document import Document
from contactlab.schema.sweep_schema import COARSE, OUTCOMES, Refine
from contactlab.schema.vocabulary import Linspace, Logspace, Range, Values

_GRID_FORMS = ("linspace", "logspace")


def write_out_refined(document: Document) -> None:
    """Give the refined axes of a file the values of the full grid, and set the start of refining.

    Unreadable entries stay unchanged; later checks report their mistakes.
    """
    refine, limit = document.mapping_at("refine"), document.mapping_at("limit")
    names, full = refine.get("axes"), refine.get("to", limit.get("to"))
    if limit:
        names = [limit.get("largest", limit.get("smallest"))]
    if not isinstance(names, list) or not isinstance(full, int) or isinstance(full, bool):
        return
    starts = list[int]()
    for name in map(str, cast("list[object]", names)):
        form = document.mapping_at("axes", name)
        for key in _GRID_FORMS:
            parts = form.get(key)
            count = cast("list[object]", parts)[-1] if isinstance(parts, list) and parts else None
            if isinstance(count, int) and 1 < count < full:
                starts.append(count)
                form[key] = [*cast("list[object]", parts)[:-1], full]
    if starts and not limit:
        refine.setdefault("start", max(starts))


def smallest_run_count(refine: Refine, runs: int) -> int:
    """Return the smallest number of runs of a grid: the corners of its first cells, and probes.

    This is the number if all outcomes are equal.
    """
    stride, axes = first_stride(refine) or 1, len(refine.axes)
    corners = ((refine.to - 1) // stride + 1) ** axes
    probes = min(math.ceil(refine.probe * corners), refine.to**axes - corners)
    return runs // refine.to**axes * (corners + probes)


def check_refine(context: SweepContext) -> None:
    """Add the mistakes of the refined axes."""
    refine, limit = context.sweep.refining, context.sweep.limit
    if refine is None:
        return
    document, key = context.document, "limit" if limit else "refine"
    for index, name in enumerate(refine.axes):
        _check_refined_axis(context, refine, name, index)
    stride = first_stride(refine)
    if stride is None and refine.start is not None:
        place = document.key_place((key, "to"))
        message = f"halving cells of {refine.start} values leads past {refine.to}"
        near = refine.start - 1
        while near + 1 < refine.to:
            near *= 2
        hint = f"write to: {near + 1}, or {near // 2 + 1}"
        document.add_mistake("off-grid", place, message, hint)
    if limit and stride == 1 and refine.to > COARSE:
        near = 2 ** (refine.to - 1).bit_length()
        message = f"no halving of coarser grids leads to {refine.to} values"
        document.add_mistake(
            "off-grid",
            document.key_place((key, "to")),
            message,
            f"write to: {near + 1}, or {near // 2 + 1}",
        )
    if context.sweep.exclude:
        place = document.key_place(("exclude",))
        message = "`exclude` would leave holes in the grid that is refined"
        document.add_mistake(
            "refine-exclude", place, message, f"leave it out, or sweep without `{key}`"
        )
    check_limit(context, refine.where, (key, "where"), OUTCOMES[1:] if limit else OUTCOMES)


def _check_refined_axis(context: SweepContext, refine: Refine, name: str, index: int) -> None:
    document, limit = context.document, context.sweep.limit
    path = ("refine", "axes", index)
    if limit:
        path = ("limit", "largest" if limit.largest else "smallest")
    place = document.value_place(path)
    axes = context.sweep.axes
    if name in refine.axes[:index]:
        document.add_mistake("axis-twice", place, f"'{name}' is given twice")
    elif any(name in block for block in context.sweep.zip):
        message = f"'{name}' advances with other axes, so it cannot be refined"
        document.add_mistake("refine-zip", place, message, "move it to `axes`")
    elif name not in axes:
        add_not_swept(context, name, place, tuple(axes))
    elif not isinstance(axis := axes[name], Linspace | Logspace | Range | Values | tuple):
        message = f"'{name}' is drawn, so no grid of it can be refined"
        hint = f"write {name}: {{linspace: [first, last, {COARSE}]}}"
        document.add_mistake("refine-drawn", document.key_place(("axes", name)), message, hint)
    elif (count := len(listed_values(axis))) != refine.to:
        message = f"'{name}' has {count} values, but `to` says {refine.to}"
        hint = f"write {{linspace: [first, last, {COARSE}]}}, which grows to {refine.to}"
        document.add_mistake("off-grid", document.key_place(("axes", name)), message, hint)
