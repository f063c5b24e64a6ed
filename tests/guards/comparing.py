"""Compares two records of a guard, and says in words how they differ.

Equal changes are one line: `trace bytes changed in 2 of 6 runs: ...`. A word that is another one
wherever it stood is a renaming, and so is a fact or an item that has another name and the same
values.
"""

import difflib
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Any, Literal

from tests.guards.records import Facts, Items, Record

_MOST_NAMED = 4  # items that a line names
_MOST_LINES = 30  # of a text's diff
_LAST_BITS = 1e-9  # relative; less than this is another processor or library, not another method
_MISSING = object()

Part = Literal["results", "words"]
Path = tuple[str, ...]


@dataclass(frozen=True)
class Change:
    """One change, in words.

    Attributes:
        part: the part of the record.
        text: the line, or lines.
        renaming: whether names alone changed.
    """

    part: Part
    text: str
    renaming: bool = False


@dataclass(frozen=True)
class _Fact:
    """A fact of an item that is another than before, or is in one record alone."""

    item: str
    path: Path
    before: Any
    after: Any


def compare(before: Record, after: Record) -> list[Change]:
    """Return the changes from one record to another; none if they are equal."""
    changes = list[Change]()
    parts: Sequence[tuple[Part, Items, Items]] = (
        ("results", before.results, after.results),
        ("words", before.words, after.words),
    )
    for part, old, new in parts:
        for kind in {**old, **new}:
            changes += _compare_items(part, kind, old.get(kind, {}), new.get(kind, {}))
    return changes


def joined(records: Iterable[Record]) -> Record:
    """Return the items of several records as one, so that equal changes of them are one line."""
    whole = Record({})
    for record in records:
        for parts, more in ((whole.results, record.results), (whole.words, record.words)):
            for kind, items in more.items():
                parts.setdefault(kind, {}).update(items)
    return whole


def summary(name: str, changes: Sequence[Change]) -> str:
    """Return the changes of a guard as text, results first; "" if there are none."""
    lines = list[str]()
    for title, chosen in (
        ("results changed", [one for one in changes if one.part == "results" and not one.renaming]),
        ("renamed", [one for one in changes if one.renaming]),
        ("words changed", [one for one in changes if one.part == "words" and not one.renaming]),
    ):
        if chosen:
            lines += [f"{name}: {title}", *(f"  {one.text}" for one in chosen)]
    return "\n".join(lines)


def _compare_items(
    part: Part, kind: str, before: Mapping[str, Facts], after: Mapping[str, Facts]
) -> Iterator[Change]:
    gone = [name for name in before if name not in after]
    new = [name for name in after if name not in before]
    for old in [*gone]:
        same = (name for name in new if part == "results" and _same(before[old], after[name]))
        if name := next(same, None):
            yield Change(
                part, f"{kind} {old} is now called {name}, with the same facts", renaming=True
            )
            gone.remove(old)
            new.remove(name)
    for names, state in ((gone, "gone"), (new, "new")):
        if names:
            yield Change(part, f"{_counted(len(names), kind)} {state}: {_named(names)}")
    both = [name for name in before if name in after]
    all_items = _AllItems(part, kind, len(both), _stood(before))
    renamings, found = _renamed_facts(_differing_facts(both, before, after))
    for old, new, items in renamings:
        text = f"{_said(old)} is now called {_said(new)}, with the same values, in "
        yield Change(part, text + all_items.among(items), renaming=True)
    by_path: dict[Path, list[_Fact]] = {}
    for one in found:
        by_path.setdefault(one.path, []).append(one)
    for path, facts in by_path.items():
        yield from all_items.changes(path, facts)


def _differing_facts(
    names: Iterable[str], before: Mapping[str, Facts], after: Mapping[str, Facts]
) -> list[_Fact]:
    found = list[_Fact]()
    for name in names:
        old, new = dict(_flat(before[name])), dict(_flat(after[name]))
        facts = (
            _Fact(name, path, old.get(path, _MISSING), new.get(path, _MISSING))
            for path in {**old, **new}
        )
        found += [one for one in facts if not _same(one.before, one.after)]
    return found


def _stood(before: Mapping[str, Facts]) -> dict[tuple[Path, str], int]:
    """Return in how many items a fact was a word."""
    counts: dict[tuple[Path, str], int] = {}
    for facts in before.values():
        for path, value in _flat(facts):
            if isinstance(value, str):
                counts[path, value] = counts.get((path, value), 0) + 1
    return counts


def _renamed_facts(
    found: Sequence[_Fact],
) -> tuple[list[tuple[Path, Path, list[str]]], list[_Fact]]:
    """Return facts that have another name and the same values everywhere, and the other changes."""
    gone: dict[Path, dict[str, str]] = {}
    new: dict[Path, dict[str, str]] = {}
    for one in found:
        if one.after is _MISSING:
            gone.setdefault(one.path, {})[one.item] = _json(one.before)
        elif one.before is _MISSING:
            new.setdefault(one.path, {})[one.item] = _json(one.after)
    renamings = list[tuple[Path, Path, list[str]]]()
    renamed = set[Path]()
    for old, values in gone.items():
        # Among equal values, the name at the same level and place is meant.
        candidates = [
            path
            for path, others in new.items()
            if path not in renamed and others == values and len(path) == len(old)
        ]
        candidates.sort(key=lambda path: sum(a != b for a, b in zip(path, old, strict=True)))
        if candidates:
            renamings.append((old, candidates[0], [*values]))
            renamed |= {old, candidates[0]}
    return _by_prefix(renamings), [one for one in found if one.path not in renamed]


def _by_prefix(
    renamings: list[tuple[Path, Path, list[str]]],
) -> list[tuple[Path, Path, list[str]]]:
    """Join renamings of facts within one renamed group into that of the group."""
    joined: dict[tuple[Path, Path], dict[str, None]] = {}
    for old, new, items in renamings:
        alike = takewhile(
            lambda pair: pair[0] == pair[1], zip(reversed(old), reversed(new), strict=True)
        )
        end = max(1, len(old) - sum(1 for _ in alike))
        joined.setdefault((old[:end], new[:end]), {}).update(dict.fromkeys(items))
    return [(old, new, [*items]) for (old, new), items in joined.items()]


@dataclass(frozen=True)
class _AllItems:
    """The items of a kind that both records have.

    Attributes:
        part: the part of the records.
        kind: the noun that counts them.
        count: how many there are.
        stood: in how many items of the first record a fact was a word.
    """

    part: Part
    kind: str
    count: int
    stood: Mapping[tuple[Path, str], int]

    def changes(self, path: Path, facts: Sequence[_Fact]) -> Iterator[Change]:
        """Yield the changes of one fact, equal ones of several items together."""
        groups: dict[tuple[str, str], list[_Fact]] = {}
        for one in facts:
            groups.setdefault((_json(one.before), _json(one.after)), []).append(one)
        if len(groups) > 1 and all(map(_is_own, facts)):
            shown = "; ".join(f"{one.item} {_step(one)}" for one in facts[:_MOST_NAMED])
            more = f"; and {len(facts) - _MOST_NAMED} more" if len(facts) > _MOST_NAMED else ""
            where = f"{len(facts)} of {_counted(self.count, self.kind)}"
            bits = ", by last bits only" if all(map(_by_last_bits, facts)) else ""
            yield Change(self.part, f"{_said(path)} changed in {where}{bits}: {shown}{more}")
            return
        for group in groups.values():
            renaming = self._is_renaming(group)
            where = self.among([one.item for one in group])
            yield Change(self.part, _changed(group[0], where, renaming=renaming), renaming)

    def among(self, items: Sequence[str]) -> str:
        """Return which of all items these are."""
        if self.count == 1:
            return f"{self.kind} {items[0]}"
        if len(items) == self.count:
            return f"all {_counted(self.count, self.kind)}"
        return f"{len(items)} of {_counted(self.count, self.kind)} ({_named(items)})"

    def _is_renaming(self, group: Sequence[_Fact]) -> bool:
        """Whether a word is another one wherever it stood, and that one stood nowhere."""
        path, before, after = group[0].path, group[0].before, group[0].after
        return (
            self.part == "results"
            and self.count > 1
            and isinstance(before, str)
            and isinstance(after, str)
            and not _is_digest(before)
            and (path, after) not in self.stood
            and self.stood[path, before] == len(group)
        )


def _changed(one: _Fact, where: str, *, renaming: bool) -> str:
    said = _said(one.path)
    if renaming:
        return f"{said}: {_shown(one.before)} is now called {_shown(one.after)} in {where}"
    if one.before is _MISSING:
        return f"{said} {_shown(one.after)} is new in {where}"
    if one.after is _MISSING:
        return f"{said} {_shown(one.before)} is gone in {where}"
    if _is_text(one.before) and _is_text(one.after):
        return f"{said} changed in {where}:\n{_diff(one.before, one.after)}"
    bits = ", by last bits only" if _by_last_bits(one) else ""
    return f"{said} {_step(one)}{bits} in {where}"


def _flat(facts: Mapping[str, Any], path: Path = ()) -> Iterator[tuple[Path, Any]]:
    for name, value in facts.items():
        if isinstance(value, Mapping) and value:
            yield from _flat(value, (*path, name))
        else:
            yield (*path, name), value


def _json(value: Any) -> str:
    return "" if value is _MISSING else json.dumps(value)


def _same(one: Any, other: Any) -> bool:
    return _MISSING not in (one, other) and _json(one) == _json(other)


def _said(path: Path) -> str:
    return ".".join(path)


def _is_text(value: Any) -> bool:
    return isinstance(value, list | tuple) and any(isinstance(one, str) for one in value)


def _is_digest(text: str) -> bool:
    return len(text) >= 16 and set(text) <= set("0123456789abcdef")


def _is_own(one: _Fact) -> bool:
    """Whether a change is of numbers or digests, of which each item has its own."""
    both = one.before, one.after
    return all(isinstance(value, float | int) for value in both) or all(
        isinstance(value, str) and _is_digest(value.rpartition(" ")[2]) for value in both
    )


def _by_last_bits(one: _Fact) -> bool:
    before, after = one.before, one.after
    if not isinstance(before, float) or not isinstance(after, float):
        return False
    return math.isclose(before, after, rel_tol=_LAST_BITS)


def _step(one: _Fact) -> str:
    text = f"{_shown(one.before)} -> {_shown(one.after)}"
    if (
        isinstance(one.before, float)
        and isinstance(one.after, float)
        and one.before
        and not _by_last_bits(one)
    ):
        text += f" ({one.after / one.before - 1:+.3g} of it)"
    return text


def _shown(value: Any) -> str:
    if isinstance(value, str) and _is_digest(value):
        return value[:12]
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 120 else f"{text[:120]}..."


def _diff(before: Sequence[str], after: Sequence[str]) -> str:
    old, new = ([str(line) for line in side] for side in (before, after))
    found = difflib.unified_diff(old, new, n=0, lineterm="")
    lines = [line for line in found if not line.startswith(("---", "+++", "@@"))]
    more = [f"... and {len(lines) - _MOST_LINES} more lines"] if len(lines) > _MOST_LINES else []
    return "\n".join(f"    {line}" for line in (*lines[:_MOST_LINES], *more))


def _counted(count: int, kind: str) -> str:
    return f"{count} {kind}{'' if count == 1 else 's'}"


def _named(names: Sequence[str]) -> str:
    more = f", and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(names[:_MOST_NAMED]) + more
