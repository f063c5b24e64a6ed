"""The text of an XML file: where its elements stand, and changes that leave all else as it is."""

import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

_ATTRIBUTE = re.compile(rb"""\s([^\s=]+)\s*=\s*("[^"]*"|'[^']*')""")
_MARKUP = re.compile(
    rb"""<!--.*?-->|<!\[CDATA\[.*?\]\]>|<[!?].*?>|<(?:[^"'>]|"[^"]*"|'[^']*')*>""", re.DOTALL
)


class ElementText(NamedTuple):
    """Where an element stands: its start tag in bytes [start, inner), all of it in [start, end)."""

    start: int
    inner: int
    end: int


class Replacement(NamedTuple):
    """Bytes [start, end) of a text, and what stands there instead."""

    start: int
    end: int
    text: bytes


def attributes(values: Mapping[str, str]) -> str:
    """Return attributes as written in an element, each preceded by a space."""
    return "".join(f" {name}={quoteattr(value)}" for name, value in values.items())


def line_of(data: bytes, place: int) -> int:
    """Return the line of a place in a text; the first is 1."""
    return data.count(b"\n", 0, place) + 1


def elements_of(data: bytes) -> list[ElementText]:
    """Return the elements of an XML text, in the order of their start tags."""
    found: list[ElementText] = []
    unclosed: list[int] = []
    for markup in _MARKUP.finditer(data):
        if markup[0].startswith(b"</"):
            place = unclosed.pop()
            found[place] = found[place]._replace(end=markup.end())
        elif not markup[0].startswith((b"<!", b"<?")):
            if not markup[0].endswith(b"/>"):
                unclosed.append(len(found))
            found.append(ElementText(markup.start(), markup.end(), markup.end()))
    return found


def with_attributes(data: bytes, element: ElementText, values: Mapping[str, str]) -> Replacement:
    """Return an element's start tag with attributes set, new ones behind the others."""
    missing = dict(values)

    def put(found: re.Match[bytes]) -> bytes:
        value = missing.pop(found[1].decode(errors="replace"), None)
        return found[0] if value is None else found[0].replace(found[2], f'"{value}"'.encode())

    text = _ATTRIBUTE.sub(put, data[element.start : element.inner])
    head = text[:-1].rstrip(b"/").rstrip()
    text = head + attributes(missing).encode() + text[len(head) :]
    return Replacement(element.start, element.inner, text)


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
    for start, end, text in sorted(changes, reverse=True):
        data = data[:start] + text + data[end:]
    return data
