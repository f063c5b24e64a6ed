"""A YAML text as plain data, with the place of every key and value."""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import cast

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, StreamMark, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError

from contactlab.errors import SweepFileError, no_file, refuse_pipe
from contactlab.plan.diagnostics import Diagnostic, Place, Severity, SourceText
from contactlab.plan.mistakes import MISTAKES
from contactlab.plan.number_lists import Composition, NumberList, compose_yaml
from contactlab.printable import in_one_line
from contactlab.schema.strict_model import check_extent

KeyPath = tuple[str | int, ...]
MOST_NODES = 1_000_000
# YAML 1.2's own definition of a number; the loader takes `.5e3` for a word, and warns of `1e3`
# in YAML 1.1.
_FLOAT_PATTERN = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_LINE_BREAK = re.compile("\r\n|[\n\r\x85\u2028\u2029]")
_TAG_PREFIX = "tag:yaml.org,2002:"
_FLOAT_TAGS = (f"{_TAG_PREFIX}str", f"{_TAG_PREFIX}float")


@dataclass
class Document:
    """Plain data with the places of its values and keys by path, and the mistakes in it.

    Mistakes, including warnings, are in order of addition; unreadable text gets no further ones.
    The text is that of the file, or JSON for data.
    """

    source: SourceText
    data: object = None
    text: str = ""
    values: dict[KeyPath, Place] = field(default_factory=dict[KeyPath, Place])
    keys: dict[KeyPath, Place] = field(default_factory=dict[KeyPath, Place])
    mistakes: list[Diagnostic] = field(default_factory=list[Diagnostic])
    unreadable: set[Place] = field(default_factory=set[Place])

    @property
    def has_errors(self) -> bool:
        """Whether any mistake is more than a warning."""
        return any(mistake.severity == "error" for mistake in self.mistakes)

    def mapping_at(self, *path: str | int) -> dict[str, object]:
        """Return the mapping at a path, or an empty one."""
        data = self.value_at(path)
        return cast("dict[str, object]", data) if isinstance(data, dict) else {}

    def add_mistake(
        self,
        code: str,
        path: KeyPath | Place,
        message: str,
        hint: str = "",
        *,
        severity: Severity = "error",
    ) -> None:
        """Add a mistake at the value of a path, or at a place."""
        assert code in MISTAKES, code
        place = path if isinstance(path, Place) else self.value_place(path)
        if place not in self.unreadable:
            self.mistakes.append(Diagnostic(code, message, place, hint, severity))
        if code == "syntax":
            self.unreadable.add(place)

    def replace_value(self, path: KeyPath, at: Place) -> dict[str, object]:
        """Remove the data at a path, and return the mapping for a new value.

        Missing parents are created, with the place of the new key.
        """
        for places in (self.values, self.keys):
            for old in [place for place in places if place[: len(path)] == path]:
                del places[old]
        parent = cast("dict[str, object]", self.data)
        for depth, part in enumerate(path[:-1], 1):
            self.keys.setdefault(path[:depth], at)
            inner = parent.get(str(part))
            if not isinstance(inner, dict):
                inner = parent[str(part)] = {}
            parent = cast("dict[str, object]", inner)
        self.keys[path] = at
        return parent

    def value_place(self, path: KeyPath) -> Place:
        """Return the place of the value at a path, or of its nearest parent."""
        while path and path not in self.values:
            path = path[:-1]
        return self.values.get(path) or Place(self.source, 1, 1)

    def value_at(self, path: KeyPath) -> object:
        """Return the data at a path, or None."""
        data = self.data
        for part in path:
            if isinstance(data, dict) and isinstance(part, str):
                data = cast("dict[str, object]", data).get(part)
            elif isinstance(data, list) and isinstance(part, int):
                items = cast("list[object]", data)
                data = items[part] if part < len(items) else None
            else:
                return None
        return data

    def key_place(self, path: KeyPath) -> Place:
        """Return the place of the key at a path, or of the value without one."""
        return self.keys.get(path) or self.value_place(path)


def read_text(path: Path) -> str:
    """Return a file's text; raise SweepFileError if it cannot be read, or is not UTF-8."""
    try:
        refuse_pipe(path)
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise SweepFileError(no_file(path, "file", {path.suffix})) from error
    except OSError as error:
        raise SweepFileError(f"cannot read {path}: {error.strerror}; name a file") from error
    except UnicodeDecodeError as error:
        raise SweepFileError(
            f"cannot read {path}: it is not UTF-8 text; write it as YAML"
        ) from error


def open_document(source: Path | str | Mapping[str, object]) -> Document:
    """Read a YAML file by its path, or its text, or data as JSON has it; see `read_document`."""
    if isinstance(source, Mapping):
        return data_document(source, "sweep")
    if isinstance(source, Path):
        return read_document(read_text(source), str(source))
    return read_document(source, "sweep")


def read_document(text: str, name: str) -> Document:
    """Read a YAML text. The document has its mistakes."""
    document = Document(SourceText(name, tuple(_LINE_BREAK.split(text))), text=text)
    document.data = _YamlReader(document, document.source).read(text)
    return document


def data_document(data: object, name: str) -> Document:
    """Return data, as JSON has it, as a document; its places are paths, such as `axes.mass[2]`."""
    text = json.dumps(data, indent=1)
    document = Document(SourceText(name, (name,), numbered=False), json.loads(text), text)
    for path, value in _data_parts(document.data, ()):
        text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)[1:]
        text += "" if isinstance(value, dict | list) else f": {json.dumps(value)}"
        place = Place(SourceText(name, (text,), numbered=False), 1, 1, len(text))
        document.values[path] = document.keys[path] = place
    return document


def _data_parts(data: object, path: KeyPath) -> Iterator[tuple[KeyPath, object]]:
    inner = data.items() if isinstance(data, dict) else ()
    inner = enumerate(data) if isinstance(data, list) else inner
    for key, value in cast("Iterable[tuple[str | int, object]]", inner):
        yield (*path, key), value
        yield from _data_parts(value, (*path, key))


def read_argument(
    document: Document, path: KeyPath, text: str, source: SourceText, column: int
) -> object:
    """Return the data of a piece of YAML that begins at a column, from 1, of a line of other text.

    The piece is wrapped in one character at each end that the line does not have. The mistakes, and
    the places of its parts below the path of the data, are added to the document.
    """
    return _YamlReader(document, source, column - 2).read(text, path)


def extent_of(root: Node) -> float:
    """Return the number of values below a node, including itself, with each alias written out.

    Nodes that aliases share are counted once and added for each use, so that a text that doubles
    itself in each line is counted before any of it is created. Infinite if a node is below itself.
    """
    extents: dict[int, float] = {}
    waiting = [root]
    while waiting:
        node = waiting[-1]
        if isinstance(node, MappingNode):
            inner = [value for _, value in cast("list[tuple[Node, Node]]", node.value)]
        else:
            inner = cast("list[Node]", node.value) if isinstance(node, SequenceNode) else []
        if id(node) not in extents:
            extents[id(node)] = math.inf  # until it is known; it stays so if it is below itself
            waiting += (below for below in inner if id(below) not in extents)
        else:
            waiting.pop()
            if extents[id(node)] == math.inf:
                extents[id(node)] = 1 + sum(extents[id(below)] for below in inner)
    return extents[id(root)]


def _check_size(root: Node) -> Node:
    if extent_of(root) > MOST_NODES:
        raise YAMLError(f"more than {MOST_NODES:,} values; use include: {{file: runs.csv}}")
    return root


class _YamlReader:
    def __init__(self, document: Document, source: SourceText, shift: int = 0) -> None:
        self.document = document
        self.source = source
        self.shift = shift
        self.composition = Composition(YAML(typ="safe", pure=True), None, {})

    def read(self, text: str, path: KeyPath = ()) -> object:
        try:
            check_extent(text)
            self.composition = compose_yaml(text)
            root = self.composition.root
            return None if root is None else self._node_data(_check_size(root), path)
        except MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            place = self._mark_place(cast("StreamMark", mark)) if mark else Place(self.source, 1, 1)
            self._add_syntax_error(_syntax_message(error), place)
        except ReaderError as error:
            before = text[: cast("int", error.position)].split("\n")
            place = Place(self.source, len(before), len(before[-1]) + 1)
            self._add_syntax_error("a character that YAML does not allow", place)
        except (YAMLError, ValueError) as error:
            self._add_syntax_error(str(error), Place(self.source, 1, 1))
        except RecursionError:
            self._add_syntax_error("nested too deeply", Place(self.source, 1, 1))
        return None

    def _mark_place(self, start: StreamMark, end: StreamMark | None = None) -> Place:
        column = max(start.column + 1 + self.shift, 1)
        place = Place(self.source, start.line + 1, column)
        if end is None:
            return replace(place, column=min(column, len(place.text) + 1))
        last = end.column + self.shift if end.line == start.line else len(place.text.rstrip())
        return replace(place, width=max(last + 1 - column, 1))

    def _node_data(self, node: Node, path: KeyPath) -> object:
        place = self.document.values[path] = self._mark_place(node.start_mark, node.end_mark)
        if not str(node.tag).startswith(_TAG_PREFIX):
            self._add_syntax_error(f"no tag {in_one_line(str(node.tag))}; leave it out", place)
        if isinstance(node, MappingNode):
            data: dict[str, object] = {}
            for key, value in self._merged_entries(node):
                place, name = self._mark_place(key.start_mark, key.end_mark), str(key.value)
                if not isinstance(key, ScalarNode):
                    self._add_syntax_error("a key must be a single word", place)
                    continue
                if name in data:
                    first = self.document.keys[(*path, name)]
                    message = f"'{name}' is given twice"
                    self.document.add_mistake(
                        "duplicate-key", place, message, f"first given {first.spot}"
                    )
                    continue
                self.document.keys[(*path, name)] = place
                data[name] = self._node_data(value, (*path, name))
            return data
        if isinstance(node, SequenceNode):
            items = cast("list[Node]", node.value)
            if id(node) in self.composition.lists:
                return self._list_numbers(self.composition.lists[id(node)], items[0], path)
            return [self._node_data(item, (*path, index)) for index, item in enumerate(items)]
        return self._scalar_data(cast("ScalarNode", node))

    def _list_numbers(self, numbers: NumberList, first: Node, path: KeyPath) -> list[float]:
        start = self._mark_place(first.start_mark)
        later = max(1 + self.shift, 1)
        for index, (line, column, width) in enumerate(numbers.iterate_places()):
            first_column = later if line else start.column
            place = Place(self.source, start.line + line, first_column + column, width)
            self.document.values[(*path, index)] = place
        return list(numbers.numbers)

    def _merged_entries(self, node: MappingNode) -> Iterator[tuple[Node, Node]]:
        """Yield the entries of a mapping, and those merged (`<<`) that it does not replace."""
        entries = cast("list[tuple[Node, Node]]", node.value)
        names = {str(key.value) for key, _ in entries}
        for key, value in entries:
            if str(key.tag) != f"{_TAG_PREFIX}merge":
                yield key, value
                continue
            for entry in self._merge_sources(value):
                if str(entry[0].value) not in names:
                    names.add(str(entry[0].value))
                    yield entry

    def _merge_sources(self, node: Node) -> Iterator[tuple[Node, Node]]:
        sources = cast("list[Node]", node.value) if isinstance(node, SequenceNode) else [node]
        for source in sources:
            if isinstance(source, MappingNode):
                yield from self._merged_entries(source)
            else:
                place = self._mark_place(source.start_mark, source.end_mark)
                self._add_syntax_error("`<<` takes a mapping, or a list of mappings", place)

    def _scalar_data(self, node: ScalarNode) -> object:
        text, tag = str(node.value), str(node.tag)
        if not node.style and tag in _FLOAT_TAGS and _FLOAT_PATTERN.fullmatch(text):
            return float(text)
        if tag == f"{_TAG_PREFIX}timestamp":
            return text
        try:
            return self.composition.yaml.constructor.construct_object(node)
        except (MarkedYAMLError, ValueError):
            place = self._mark_place(node.start_mark, node.end_mark)
            self._add_syntax_error(
                f"{text!r} cannot be read as {tag.removeprefix(_TAG_PREFIX)}", place
            )
            return None

    def _add_syntax_error(self, message: str, place: Place) -> None:
        self.document.add_mistake("syntax", place, message)


_PLAIN_MESSAGES = {
    "mapping values are not allowed here": "a second ': ' in one line; quote the text or indent",
    "found character '\\t' that cannot start any token": "a tab; indent with spaces",
    "but found another document": "a second document; a file holds one",
    "found undefined alias": "no anchor of this name; write &NAME before",
    "expected ',' or ']'": "a bracket is not closed; write ]",
    "expected ',' or '}'": "a brace is not closed; write }",
    "expected <block end>": "an entry out of line with those above; indent it like them",
    "could not find expected ':'": "a key without a colon; write NAME: VALUE",
    "found unexpected end of stream": "a quote is not closed; write it at the end of the text",
    "expected the node content": "a value is missing before this; write one",
    "found character": "a character that no value begins with; quote the text",
    "found unknown escape": "an escape that YAML does not have; use single quotes",
    "did not find expected": "this does not belong here; indent it as the line above",
}


def _syntax_message(error: MarkedYAMLError) -> str:
    problem = str(error.problem or error.context or "not YAML").strip()
    for parser_message, plain in _PLAIN_MESSAGES.items():
        if problem.startswith(parser_message):
            return plain
    context = f" {error.context}" if error.context and error.problem else ""
    return f"{problem}{context}".replace("<stream end>", "the end of the file")
