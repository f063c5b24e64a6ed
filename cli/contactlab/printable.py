"""Text from data as an output may hold it: data of a store or a model is shown, never obeyed.

Names, labels and reasons may hold anything: escape sequences, which terminals obey; marks that turn
the direction of reading; commands of a CI job, which are lines of its log; markup, and mentions.
"""

import re
import shlex
import warnings
from collections.abc import Callable, Sequence

# All control characters but tabs and line ends, marks of direction, other line ends, surrogates.
_CONTROL = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)
# GitHub takes commands from lines that start with two colons, older ones from anywhere in a line.
_COMMAND = re.compile(r"^(?P<start>[^\S\n]*):(?=:)|#(?=#\[)", re.MULTILINE)
Replacer = Callable[[str], str]
"""Returns the text to write instead of another one: for an address, its geom's body."""
_MARKUP = "\\|`*_<>[]~$"
# GitHub looks for these in the text that is left when the markup is gone.
_REFERENCE = re.compile(r"[@#]|:(?=//)|\bwww(?=\.)|\bGH(?=-)", re.IGNORECASE)


def visible_or_other(value: object) -> object:
    """Return visible text of plain text, and any other value, such as markup, unchanged."""
    return visible(value) if type(value) is str else value


def visible(text: str) -> str:
    r"""Return text with control characters written out, as in JSON: `\u001b`."""
    return _CONTROL.sub(_escape_character, text)


def shorten_warnings(is_hidden: Callable[[str], bool] = lambda _: False) -> None:
    """Print Python's warnings as text in one line, without lines of source, except hidden ones."""

    def format_warning(message: Warning | str, *_: object) -> str:
        text = str(message)
        return "" if is_hidden(text) else f"warning: {in_one_line(text)}\n"

    warnings.formatwarning = format_warning


def printable(text: str) -> str:
    """Return lines that neither a terminal nor a CI job takes for a command."""
    return _COMMAND.sub(
        lambda match: (match["start"] or "") + _escape_character(match), visible(text)
    )


def in_one_line(text: str) -> str:
    """Return text that is printable and has no line ends."""
    return printable(text.replace("\n", "\\u000a"))


def in_markdown(text: str) -> str:
    """Return text that Markdown shows unchanged, in a cell of a table, and GitHub does not link."""
    plain = " ".join(visible(text).split()).replace("&", "&amp;")
    for sign in _MARKUP:
        plain = plain.replace(sign, f"\\{sign}")
    return _REFERENCE.sub(r"\g<0><!-- -->", plain)


def _escape_character(match: re.Match[str]) -> str:
    return f"\\u{ord(match[0][-1]):04x}"


def shorten_lines(lines: Sequence[str], most: int, rest: str) -> list[str]:
    """Return the first lines, and a last one that says where the rest of them is."""
    more = len(lines) - most
    return list(lines) if more <= 0 else [*lines[:most], f"and {more} more in {rest}"]


def first_names(line: str) -> str:
    """Return `kind: name, name, ...` with the first names, and how many more there are."""
    kind, _, name_list = line.partition(": ")
    names = name_list.split(", ")
    most_names = 12  # of a list in one line
    more = len(names) - most_names
    rest = [f"and {more} more"] if more > 0 else []
    return f"{kind}: {', '.join([*names[:most_names], *rest])}"


def shell_word(text: object) -> str:
    """Return a path or an address as a word of a shell: in quotes where it has a space."""
    return shlex.quote(str(text))
