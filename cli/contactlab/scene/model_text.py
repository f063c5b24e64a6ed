"""The text of XML files: positions of elements, and changes that leave everything else unchanged.

MuJoCo keeps the line of each element that it reads, through <attach>, <replicate>, frames and
classes, but not through <include>. Therefore files are laid out again: included content replaces
its <include>, each element stands on its own line, and no two files share a range of lines.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from contactlab.scene.model_files import FileSearch, merge_compilers
from contactlab.scene.model_xml import parse_model

_FIRST_CHILD = re.compile(rb"[ \t]*\r?\n([ \t]+)<")
_GENERAL = re.compile(rb"""\s(gain|bias)(type|prm)\s*=\s*("[^"]*"|'[^']*')""")
_TAG = re.compile(rb"<[^\s/>]+")
_ATTRIBUTE = re.compile(rb"""\s([^\s=]+)\s*=\s*("[^"]*"|'[^']*')""")
_XML_MARKUP = re.compile(
    rb"""<!--.*?-->|<!\[CDATA\[.*?\]\]>|<[!?].*?>|<(?:[^"'>]|"[^"]*"|'[^']*')*>""", re.DOTALL
)


class ElementText(NamedTuple):
    """Position of an element: its start tag in bytes [start, inner), all of it in [start, end)."""

    start: int
    inner: int
    end: int


class Replacement(NamedTuple):
    """Bytes [start, end) of a text, and the new text for them."""

    start: int
    end: int
    text: bytes


def mjcf_text(value: object) -> str:
    """Return a number, several numbers or a word as MJCF text; no number loses a digit."""
    if isinstance(value, (list, tuple)):
        return " ".join(mjcf_text(item) for item in value)
    return str(value).removesuffix(".0")


def attribute_text(values: Mapping[str, str]) -> str:
    """Return attributes as written in an element, each preceded by a space."""
    # `xml.sax.saxutils` has a function for this, but loads network protocols.
    replaced = str.maketrans(
        {"&": "&amp;", "<": "&lt;", ">": "&gt;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}
    )
    text_of_values = ""
    for name, value in values.items():
        text, quote = value.translate(replaced), '"'
        if '"' in text:
            quote, text = ("'", text) if "'" not in text else ('"', text.replace('"', "&quot;"))
        text_of_values += f" {name}={quote}{text}{quote}"
    return text_of_values


def line_of(data: bytes, place: int) -> int:
    """Return the line of a byte position in a text; the first line is 1."""
    return data.count(b"\n", 0, place) + 1


def elements_of(data: bytes) -> list[ElementText]:
    """Return the elements of an XML text, in the order of their start tags."""
    elements: list[ElementText] = []
    unclosed: list[int] = []
    for markup in _XML_MARKUP.finditer(data):
        if markup[0].startswith(b"</"):
            place = unclosed.pop()
            elements[place] = elements[place]._replace(end=markup.end())
        elif not markup[0].startswith((b"<!", b"<?")):
            if not markup[0].endswith(b"/>"):
                unclosed.append(len(elements))
            elements.append(ElementText(markup.start(), markup.end(), markup.end()))
    return elements


def with_attributes(
    data: bytes, element: ElementText, values: Mapping[str, str], tag: str | None = None
) -> Replacement:
    """Return an element's start tag with attributes set; new ones follow the others.

    An actuator that gets another tag loses its attributes of a general one, and its end tag.
    """
    missing = dict(values)

    def put(found: re.Match[bytes]) -> bytes:
        value = missing.pop(found[1].decode(errors="replace"), None)
        return found[0] if value is None else found[0].replace(found[2], f'"{value}"'.encode())

    text = _ATTRIBUTE.sub(put, data[element.start : element.inner])
    head = text[:-1].rstrip(b"/").rstrip()
    rest, end = text[len(head) :], element.inner
    if tag is not None:
        head = _GENERAL.sub(b"", head)
        head, rest, end = _TAG.sub(b"<" + tag.encode(), head, count=1), b"/>", element.end
    return Replacement(element.start, end, head + attribute_text(missing).encode() + rest)


def remove_element(data: bytes, element: ElementText) -> Replacement:
    """Return the removal of an element, and of its lines if nothing else is on them."""
    start, end = data.rfind(b"\n", 0, element.start) + 1, data.find(b"\n", element.end) + 1
    if data[start : element.start].strip() or not end or data[element.end : end].strip():
        start, end = element.start, element.end
    return Replacement(start, end, b"")


def append_lines(data: bytes, root: ElementText, lines: Iterable[str]) -> Replacement:
    """Return the insertion of the last lines of an element that has an end tag.

    They are indented like the element's first child.
    """
    newline = b"\r\n" if b"\r\n" in data else b"\n"
    stop = data.rindex(b"</", 0, root.end)
    start = data.rfind(b"\n", 0, stop) + 1
    place = stop if data[start:stop].strip() else start
    child = _FIRST_CHILD.match(data, root.inner, stop)
    indent = child[1] if child else data[place:stop] + b"  "
    text = b"".join(indent + line.encode() + newline for line in lines)
    return Replacement(place, place, text if place == start else newline + text)


def apply_replacements(data: bytes, changes: Iterable[Replacement]) -> bytes:
    """Return a text with non-overlapping replacements applied."""
    for start, end, text in sorted(changes, reverse=True):
        data = data[:start] + text + data[end:]
    return data


Origin = tuple[Path, int]  # a file, and the index of an element in it


@dataclass(frozen=True)
class Origins:
    """Files and indices of the elements of a model that was laid out again."""

    search: FileSearch  # finds the files, in a copy of them
    # The origin of the element on each line of the laid-out text.
    by_line: dict[int, Origin] = field(default_factory=dict[int, Origin])
    # The origin of the main file's last element of each tag.
    last: dict[str, Origin] = field(default_factory=dict[str, Origin])
    # The origins of the main file's keyframes; MuJoCo keeps no line of them.
    keyframes: list[Origin] = field(default_factory=list[Origin])

    @classmethod
    def lay_out(cls, main: Path, copy: Path) -> "Origins":
        """Lay out a copied model, and the models that it attaches, over their files."""
        origins_of_copy = cls(FileSearch(copy))
        for root, path, origins in list(origins_of_copy._laid_out_documents(main)):
            ET.indent(root)
            root.text = "\n" * (1 + max(origins_of_copy.by_line, default=0))
            ET.ElementTree(root).write(path)
            data = path.read_bytes()
            line, place = 1, 0
            for element, text in zip(root.iter(), elements_of(data), strict=True):
                line += data.count(b"\n", place, text.start)
                place = text.start
                origins_of_copy.by_line[line] = origins[element]
                if path == main:
                    origins_of_copy.last[element.tag] = origins[element]
                    if element.tag == "key":
                        origins_of_copy.keyframes.append(origins[element])
        return origins_of_copy

    def _laid_out_documents(
        self, path: Path
    ) -> Iterator[tuple[ET.Element, Path, Mapping[ET.Element, Origin]]]:
        origins: dict[ET.Element, Origin] = {}
        root = self._inline_includes(path, path.parent, origins)
        # Included files read assets from their own folder.
        compiler = merge_compilers(root, root.iter("compiler"))
        own = path.resolve()
        for element in root.iter():
            file, _ = origins[element]
            if file != own:
                here = self.search.find_assets(element, path, path.parent, compiler)
                for key, asset in self.search.find_assets(
                    element, file, path.parent, compiler
                ).items():
                    if asset != here[key]:
                        element.set(key, str(asset.path))
        yield root, path, origins
        for model in root.iter("model"):
            if model.get("file"):
                file, _ = origins[model]
                inner = self.search.find_model(model, file, path.parent).path
                yield from self._laid_out_documents(inner)

    def _inline_includes(
        self, path: Path, base: Path, origins: dict[ET.Element, Origin]
    ) -> ET.Element:
        root, own = parse_model(path), path.resolve()
        origins |= {element: (own, place) for place, element in enumerate(root.iter())}
        for parent in list(root.iter()):
            for place, child in reversed(list(enumerate(parent))):
                if child.tag == "include":
                    inner = self.search.find_model(child, path, base).path
                    parent[place : place + 1] = self._inline_includes(inner, base, origins)
        return root
