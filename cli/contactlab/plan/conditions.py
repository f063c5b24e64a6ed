"""Conditions of `exclude` and `expect`, with canonical values."""

from collections.abc import Collection

from contactlab.expression import Expression, ExpressionError
from contactlab.plan.diagnostics import Place
from contactlab.plan.grid import Match
from contactlab.plan.names import SweepContext, add_not_swept
from contactlab.plan.yaml_document import KeyPath
from contactlab.schema.sweep_schema import Condition


def read_condition(
    context: SweepContext, condition: Condition, path: KeyPath, known: Collection[str]
) -> Match:
    """Return a condition on known axes with canonical values; add its mistakes to the document."""
    document = context.document
    settings: list[tuple[str, object]] = []
    for name, raw in condition.settings.items():
        if name in known:
            value = context.canonical(name, raw, document.value((*path, name)))
            settings.append((name, value))
        else:
            add_not_swept(context, name, document.key((*path, name)), known)
    if condition.where is None:
        return Match(tuple(settings), None, document.value(path))
    specs = [spec for name in known if (spec := context.find(name))]
    names = {*known, *(part for spec in specs for part in spec.parts)}
    where = document.value((*path, "where"))
    inside = _first_character(where, condition.where)
    expression = _read_expression(context, condition.where, names, inside, where)
    splits = tuple((spec.name, spec.split) for spec in specs if spec.split)
    return Match(tuple(settings), expression, document.value(path), inside, splits)


def _read_expression(
    context: SweepContext, text: str, names: Collection[str], inside: Place | None, where: Place
) -> Expression | None:
    try:
        expression = Expression(text)
    except ExpressionError as error:
        place = inside.part(error.start, error.width) if inside else where
        context.document.add("bad-expression", place, str(error))
        return None
    for name, start in expression.places.items():
        if name not in names:
            place = inside.part(start, len(name)) if inside else where
            add_not_swept(context, name, place, names)
    return expression


def _first_character(place: Place, text: str) -> Place | None:
    """Return where a text at a place begins, quoted or not; None if it is written with escapes."""
    for skip in (0, 1):
        start = place.column - 1 + skip
        if place.text[start : start + len(text)] == text:
            return place.part(skip, 1)
    return None
