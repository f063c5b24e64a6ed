"""The sound part of a sweep file: what further checks can work on, so that one pass finds all."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

from pydantic import ValidationError

from contactlab.plan.document import Document, KeyPath
from contactlab.plan.mistakes import file_path, note_mistakes
from contactlab.schema import Sweep


@dataclass(frozen=True)
class Draft:
    """A sweep file without the entries that cannot be read.

    Attributes:
        document: the file as written.
        sweep: what could be read.
        kept: for every list that lost entries, where the others stood in the file.
    """

    document: Document
    sweep: Sweep
    kept: Mapping[str, Sequence[int]]

    def path(self, key: str, index: int, *below: str | int) -> KeyPath:
        """Return where an entry of one of the sweep's lists lies in the file."""
        kept = self.kept.get(key)
        return (key, kept[index] if kept else index, *below)

    @property
    def has_scene(self) -> bool:
        """Whether the file names its scene."""
        return isinstance(self.document.at(("scene",)), str)


def read_draft(document: Document) -> Draft:
    """Check a document against the model of a sweep, noting its mistakes."""
    data = document.mapping()
    try:
        return Draft(document, Sweep.model_validate(document.data), {})
    except ValidationError as error:
        note_mistakes(document, error)
        return _salvaged(document, data, error)


def _salvaged(document: Document, data: dict[str, object], error: ValidationError) -> Draft:
    kept: dict[str, list[int]] = {}
    for depth in (2, 1):
        data, lists = _pruned(data, error, depth)
        kept |= lists
        try:
            return Draft(document, Sweep.model_validate({"version": 1, "scene": "?", **data}), kept)
        except ValidationError as remaining:
            error = remaining
    return Draft(document, Sweep(version=1, scene="?"), {})


def _pruned(
    data: dict[str, object], error: ValidationError, depth: int
) -> tuple[dict[str, object], dict[str, list[int]]]:
    """Leave out the entries that hold an error: whole keys, or what lies directly in them."""
    bad = {file_path(detail["loc"])[:depth] for detail in error.errors(include_url=False)}
    pruned: dict[str, object] = {}
    kept: dict[str, list[int]] = {}
    for key, value in data.items():
        if (key,) in bad:
            continue
        pruned[key] = value
        if isinstance(value, dict):
            inner = cast("dict[str, object]", value)
            pruned[key] = {name: part for name, part in inner.items() if (key, name) not in bad}
        elif isinstance(value, list) and depth == 2:
            items = cast("list[object]", value)
            kept[key] = [index for index in range(len(items)) if (key, index) not in bad]
            pruned[key] = [items[index] for index in kept[key]]
    return pruned, kept
