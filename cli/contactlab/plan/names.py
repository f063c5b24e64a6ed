"""Checks of the names, values and conditions in a sweep file against those of its scene."""

import math
from collections.abc import Collection
from itertools import combinations
from pathlib import Path

from contactlab.errors import DriveFileError, suggestion
from contactlab.expression import Expression, ExpressionError
from contactlab.plan.diagnostics import MOST_SHOWN_MISTAKES, Place
from contactlab.plan.grid import Match
from contactlab.plan.rows import SweepContext
from contactlab.plan.yaml_document import KeyPath
from contactlab.schema.drive import PolicyDrive
from contactlab.schema.evidence import ERRORS
from contactlab.schema.sweep_schema import Condition, Sweep
from contactlab.schema.vocabulary import DROP_HEIGHT

_LIST_COMMANDS = {
    "metric": "list metrics",
    "label": "list labels",
    "threshold": "list limits",
    "axis": "list axes SCENE",
    "effect": "list axes SCENE",
}
# Axes that only some models have: the reason and the remedy for others.
_ABSENT_AXES = {
    "keyframe": ("the model has no keyframes", "leave it out: runs start at qpos0"),
    DROP_HEIGHT: (
        "no body of the model is free to drop",
        "write a joint's name: {joint: [0, 0.1]}",
    ),
}


def check_names(context: SweepContext) -> None:
    """Find unknown names, axes given twice and axes that conflict."""
    document, vocabulary = context.document, context.vocabulary
    # Axes and effects are known, given once, and without conflicts.
    # `base` is for the effects without their own entry.
    effects = [name for name in document.mapping_at("effects") if name != "base"]
    swept_names = [(name, path, "axis") for name, path in context.swept]
    swept_names += [(name, ("effects", name), "effect") for name in effects]
    places: dict[str, Place] = {}
    for name, path, kind in swept_names:
        place = document.key_place(path)
        check_axis(context, name, place, kind)
        if name in places:
            hint = f"first given {places[name].spot}"
            document.add_mistake("axis-twice", place, f"'{name}' is given twice", hint)
        else:
            places[name] = place
    check_conflicts(context, places)
    # Tolerances are of metrics that the sweep measures.
    _check_known_names(context, "metric", [*context.vocabulary.metrics, *ERRORS], ("tolerances",))
    for name in document.mapping_at("tolerances"):
        if why := context.vocabulary.lacking.get(name):
            place = document.key_place(("tolerances", name))
            document.add_mistake(
                "not-measured", place, f"'{name}' is never measured: {why}", "leave it out"
            )
        if name in ERRORS and context.sweep.accuracy is None:
            message = f"'{name}' is only measured if the sweep requests accuracy"
            place = document.key_place(("tolerances", name))
            document.add_mistake("not-asked", place, message, "add accuracy: {}")
    _check_known_names(context, "threshold", vocabulary.thresholds, ("thresholds",))
    for index, expectation in enumerate(context.sweep.expect):
        path = context.entry_path("expect", index)
        for key in ("metrics", "mean"):
            _check_known_names(context, "metric", vocabulary.metrics, (*path, key))
        for position, label in enumerate(expectation.label or ()):
            if label not in vocabulary.labels:
                place = document.value_place((*path, "label", position))
                _add_unknown_name(context, "label", label, place, vocabulary.labels)
        for position, text in enumerate(expectation.must):
            _check_requirement(context, text, (*path, "must", position))
    for index, text in enumerate(context.sweep.must):
        _check_requirement(context, text, context.entry_path("must", index))


def check_axis(context: SweepContext, name: str, place: Place, kind: str = "axis") -> None:
    """Add a mistake if the scene does not have this axis."""
    if context.find_axis(name) is None:
        keys = () if place.source.numbered else Sweep.model_fields
        offered = (*context.vocabulary.axes, *keys, *context.vocabulary.coordinates)
        offered_names = ["seeds"] if name == "seed" else [*offered]
        if name in _ABSENT_AXES:
            context.document.add_mistake(f"unknown-{kind}", place, *_ABSENT_AXES[name])
            return
        if name.endswith(".ctrl"):
            message, hint = f"unknown {kind} '{name}'", "controls belong to `drive` or a keyframe"
            context.document.add_mistake(f"unknown-{kind}", place, message, hint)
            return
        _add_unknown_name(context, kind, name, place, offered_names)


def check_conflicts(context: SweepContext, places: dict[str, Place]) -> None:
    """Add a mistake for every two axes of one row that set the same quantity."""
    specs = [(name, spec) for name in places if (spec := context.find_axis(name))]
    for (first, one), (second, other) in combinations(specs, 2):
        if other.name in one.conflicts or one.name in other.conflicts:
            message = f"'{second}' sets the same thing as '{first}'"
            hint = f"leave one out; '{first}' is {places[first].spot}"
            context.document.add_mistake("axis-conflict", places[second], message, hint)


def add_not_swept(context: SweepContext, name: str, place: Place, swept: Collection[str]) -> None:
    """Add a mistake about a name in a condition or filter that is not among the swept axes."""
    if any((spec := context.find_axis(axis)) and name in spec.choices for axis in swept):
        hint = f"quote the word: '{name}'"
    elif context.find_axis(name):
        hint = "add it to `axes`"
    else:
        hint = suggestion(name, swept) or f"swept here: {', '.join(swept) or 'nothing'}"
    context.document.add_mistake(
        "axis-not-swept", place, f"'{name}' is not an axis of this sweep", hint
    )


def check_drive(context: SweepContext) -> None:
    """Add a mistake for a drive of the sweep that cannot be used, such as a missing file."""
    document, drive, check = context.document, context.sweep.drive, context.vocabulary
    if drive and check.mistake_in_drive and (mistake := check.mistake_in_drive(drive)):
        drive_mapping = document.mapping_at("drive")
        keys = [key for key in ("policy", "file", "files") if key in drive_mapping][:1]
        if isinstance(mistake, DriveFileError) and isinstance(drive, PolicyDrive):
            files = [Path(file).expanduser().parts for file in drive.files]
            if any(mistake.file.parts[-len(file) :] == file for file in files):
                keys = ["files"]
        message = str(mistake).removeprefix("drive: ")
        hint = "relative paths start at the sweep file" * ("no file" in message)
        document.add_mistake("drive-file", ("drive", *keys), message, hint)


def _check_requirement(context: SweepContext, text: str, path: KeyPath) -> None:
    document, check = context.document, context.vocabulary.mistake_in_requirement
    # A drive has its own duration, which is known only after it is read.
    duration = context.sweep.duration or (math.inf if context.sweep.drive else None)
    if mistake := check and check(text, duration):
        # A single requirement needs no list.
        place = path[:-1] if isinstance(document.value_at(path[:-1]), str) else path
        document.add_mistake("bad-requirement", document.value_place(place), mistake)


def _check_known_names(
    context: SweepContext, kind: str, known_names: Collection[str], path: KeyPath
) -> None:
    for name in context.document.mapping_at(*path):
        if name not in known_names:
            place = context.document.key_place((*path, name))
            _add_unknown_name(context, kind, name, place, known_names)


def _add_unknown_name(
    context: SweepContext, kind: str, name: str, place: Place, known_names: Collection[str]
) -> None:
    document = context.document
    few = f"known: {', '.join(known_names)}" if 0 < len(known_names) <= 12 else ""
    # A search for a close name takes long, and further mistakes are not printed.
    is_shown = len(document.mistakes) < MOST_SHOWN_MISTAKES
    hint = (
        (is_shown and _suggest_name(context, name, known_names))
        or few
        or f"`contactlab {_LIST_COMMANDS.get(kind, 'list')}` has all"
    )
    document.add_mistake(f"unknown-{kind}", place, f"unknown {kind} '{name}'", hint)


def _suggest_name(context: SweepContext, name: str, known_names: Collection[str]) -> str:
    # Output has descriptions, and users type their first words as names.
    words = name.replace("_", " ").casefold()
    describe = context.vocabulary.describe
    meant = [one for one in known_names if describe(one).casefold().startswith(words)]
    return f"did you mean '{meant[0]}'?" if len(meant) == 1 else suggestion(name, known_names)


def read_condition(
    context: SweepContext, condition: Condition, path: KeyPath, axis_names: Collection[str]
) -> Match:
    """Return a condition on known axes with canonical values. Add its mistakes to the document."""
    document = context.document
    settings: list[tuple[str, object]] = []
    for name, raw in condition.settings.items():
        if name in axis_names:
            settings.append(
                (name, context.canonical_value(name, raw, document.value_place((*path, name))))
            )
        else:
            add_not_swept(context, name, document.key_place((*path, name)), axis_names)
    if condition.where is None:
        return Match(tuple(settings), None, document.value_place(path))
    specs = [spec for name in axis_names if (spec := context.find_axis(name))]
    names = (*axis_names, *(part for spec in specs for part in spec.parts))
    where, text = document.value_place((*path, "where")), condition.where
    # The first character: a quoted text begins one later, and one with escapes has no such place.
    begins = [skip for skip in (0, 1) if where.text[where.column - 1 + skip :].startswith(text)]
    inside = where.narrow_range(begins[0], 1) if begins else None
    expression = _read_expression(context, text, names, inside, where)
    splits = tuple((spec.name, spec.split) for spec in specs if spec.split)
    return Match(tuple(settings), expression, document.value_place(path), inside, splits)


def _read_expression(
    context: SweepContext, text: str, names: Collection[str], inside: Place | None, where: Place
) -> Expression | None:
    def part(start: int, width: int) -> Place:
        return inside.narrow_range(start, width) if inside else where

    try:
        expression = Expression(text)
    except ExpressionError as error:
        context.document.add_mistake("bad-expression", part(error.start, error.width), str(error))
        return None
    for name, start in expression.places.items():
        if name not in names:
            add_not_swept(context, name, part(start, len(name)), names)
    return expression
