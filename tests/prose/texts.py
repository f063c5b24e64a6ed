"""Reads the prose of Python and Markdown files: docstrings, comments, messages and paragraphs."""

import ast
import functools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

# Two words in a row, the second in lower case: a literal without them is a name, a key or a format.
_TWO_WORDS = re.compile(r"[A-Za-z]{2,},?\s+[a-z]{2,}")
# A sentence ends at its punctuation, at an empty line, a list item, a heading or a table cell.
_SENTENCE_END = re.compile(r"[.!?:;][\"')*`]*\s+|\n\s*\n|\n(?=\s*(?:[-*+]|\d+\.|#+)\s)|\s*\|\s*")
_PRAGMA = re.compile(r"#\s*(?:!|noqa|type:|pyright:|ruff:|fmt:)")
_FENCE = re.compile(r"^[ >]*(```|~~~).*?^[ >]*\1[^\n]*$", re.MULTILINE | re.DOTALL)
_TAG = re.compile(r"<!--.*?-->|</?[a-z][^<>]*>|(?<=\])\([^()\s]*(?:\s\"[^\"]*\")?\)", re.DOTALL)
_CODE = re.compile(r"(`+)(?!`)(.+?)(?<!`)\1(?!`)", re.DOTALL)
_INDENT = re.compile(r"\n[ \t>]+")


@dataclass(frozen=True)
class Text:
    """Consecutive prose of one file; `line` is the line of its first character."""

    line: int
    content: str
    is_heading: bool = False
    spans_lines: bool = True

    @functools.cached_property
    def flat(self) -> str:
        """The content on one line, code blanked out, each character where it was."""
        return _CODE.sub(lambda code: "_" * len(code.group()), self.content).replace("\n", " ")

    def line_at(self, offset: int) -> int:
        """Return the line of a character."""
        return self.line + self.content.count("\n", 0, offset) * self.spans_lines

    def sentence_at(self, offset: int) -> tuple[int, str]:
        """Return where the sentence around a character starts, and the sentence."""
        start, end = 0, len(self.content)
        for match in _SENTENCE_END.finditer(self.content):
            if match.end() <= offset:
                start = match.end()
            elif match.start() >= offset:
                end = match.end()
                break
        return start, " ".join(self.content[start:end].strip(" |\n").split())


@dataclass(frozen=True)
class Name:
    """A defined function, class or module."""

    line: int
    kind: str
    name: str
    has_docstring: bool = False
    is_property: bool = False
    is_published: bool = False


@dataclass(frozen=True)
class FileContent:
    """The prose and the defined names of a file."""

    texts: tuple[Text, ...]
    names: tuple[Name, ...] = ()
    tree: ast.Module | None = None


def read_file(path: Path) -> FileContent:
    """Read a Python or Markdown file.

    Raises:
        SyntaxError: if a Python file does not parse.
    """
    source = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        return read_python(source, path.stem)
    return FileContent(tuple(read_markdown(source)))


def read_markdown(source: str) -> Iterator[Text]:
    """Yield paragraphs, headings, list items and tables, without code, tags and link targets."""
    source = _FENCE.sub(_blank, source)
    source = _TAG.sub(_blank, source)
    for match in re.finditer(r"(?:[^\n]*\S[^\n]*\n?)+", source):
        line = source.count("\n", 0, match.start()) + 1
        for number, part in _split_headings(match.group()):
            is_heading = part.lstrip().startswith("#")
            yield Text(line + number, _dedent(part), is_heading)


def read_python(source: str, module: str) -> FileContent:
    """Read docstrings, messages, comments and definitions."""
    tree = ast.parse(source)
    visitor = _Visitor(module)
    visitor.visit(tree)
    comments = _read_comments(source, visitor.literals)
    return FileContent((*visitor.texts, *comments), tuple(visitor.names), tree)


# Their functions are published under their own names: labels, metrics, commands, fixtures.
_PUBLISHING = {"check", "command", "label", "metric", "oracle", "engine", "override", "overload"}


class _Visitor:
    def __init__(self, module: str) -> None:
        self.texts: list[Text] = []
        self.literals: list[ast.expr] = []
        self.names: list[Name] = []
        if not module.startswith("__"):
            self.names.append(Name(1, "module", module))

    def visit(self, tree: ast.Module) -> None:
        stack: list[ast.AST] = [tree]
        while stack:
            node = stack.pop()
            if isinstance(node, ast.JoinedStr):
                self._add_format(node)
                stack.extend(part for part in node.values if not isinstance(part, ast.Constant))
                continue
            if isinstance(node, ast.Constant):
                self._add_constant(node)
            elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                self._add_function(node)
            elif isinstance(node, ast.ClassDef):
                self.names.append(Name(node.lineno, "class", node.name))
            stack.extend(ast.iter_child_nodes(node))

    def _add_function(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        decorators = {_decorator_name(each) for each in node.decorator_list}
        self.names.append(
            Name(
                node.lineno,
                "function",
                node.name,
                has_docstring=ast.get_docstring(node, clean=False) is not None,
                is_property=bool(decorators & {"property", "cached_property", "setter"}),
                is_published=bool(decorators & _PUBLISHING),
            )
        )

    def _add_constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, str):
            self.literals.append(node)
            if _TWO_WORDS.search(node.value):
                lines = (node.end_lineno or node.lineno) - node.lineno
                spans = lines == node.value.count("\n")
                self.texts.append(Text(node.lineno, _dedent(node.value), spans_lines=spans))
        elif isinstance(node.value, bytes):
            self.literals.append(node)

    def _add_format(self, node: ast.JoinedStr) -> None:
        self.literals.append(node)
        parts = [
            part.value if isinstance(part, ast.Constant) and isinstance(part.value, str) else "{}"
            for part in node.values
        ]
        text = "".join(parts)
        if _TWO_WORDS.search(text):
            self.texts.append(Text(node.lineno, _dedent(text), spans_lines=False))


def _read_comments(source: str, literals: list[ast.expr]) -> Iterator[Text]:
    """Yield the comments; a `#` inside one of the literals is not one."""
    spans = _spans_of_lines(literals)
    block: list[str] = []
    begin = 0
    for number, line in enumerate([*source.split("\n"), ""], 1):
        comment = _find_comment(line, spans.get(number, []))
        if comment is not None:
            begin = begin if block else number
            block.append(comment)
        elif block:
            yield Text(begin, _dedent("\n".join(block)))
            block = []


def _spans_of_lines(literals: list[ast.expr]) -> dict[int, list[tuple[int, float]]]:
    """Return the columns, in bytes, that literals cover in each line."""
    spans: dict[int, list[tuple[int, float]]] = {}
    for node in literals:
        last, end = node.end_lineno or node.lineno, node.end_col_offset or 0
        for line in range(node.lineno, last + 1):
            left = node.col_offset if line == node.lineno else 0
            spans.setdefault(line, []).append((left, end if line == last else math.inf))
    return spans


def _find_comment(line: str, spans: list[tuple[int, float]]) -> str | None:
    start = line.find("#")
    while start >= 0:
        column = len(line[:start].encode())
        if not any(left <= column < right for left, right in spans):
            rest = line[start:]
            return None if _PRAGMA.match(rest) else rest.lstrip("# ")
        start = line.find("#", start + 1)
    return None


def _decorator_name(node: ast.expr) -> str:
    if isinstance(node, ast.Call):
        node = node.func
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


def _split_headings(paragraph: str) -> Iterator[tuple[int, str]]:
    part: list[str] = []
    first = 0
    for number, line in enumerate(paragraph.splitlines()):
        if re.match(r"#+ ", line):
            if part:
                yield first, "\n".join(part)
            yield number, line
            part, first = [], number + 1
        else:
            part.append(line)
    if part:
        yield first, "\n".join(part)


def _dedent(text: str) -> str:
    return _INDENT.sub("\n", text)


def _blank(match: re.Match[str]) -> str:
    return "\n" * match.group().count("\n")
