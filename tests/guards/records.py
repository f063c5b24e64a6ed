"""Records of guards, and the files that keep them.

A record has two parts: `results` are numbers, hashes, labels and files that a model gives; `words`
are texts for people. In each part an item stands under its kind: `results["run"]["cone=elliptic"]`
are the facts of one run. An item `*` in a file holds the facts that all items of its kind share.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).with_name("records")
SHARED = "*"
_WIDTH = 100

Facts = dict[str, Any]
Items = dict[str, dict[str, Facts]]
"""The facts of each item of each kind."""


@dataclass(frozen=True)
class Record:
    """The results and words of a guard.

    Attributes:
        versions: of the packages that change it.
        results: the facts of items, by kind and name.
        words: texts of items, by kind and name.
    """

    versions: Mapping[str, str]
    results: Items = field(default_factory=Items)
    words: Items = field(default_factory=Items)

    def to_text(self) -> str:
        """Return the text of the record's file."""
        return (
            "\n".join(
                _lines(
                    {
                        "versions": dict(self.versions),
                        "results": _compact(self.results),
                        "words": _compact(self.words),
                    }
                )
            )
            + "\n"
        )

    @classmethod
    def from_text(cls, text: str) -> "Record":
        """Read the text of a record's file."""
        stored = json.loads(text)
        return cls(
            stored["versions"],
            _expanded(stored["results"]),
            _expanded(stored["words"]),
        )


def path_of(name: str) -> Path:
    """Return the file of a guard's record."""
    return FOLDER / f"{name}.json"


def read_record(name: str) -> Record:
    """Return a stored record; an empty one if there is none."""
    path = path_of(name)
    return Record.from_text(path.read_text(encoding="utf-8")) if path.exists() else Record({})


def write_record(name: str, record: Record) -> bool:
    """Store a record, and return whether its file changed."""
    path, text = path_of(name), record.to_text()
    if path.exists() and path.read_text(encoding="utf-8") == text:
        return False
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return True


def versions_of(packages: Sequence[str]) -> dict[str, str]:
    """Return the installed versions of packages, `missing` for one that is not installed."""
    return {package: _version(package) for package in packages}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "missing"


def _compact(kinds: Items) -> Items:
    """Move the facts that all items of a kind share to the item `*`."""
    compacted: Items = {}
    for kind, items in kinds.items():
        shared = _shared([*items.values()]) if len(items) > 1 else {}
        own = {item: _without(facts, shared) for item, facts in items.items()}
        compacted[kind] = ({SHARED: shared} if shared else {}) | own
    return compacted


def _expanded(kinds: Items) -> Items:
    return {
        kind: {
            item: _joined(items.get(SHARED, {}), facts)
            for item, facts in items.items()
            if item != SHARED
        }
        for kind, items in kinds.items()
    }


def _shared(several: Sequence[Facts]) -> Facts:
    """Return the facts that all of several share; of facts in facts, those that they share."""
    first, shared = several[0], Facts()
    for name, value in first.items():
        values = [facts.get(name) for facts in several]
        if all(isinstance(one, Mapping) for one in values):
            if inner := _shared(values):  # pyright: ignore[reportArgumentType]
                shared[name] = inner
        elif all(name in facts for facts in several) and all(_same(one, value) for one in values):
            shared[name] = value
    return shared


def _without(facts: Facts, shared: Facts) -> Facts:
    own = Facts()
    for name, value in facts.items():
        if name not in shared:
            own[name] = value
        elif isinstance(value, Mapping) and (inner := _without(dict(value), shared[name])):
            own[name] = inner
    return own


def _joined(shared: Facts, own: Facts) -> Facts:
    both = {**shared, **own}
    for name in shared.keys() & own.keys():
        both[name] = _joined(shared[name], own[name])
    return both


def _same(one: Any, other: Any) -> bool:
    # As JSON has them: NaN is NaN, and 1 is not 1.0.
    return json.dumps(one) == json.dumps(other)


def _lines(value: Any, indent: int = 0, head: str = "", tail: str = "") -> Iterator[str]:
    """Yield JSON of one fact a line, so that a diff shows which facts changed."""
    pad = " " * indent
    flat = json.dumps(value, ensure_ascii=False)
    texts = isinstance(value, list | tuple) and any(isinstance(one, str) for one in value)
    nested = isinstance(value, Mapping) or texts
    if not value or not nested or (indent > 2 and len(pad + head + flat) < _WIDTH):
        yield f"{pad}{head}{flat}{tail}"
        return
    opened, closed = "{}" if isinstance(value, Mapping) else "[]"
    yield f"{pad}{head}{opened}"
    entries = (
        [(f"{json.dumps(str(key), ensure_ascii=False)}: ", one) for key, one in value.items()]
        if isinstance(value, Mapping)
        else [("", one) for one in value]
    )
    for place, (name, one) in enumerate(entries, 1):
        yield from _lines(one, indent + 1, name, "," if place < len(entries) else "")
    yield f"{pad}{closed}{tail}"
