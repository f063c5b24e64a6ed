"""Words that commands print: from declarations in code, and from what small runs printed."""

import ast
import json
import re
from collections.abc import Iterator, Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, cast

import contactlab
from contactlab.studies.explain.definitions import define_word

PACKAGE = Path(contactlab.__file__).parent
REPOSITORY = Path(__file__).parents[2]
# Schemas of files that people write; those of reports and stores have words that commands print.
_INPUTS = {"sweep", "scene", "policy"}
# Values that are units, not words.
_UNITS = {"1", "m", "rad"}
_PRINTERS = {"print_table", "table_of", "Column", "Listing"}
_HEADS = {"header", "headings"}
# Columns whose cells are words of contactlab, in any table; others hold names of the user.
WORD_COLUMNS = {"label", "verdict", "outcome", "severity", "metric", "threshold", "role", "figure"}


def schema_words(folder: Path = REPOSITORY / "schemas") -> dict[str, str]:
    """Return every word that a field of a report may have, with the field."""
    words = dict[str, str]()
    for file in sorted(folder.glob("*.schema.json")):
        name = file.name.removesuffix(".schema.json")
        if name not in _INPUTS:
            schema = json.loads(file.read_text(encoding="utf-8"))
            words |= {word: f"{name}.{field}" for field, word in _enumerated(schema, "")}
    return {word: place for word, place in words.items() if word not in _UNITS}


def _enumerated(node: Any, field: str) -> Iterator[tuple[str, str]]:
    if isinstance(node, list):
        for each in cast("list[Any]", node):
            yield from _enumerated(each, field)
    elif isinstance(node, dict):
        known = cast("dict[str, Any]", node)
        for word in [*known.get("enum", ()), known.get("const")]:
            if isinstance(word, str):
                yield field, word
        for key, value in known.items():
            if key not in {"enum", "const"}:
                yield from _enumerated(value, field if key in {"anyOf", "items"} else key)


def head_words(folder: Path = PACKAGE) -> dict[str, str]:
    """Return the heads of all tables that code declares, with their modules."""
    trees = {path: ast.parse(text) for path, text in _texts_with_tables(folder).items()}
    functions: dict[str, list[ast.FunctionDef]] = {}
    for tree in trees.values():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef):
                functions.setdefault(node.name, []).append(node)
    words = dict[str, str]()
    for path, tree in trees.items():
        for node in ast.walk(tree):
            for head in _heads(node, functions):
                words |= dict.fromkeys(_texts(head), str(path.relative_to(folder)))
    return {word: place for word, place in words.items() if word}


def _texts_with_tables(folder: Path) -> dict[Path, str]:
    """Return the modules that declare heads of tables: few of many, since parsing takes a while."""
    texts = {path: path.read_text(encoding="utf-8") for path in folder.rglob("*.py")}
    printers = rf"\b({'|'.join(_PRINTERS)})\("
    words = re.compile(
        "|".join([printers, "_HEADS = ", *(rf"\b{head}\b" for head in _HEADS), r"\), \["])
    )
    return {path: text for path, text in texts.items() if words.search(text)}


def _heads(node: ast.AST, functions: dict[str, list[ast.FunctionDef]]) -> Iterator[ast.expr]:
    """Yield the expressions that are heads of a table."""
    if isinstance(node, ast.Assign) and any(
        isinstance(target, ast.Name) and _names_heads(target.id) for target in node.targets
    ):
        yield node.value
    if not isinstance(node, ast.Call):
        return
    yield from (keyword.value for keyword in node.keywords if keyword.arg == "header")
    if not (isinstance(node.func, ast.Name) and node.func.id in _PRINTERS and node.args):
        return
    first = node.args[0]
    if not isinstance(first, ast.Starred):
        yield first
        return
    for call in ast.walk(first):
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name):
            for function in functions.get(call.func.id, ()):
                yield from _returned_heads(function)


def _names_heads(name: str) -> bool:
    return name in _HEADS or name.endswith("_HEADS")


def _returned_heads(function: ast.FunctionDef) -> Iterator[ast.expr]:
    """Yield the first parts of the tuples that a function returns: heads, before rows."""
    for node in ast.walk(function):
        if isinstance(node, ast.Return) and isinstance(node.value, ast.Tuple):
            yield node.value.elts[0]


def _texts(node: ast.expr) -> Iterator[str]:
    """Yield the constant texts of a tuple or list, which may have other parts too."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.Tuple | ast.List):
        for each in node.elts:
            yield from _texts(each.value if isinstance(each, ast.Starred) else each)


class _PageWords(HTMLParser):
    """Texts of the heads of tables and of terms of lists in a page."""

    def __init__(self) -> None:
        super().__init__()
        self.words: list[str] = []
        self._depth = 0

    def handle_starttag(self, tag: str, attrs: Sequence[tuple[str, str | None]]) -> None:
        del attrs
        if tag in {"th", "dt"}:
            self._depth += 1
            self.words.append("")

    def handle_endtag(self, tag: str) -> None:
        self._depth -= tag in {"th", "dt"}

    def handle_data(self, data: str) -> None:
        if self._depth:
            self.words[-1] += data


def page_words(page: str) -> list[str]:
    """Return the heads of tables and the terms of lists in a page, or in its template."""
    parser = _PageWords()
    parser.feed(re.sub(r"\{#.*?#\}|\{%.*?%\}", "", page, flags=re.DOTALL))
    return [" ".join(word.split()) for word in parser.words if word.strip() and "{{" not in word]


def table_words(header: Sequence[str], rows: Sequence[Sequence[object]]) -> Iterator[str]:
    """Yield the words of a printed table: its heads, and cells that hold contactlab's words."""
    yield from filter(None, header)
    for place, head in enumerate(header):
        if head in WORD_COLUMNS:
            yield from {str(row[place]) for row in rows} - {"", "-"}


def definition_text(word: str) -> str:
    """Return every meaning of a word, line by line."""
    meanings = define_word(word)
    return "\n\n".join("\n".join((each.title, *each.texts)) for each in meanings)
