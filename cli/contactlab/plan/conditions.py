"""Conditions of `exclude` and `expect`, with canonical values."""

from collections.abc import Collection

from contactlab.expression import Expression, ExpressionError
from contactlab.plan.diagnostics import Place
from contactlab.plan.grid import Match
from contactlab.plan.names import SweepContext, add_not_swept
from contactlab.plan.yaml_document import KeyPath
from contactlab.schema import Condition


def read_condition(
    context: SweepContext, condition: Condition, path: KeyPath, known: Collection[str]
) -> Match:
    """Return a condition with canonical values; add its mistakes to the document.

    Args:
        context: the file and its names.
        condition: as written.
        path: where it stands.
        known: the axes that it may name.
    """
    document = context.document
    settings: list[tuple[str, object]] = []
    for name, raw in condition.settings.items():
        if name not in known:
            add_not_swept(context, name, document.key((*path, name)), known)
            continue
        settings.append((name, context.canonical(name, raw, document.value((*path, name)))))
    expression, inside, splits = None, None, ()
    if condition.where is not None:
        inside = _inside(context, (*path, "where"), condition.where)
        specs = [spec for spec in map(context.find, known) if spec is not None]
        parts = {part for spec in specs for part in spec.parts}
        expression = _read_expression(context, condition.where, (*path, "where"), {*known, *parts})
        splits = tuple((spec.name, spec.split) for spec in specs if spec.split)
    return Match(tuple(settings), expression, document.value(path), inside, splits)


def _read_expression(
    context: SweepContext, text: str, path: KeyPath, known: Collection[str]
) -> Expression | None:
    inside = _inside(context, path, text)
    whole = context.document.value(path)
    try:
        expression = Expression(text)
    except ExpressionError as error:
        place = inside.part(error.start, error.width) if inside else whole
        context.document.add("bad-expression", place, str(error))
        return None
    for name, start in expression.places.items():
        if name not in known:
            place = inside.part(start, len(name)) if inside else whole
            add_not_swept(context, name, place, known)
    return expression


def _inside(context: SweepContext, path: KeyPath, text: str) -> Place | None:
    """Return where the first character of a text is; None if the text is written with escapes."""
    place = context.document.value(path)
    for skip in (0, 1):
        start = place.column - 1 + skip
        if place.text[start : start + len(text)] == text:
            return place.part(skip, 1)
    return None
