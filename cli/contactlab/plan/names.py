"""The names and values of a sweep file, checked against what its scene offers."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import cast

from contactlab.errors import did_you_mean
from contactlab.plan.diagnostics import Place
from contactlab.plan.validation import Draft
from contactlab.plan.yaml_document import Document, KeyPath
from contactlab.schema import ERRORS, AxisSpec, Sweep, Vocabulary

UNREADABLE = object()


@dataclass(frozen=True)
class SweepContext:
    """A draft, and the names that its scene offers."""

    draft: Draft
    vocabulary: Vocabulary

    @property
    def document(self) -> Document:
        """The file as written."""
        return self.draft.document

    @property
    def sweep(self) -> Sweep:
        """What of it could be read."""
        return self.draft.sweep

    def find(self, name: str) -> AxisSpec | None:
        """Return the axis of this name, or None."""
        return self.vocabulary.axes.find(name)

    def canonical(self, name: str, value: object, place: Place) -> object:
        """Return the canonical form of an axis value; or UNREADABLE, and add the mistake."""
        spec = self.find(name)
        if spec is None:
            return UNREADABLE
        if isinstance(value, float) and not math.isfinite(value):
            self.document.add("not-finite", place, f"'{name}' must be finite")
            return UNREADABLE
        try:
            return spec.parse(value)
        except ValueError as error:
            close = did_you_mean(value, spec.choices) if isinstance(value, str) else ""
            message = f"{_shown(value)} is not a value of '{name}'"
            self.document.add("bad-value", place, message, f"{error}{close}")
            return UNREADABLE

    def swept(self) -> list[tuple[str, KeyPath]]:
        """Return the axes that the file names, readable or not, with where it names them."""
        return list(_swept(self.document))


def check_names(context: SweepContext) -> None:
    """Find unknown names, axes given twice and axes that set the same thing."""
    document, vocabulary = context.document, context.vocabulary
    for name, path in context.swept():
        check_axis(context, name, document.key(path))
    for name in _switched(document):
        check_axis(context, name, document.key(("effects", name)), "effect")
    _check_twice(context)
    _check_tolerances(context)
    _check_known(document, "threshold", vocabulary.thresholds, ("thresholds",))
    for index, expectation in enumerate(context.sweep.expect):
        path = context.draft.path("expect", index)
        _check_known(document, "metric", vocabulary.metrics, (*path, "metrics"))
        for label in expectation.label or ():
            if label not in vocabulary.labels:
                place = _label_place(document, (*path, "label"), label)
                _add_unknown(document, "label", label, place, vocabulary.labels)


def check_axis(context: SweepContext, name: str, place: Place, kind: str = "axis") -> None:
    """Add a mistake if the scene does not have this axis."""
    if context.find(name) is None:
        known = list(context.vocabulary.axes.names)
        if not place.source.numbered:
            known += list(Sweep.model_fields)
        if name == "seed":
            known = ["seeds"]
        _add_unknown(context.document, kind, name, place, known)


def check_conflicts(context: SweepContext, places: dict[str, Place]) -> None:
    """Add a mistake for every two axes of one row that set the same thing."""
    for first, second in combinations(places, 2):
        if _conflict(context.find(first), context.find(second)):
            message = f"'{second}' sets the same thing as '{first}'"
            hint = f"leave one out; '{first}' is {places[first].spot}"
            context.document.add("axis-conflict", places[second], message, hint)


def _conflict(first: AxisSpec | None, second: AxisSpec | None) -> bool:
    if first is None or second is None:
        return False
    return second.name in first.conflicts or first.name in second.conflicts


def _check_twice(context: SweepContext) -> None:
    document = context.document
    places: dict[str, Place] = {}
    paths = [(name, ("effects", name)) for name in _switched(document)]
    for name, path in [*context.swept(), *paths]:
        place = document.key(path)
        if name in places:
            hint = f"first given {places[name].spot}"
            document.add("axis-twice", place, f"'{name}' is given twice", hint)
        else:
            places[name] = place
    check_conflicts(context, places)


def _switched(document: Document) -> list[str]:
    """Return the effects that the file switches by name; `base` is for the others."""
    return [name for name in document.mapping("effects") if name != "base"]


def _swept(document: Document) -> Iterator[tuple[str, KeyPath]]:
    for name in document.mapping("axes"):
        yield name, ("axes", name)
    blocks = document.at(("zip",))
    for index in range(len(cast("list[object]", blocks)) if isinstance(blocks, list) else 0):
        for name in document.mapping("zip", index):
            yield name, ("zip", index, name)


def _check_tolerances(context: SweepContext) -> None:
    document, known = context.document, (*context.vocabulary.metrics, *ERRORS)
    _check_known(document, "metric", known, ("tolerances",))
    if context.sweep.accuracy is not None:
        return
    for name in document.mapping("tolerances"):
        if name in ERRORS:
            message = f"'{name}' is measured only where a sweep asks for it"
            place = document.key(("tolerances", name))
            document.add("not-asked", place, message, "add accuracy: {}")


def _check_known(document: Document, kind: str, known: object, path: KeyPath) -> None:
    names = list(cast("list[str]", known))
    for name in document.mapping(*path):
        if name not in names:
            _add_unknown(document, kind, name, document.key((*path, name)), names)


def _add_unknown(document: Document, kind: str, name: str, place: Place, known: object) -> None:
    names = list(cast("list[str]", known))
    few = f"known: {', '.join(names)}" if 0 < len(names) <= 12 else ""
    hint = did_you_mean(name, names).removeprefix("; ") or few
    document.add(f"unknown-{kind}", place, f"unknown {kind} '{name}'", hint)


def _label_place(document: Document, path: KeyPath, label: str) -> Place:
    data = document.at(path)
    if isinstance(data, list):
        return document.value((*path, cast("list[object]", data).index(label)))
    return document.value(path)


def _shown(value: object) -> str:
    return repr(list(cast("tuple[object]", value))) if isinstance(value, tuple) else repr(value)
