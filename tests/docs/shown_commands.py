"""Command lines of contactlab that files of the project show, wherever they stand in them."""

import ast
import json
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

# Files that people or machines take commands from. Tests have lines that are wrong on purpose; the
# changelog has lines of former versions.
PLACES = (
    "*.md",
    "*.yml",
    "*.yaml",
    "Makefile",
    ".ci/*",
    ".github/**/*",
    "bench/**/*.py",
    "cli/contactlab/**/*.py",
    "docs/**/*.md",
    "docs/**/*.py",
    "examples/**/*",
    "models/**/*.yaml",
    "sweeps/**/*.yaml",
)
FORMER = frozenset({"CHANGELOG.md"})
HOLE = "\0"
"""Stands in a word for a part that is known only when the text is used."""
_NAME = "contactlab"
# Words that may stand before a command in the shell; their options and values go with them.
_BEFORE = frozenset({"!", "do", "else", "env", "exec", "if", "nice", "parallel", "srun", "then"})
_WAITING = frozenset({"time", "timeout", "until", "while", "xargs"})
_ENDS = frozenset({"|", "||", "&", "&&", ";", ";;", "(", ")", "<", ">", ">>", "<<", ">&", "&>"})
_FENCE = re.compile(r"^ *```(\w*)[^\n]*\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
_SHELLS = frozenset({"", "bash", "console", "sh", "text", "yaml", "yml"})
_SPAN = re.compile(r"(?<!`)`(contactlab [^`]+)`(?!`)")
# Keys of YAML whose value is a line of the shell.
_KEY = re.compile(r"^(\s*)(?:- +)?(?:entry|run): +(?![|>])")


@dataclass(frozen=True)
class ShownCommand:
    """The words after `contactlab` of a command line, and where it stands.

    A mention in a sentence may leave out arguments, as may the entry of a hook, which files follow.
    """

    file: str
    line: int
    words: tuple[str, ...]
    mention: bool = False

    def __str__(self) -> str:
        """Return place and words."""
        words = " ".join(self.words).replace(HOLE, "{}")
        return f"{self.file}:{self.line}: {_NAME} {words}"


def shown_commands(root: Path) -> list[ShownCommand]:
    """Return the command lines that files of a checkout show, in their order."""
    files = {file for place in PLACES for file in root.glob(place) if file.is_file()}
    return [
        shown
        for file in sorted(files)
        if file.name not in FORMER
        for shown in commands_in(file, file.relative_to(root).as_posix())
    ]


def commands_in(file: Path, name: str) -> Iterator[ShownCommand]:
    """Yield the command lines that a file shows, which is named so in what is said of it."""
    text = _read(file)
    if file.suffix == ".md":
        yield from _in_markdown(text, name)
    elif file.suffix == ".py":
        yield from _in_python(text, name)
    elif file.suffix == ".ipynb":
        for cell in json.loads(text)["cells"]:
            source = "".join(cell["source"])
            read = _in_markdown if cell["cell_type"] == "markdown" else _in_notebook_code
            yield from read(source, name)
    else:
        yield from _in_shell(text, name)
        yield from _mentions(text, name)


def _read(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except UnicodeDecodeError:  # a picture
        return ""


def _in_markdown(text: str, name: str) -> Iterator[ShownCommand]:
    for fence in _FENCE.finditer(text):
        if fence[1] in _SHELLS:
            yield from _in_shell(fence[2], name, _line_of(text, fence.start(2)))
    # Of equal length, so that lines are counted as in the file.
    prose = _FENCE.sub(lambda fence: re.sub(r"[^\n]", " ", fence[0]), text)
    yield from _mentions(prose, name)


def _mentions(text: str, name: str, line: int = 1) -> Iterator[ShownCommand]:
    for span in _SPAN.finditer(text):
        place = line + text.count("\n", 0, span.start())
        words = " ".join(span[1].replace("\\|", "|").split())
        for shown in _in_shell(words, name, place):
            yield ShownCommand(shown.file, shown.line, shown.words, mention=True)


def _in_notebook_code(text: str, name: str) -> Iterator[ShownCommand]:
    lines = [line[1:] if line.startswith("!") else "" for line in text.split("\n")]
    yield from _in_shell("\n".join(lines), name)


def _in_python(text: str, name: str) -> Iterator[ShownCommand]:
    if f"{_NAME} " not in text:  # as in most modules, which would take seconds to parse
        return
    nodes = [*ast.walk(ast.parse(text))]
    inner = {part for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in nodes:
        said = None if node in inner else _text(node)
        if said is not None and _NAME in said:
            line = getattr(node, "lineno", 1)
            yield from _mentions(said, name, line)
            yield from _indented(said, name, line)


def _text(node: ast.AST) -> str | None:
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        return "".join(_text(part) or HOLE for part in node.values)
    return None


def _indented(text: str, name: str, line: int) -> Iterator[ShownCommand]:
    """Yield the command lines that stand by themselves in a text, indented."""
    for number, row in enumerate(text.split("\n")):
        if row.startswith("    ") and row.strip().startswith(f"{_NAME} "):
            yield from _in_shell(row.strip(), name, line + number)


def _line_of(text: str, place: int) -> int:
    return 1 + text.count("\n", 0, place)


def _in_shell(text: str, name: str, line: int = 1) -> Iterator[ShownCommand]:
    """Yield the command lines of a script, of lines of the shell, or of YAML that holds some."""
    rows = text.split("\n")
    number = 0
    while number < len(rows):
        first, row = number, rows[number]
        while row.endswith("\\") and number + 1 < len(rows):
            number += 1
            row = row[:-1] + " " + rows[number].strip()
        number += 1
        code, _, comment = row.partition("#") if row.lstrip().startswith("#") else (row, "", "")
        if comment.startswith("  "):  # code that is a comment is indented
            code = comment
        if _NAME in code:
            hook = code.strip().startswith("entry:")
            for words in _simple_commands(_KEY.sub(r"\1", code).strip()):
                yield ShownCommand(name, line + first, tuple(words), mention=hook)


def _simple_commands(row: str) -> Iterator[list[str]]:
    """Yield the words after `contactlab` of each command of a line of the shell."""
    row = row.removeprefix("$ ").removeprefix("\t").lstrip("@")
    # What a substitution gives is not known; its own commands are of the shell.
    row = re.sub(r"\$\((?!\w+\))[^()]*\)", HOLE, row)
    row = re.sub(r"\$\((\w+)\)|\$\{[^}]*\}|\$\{\{[^}]*\}\}", lambda held: held[1] or HOLE, row)
    reader = shlex.shlex(row, posix=True, punctuation_chars="|&;()<>")
    reader.commenters = "#"
    reader.whitespace_split = True
    try:
        words = list(reader)
    except ValueError:  # a sentence with an apostrophe
        words = row.split()
    simple = list[str]()
    for word in [*words, ";"]:
        if word in _ENDS or word.strip("|&;()<>") == "":
            yield from _own(simple)
            simple = []
        else:
            simple.append(word)


def _own(simple: list[str]) -> Iterator[list[str]]:
    """Yield the words after `contactlab` of a simple command, if it is one of contactlab."""
    for place, word in enumerate(simple):
        if word.rpartition("/")[2] == _NAME and len(simple) > place + 1:
            before = [each for each in simple[:place] if "=" not in each]
            if not before or before[0] in _BEFORE | _WAITING:
                yield simple[place + 1 :]
            return
