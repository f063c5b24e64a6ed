"""Facts of nested data as text: one line each, in the order of the alphabet."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

DIGITS = 12


def fact_lines(data: Any, name: str = "", digits: int = DIGITS) -> list[str]:
    """Return `name = value` of every value of nested data, sorted.

    Keys are joined by dots and places in lists stand in brackets; a list of plain values is one
    value. Floats are rounded to so many significant digits.
    """
    return sorted(_lines(data, name, digits))


def _lines(data: Any, name: str, digits: int) -> Iterator[str]:
    if isinstance(data, Mapping) and data:
        for key, value in data.items():
            yield from _lines(value, f"{name}.{key}" if name else str(key), digits)
    elif isinstance(data, list | tuple) and any(map(_is_nested, data)):
        for place, value in enumerate(data):
            yield from _lines(value, f"{name}[{place}]", digits)
    else:
        yield f"{name} = {value_text(data, digits)}"


def _is_nested(value: object) -> bool:
    return isinstance(value, Mapping | list | tuple)


def value_text(value: Any, digits: int = DIGITS) -> str:
    """Return a value as text, its floats rounded, -0 as 0."""
    if isinstance(value, float):
        return f"{value or 0.0:.{digits}g}" if math.isfinite(value) else str(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(value_text(item, digits) for item in value)}]"
    return str(value)


def section(title: str, lines: Iterable[str]) -> str:
    """Return lines below a title."""
    return "".join(f"{line}\n" for line in (f"== {title}", *lines, ""))


def shared_and_own(records: Sequence[Mapping[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Return the facts that all records state, and of each record the others."""
    facts = [fact_lines(record) for record in records]
    shared = set.intersection(*map(set, facts)) if len(facts) > 1 else set[str]()
    return sorted(shared), [[line for line in lines if line not in shared] for lines in facts]
