"""Read the XML of a model as MuJoCo reads it, and refuse files that MuJoCo could read differently.

MuJoCo's parser, tinyxml2, knows neither namespaces nor document types nor encodings, and is lenient
where XML is strict. The guards must check the same content that MuJoCo then opens. So a file has
to be well-formed XML in UTF-8 without definitions in its document type. Both parsers see the same
elements and attributes in such a file, except for two things. Namespaces are left unread here, too:
`xmlns` is an attribute like any other, and a prefix is a part of a name. Line breaks and tabs in
attributes become spaces in XML, but not in MuJoCo, so they are refused in the names of files.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

from contactlab.errors import SceneError

FOLDER_KEYS = ("meshdir", "texturedir", "assetdir")
"""The attributes of a compiler that name folders."""
FILE_KEYS = (
    "file",
    "filename",
    *(f"file{side}" for side in ("right", "left", "up", "down", "front", "back")),
)
"""The attributes of elements that name files."""
MAX_DEPTH = 500
"""TINYXML2_MAX_ELEMENT_DEPTH of MuJoCo's parser, the number of elements around one."""
_NAMING = {*FILE_KEYS, *FOLDER_KEYS}
_XACRO = "xacro"
_WHOLE = "; a model is <mujoco>...</mujoco> or <robot>...</robot>"
_NOT_XML = {
    "no element found": "it ends before all of its elements do",
    "syntax error": "this is no element",
    "not well-formed (invalid token)": "a character that has no place here",
    "mismatched tag": "it closes an element that is not the open one",
}
_ATTRIBUTE = re.compile(rb"""([^\s=<>/"']+)\s*=\s*("[^"]*"|'[^']*')|>""")
_BREAK = re.compile(rb"[\t\r\n]")


def check_regular(path: Path) -> None:
    """Refuse a pipe or device, which would be waited for; a missing file passes."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise SceneError(f"{path} is no regular file")


def check_depth(depth: int) -> None:
    """Refuse elements nested as deeply as MuJoCo's parser refuses them."""
    if depth >= MAX_DEPTH:
        raise SceneError(f"its elements are nested deeper than {MAX_DEPTH}; nest them less")


def parse_model(path: Path) -> ET.Element:
    """Return the root element of a model's file; a SceneError names the mistake and its place.

    Names are as written, with their prefixes.
    """
    check_regular(path)
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise SceneError(f"{path}: no such file; put it there, or name another") from error
    try:
        data.decode()
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise SceneError(f"{path}:{line}: not UTF-8; write the model in UTF-8") from error
    return _Reading(path, data).parse_root()


def parse_text(text: str, file_name: str) -> ET.Element:
    """Return the root element of a model's text, like `parse_model`. Errors name `file_name`."""
    return _Reading(Path(file_name), text.encode()).parse_root()


class _Reading:
    """The reading of one file."""

    def __init__(self, path: Path, data: bytes) -> None:
        self._path, self._data, self._depth = path, data, 0
        self._tree = ET.TreeBuilder()
        # MuJoCo ignores the encoding that a file declares.
        self._parser = expat.ParserCreate("utf-8")
        self._parser.buffer_text = True
        self._parser.StartElementHandler = self._start_element
        self._parser.EndElementHandler = self._end_element
        self._parser.CharacterDataHandler = self._tree.data
        self._parser.StartDoctypeDeclHandler = self._check_doctype

    def parse_root(self) -> ET.Element:
        try:
            self._parser.Parse(self._data, True)
        except expat.ExpatError as error:
            what = "the file is empty" if not self._data else str(error).partition(":")[0]
            place = f"{self._path}:{error.lineno}:{error.offset + 1}"
            raise SceneError(f"{place}: not XML: {_NOT_XML.get(what, what)}{_WHOLE}") from error
        root = self._tree.close()
        # Elements of xacro may have any prefix.
        prefixes = {_XACRO} | {
            key.removeprefix("xmlns:")
            for element in root.iter()
            for key, value in element.items()
            if key.startswith("xmlns:") and value.rstrip("/").endswith(_XACRO)
        }
        if any(":" in each.tag and each.tag.partition(":")[0] in prefixes for each in root.iter()):
            name = self._path.name
            raise SceneError(
                f"{self._path}: has macros; expand it first: `xacro {name} > robot.urdf`"
            )
        return root

    def _start_element(self, name: str, attributes: Mapping[str, str]) -> None:
        if not _NAMING.isdisjoint(attributes):
            self._check_breaks(self._parser.CurrentByteIndex)
        self._depth += 1
        if self._depth > MAX_DEPTH:
            self._refuse_file(f"elements nested deeper than {MAX_DEPTH}; nest them less")
        self._tree.start(name, dict(attributes))

    def _end_element(self, name: str) -> None:
        self._depth -= 1
        self._tree.end(name)

    def _check_breaks(self, start: int) -> None:
        """Refuse line breaks and tabs in the names of files that a start tag has."""
        for attribute in _ATTRIBUTE.finditer(self._data, start):
            key, value = attribute.groups()
            if key is None:
                return
            if key.decode() in _NAMING and _BREAK.search(value):
                self._refuse_file(f"{key.decode()} has a line break or a tab; write it without")

    def _check_doctype(self, name: str, *definitions: object) -> None:
        """Refuse a document type with definitions, because MuJoCo's parser reads parts as text."""
        if any(definitions):
            self._refuse_file(
                f"its document type defines something; write <!DOCTYPE {name}>, or none"
            )

    def _refuse_file(self, why: str) -> NoReturn:
        raise SceneError(f"{self._path}:{self._parser.CurrentLineNumber}: {why}")


Elements = Sequence[tuple[str, Mapping[str, str]]]
"""Elements of XML files, each with its path and its attributes."""


def list_elements(root: ET.Element) -> Elements:
    """Return an element and all below it, with their paths and attributes."""
    elements, stack = list[tuple[str, Mapping[str, str]]](), [(root, root.tag)]
    while stack:
        element, place = stack.pop()
        elements.append((place, element.attrib))
        stack += [(part, f"{place}/{part.tag}") for part in reversed(element)]
    return elements
