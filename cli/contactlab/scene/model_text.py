"""The text of an XML file: where its elements stand, and changes that leave all else as it is."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

_ATTRIBUTE = re.compile(rb"""\s([^\s=]+)\s*=\s*("[^"]*"|'[^']*')""")
_START_TAG = re.compile(rb"""<(?:[^"'>]|"[^"]*"|'[^']*')*>""")


@dataclass(frozen=True)
class ElementText:
    """Where an element stands: its start tag in bytes [start, inner), all of it in [start, end).

    Its line counts from 1.
    """

    line: int
    start: int
    inner: int
    end: int


@dataclass(frozen=True)
class Replacement:
    """Bytes [start, end) of a text, and what stands there instead."""

    start: int
    end: int
    text: bytes


def attributes(values: Mapping[str, str]) -> str:
    """Return attributes as written in an element, each preceded by a space."""
    return "".join(f" {name}={quoteattr(value)}" for name, value in values.items())


def elements_of(data: bytes) -> list[ElementText]:
    """Return the elements of an XML text, in the order of their start tags."""
    parser, ends, open_ = expat.ParserCreate(), dict[int, int](), list[int]()
    found: list[tuple[int, int, int]] = []

    def begin(*_: object) -> None:
        start = parser.CurrentByteIndex
        tag = _START_TAG.match(data, start)
        # Text that an entity stands for has no place of its own.
        inner = tag.end() if tag else start
        open_.append(len(found))
        found.append((parser.CurrentLineNumber, start, inner))

    def finish(*_: object) -> None:
        inner = found[place := open_.pop()][2]
        closed = data[inner - 2 : inner] == b"/>"
        ends[place] = inner if closed else data.find(b">", parser.CurrentByteIndex) + 1

    parser.StartElementHandler, parser.EndElementHandler = begin, finish
    parser.Parse(data, True)
    return [ElementText(*each, ends[place]) for place, each in enumerate(found)]


def with_attributes(data: bytes, element: ElementText, values: Mapping[str, str]) -> Replacement:
    """Return an element's start tag with attributes set, new ones behind the others."""
    missing = dict(values)

    def put(found: re.Match[bytes]) -> bytes:
        value = missing.pop(found[1].decode(), None)
        return found[0] if value is None else found[0].replace(found[2], f'"{value}"'.encode())

    text = _ATTRIBUTE.sub(put, data[element.start : element.inner])
    head = text[:-1].rstrip(b"/").rstrip()
    return Replacement(
        element.start, element.inner, head + attributes(missing).encode() + text[len(head) :]
    )


def without(data: bytes, element: ElementText) -> Replacement:
    """Return the removal of an element, and of its lines if nothing else stands there."""
    start, end = data.rfind(b"\n", 0, element.start) + 1, data.find(b"\n", element.end) + 1
    if data[start : element.start].strip() or not end or data[element.end : end].strip():
        start, end = element.start, element.end
    return Replacement(start, end, b"")


def at_end(data: bytes, root: ElementText, lines: Iterable[str]) -> Replacement:
    """Return the insertion of lines as the last in a root element."""
    newline = b"\r\n" if b"\r\n" in data else b"\n"
    text = b"".join(b"  " + line.encode() + newline for line in lines)
    stop = data.rindex(b"</", 0, root.end)
    start = data.rfind(b"\n", 0, stop) + 1
    place = stop if data[start:stop].strip() else start
    return Replacement(place, place, text if place == start else newline + text)


def replaced(data: bytes, changes: Iterable[Replacement]) -> bytes:
    """Return a text with replacements made, which do not overlap."""
    for each in sorted(changes, key=lambda change: change.start, reverse=True):
        data = data[: each.start] + each.text + data[each.end :]
    return data
