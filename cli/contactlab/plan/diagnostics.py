"""Mistakes as data and as text: the problem, its place, and the correct form."""

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from contactlab.errors import SweepFileError

Severity = Literal["error", "warning"]
MOST_SHOWN_MISTAKES = 50
"""More mistakes of one file are counted, not printed: they fill a screen and have one origin."""


@dataclass(frozen=True)
class SourceText:
    """A text with located mistakes: its path or another name for the user, and its lines.

    Lines of a file are numbered. The line number of a command-line argument would not help.
    """

    name: str
    lines: tuple[str, ...] = field(hash=False)  # a mistake would take the time of a whole text
    numbered: bool = True

    def line_at(self, number: int) -> str:
        """Return a line by its number, from 1; empty if the text has no such line."""
        return self.lines[number - 1] if 0 < number <= len(self.lines) else ""


@dataclass(frozen=True)
class Place:
    """A range of characters in one line; line and column count from 1."""

    source: SourceText
    line: int
    column: int
    width: int = 1

    @property
    def text(self) -> str:
        """Its whole line."""
        return self.source.line_at(self.line)

    @property
    def spot(self) -> str:
        """A short text that locates it."""
        return f"in line {self.line}" if self.source.numbered else f"in `{self.text}`"

    def narrow_range(self, start: int, width: int) -> "Place":
        """Return a part of the range; `start` counts from its first character."""
        return Place(self.source, self.line, self.column + start, max(width, 1))

    def __str__(self) -> str:
        if not self.source.numbered:
            return f"{self.source.name}, column {self.column}"
        return f"{self.source.name}:{self.line}:{self.column}"


@dataclass(frozen=True)
class Diagnostic:
    """One mistake in a sweep file or option; the code is its kind, in words joined by dashes.

    The hint gives the correct form. An error stops the sweep, a warning does not.
    """

    code: str
    message: str
    place: Place
    hint: str = ""
    severity: Severity = "error"

    def __str__(self) -> str:
        head = f"{self.severity}[{self.code}]: {self.message}"
        number = str(self.place.line) if self.place.source.numbered else ""
        margin = " " * len(number)
        line, start, width = _cut_line(self.place)
        before = "".join(
            "\t" if character == "\t" else " " * _terminal_width(character)
            for character in line[:start]
        )
        caret = before + "^" * max(_terminal_width(line[start : start + width]), 1)
        return "\n".join(
            [
                head,
                f"{margin} --> {self.place}",
                f"{margin} |",
                f"{number} | {line}".rstrip(),
                f"{margin} | {caret} {self.hint}".rstrip(),
            ]
        )


class SweepMistakesError(SweepFileError):
    """All mistakes of a sweep file and its options, warnings included, in order of place."""

    def __init__(self, diagnostics: Sequence[Diagnostic]) -> None:
        self.diagnostics = tuple(diagnostics)
        texts = [str(diagnostic) for diagnostic in self.diagnostics[:MOST_SHOWN_MISTAKES]]
        more = len(self.diagnostics) - len(texts)
        super().__init__("\n\n".join([*texts, f"and {more:,} more"] if more else texts))


def _cut_line(place: Place) -> tuple[str, int, int]:
    # A long line is cut around the place; the start is that in the cut line.
    line, start = place.text, place.column - 1
    width = max(min(place.width, len(line) - start), 1)
    excerpt_length = 100
    if len(line) <= excerpt_length:
        return line, start, width
    first = max(0, min(start - excerpt_length // 3, len(line) - excerpt_length))
    excerpt = line[first : first + excerpt_length]
    before = "..." if first else ""
    after = "..." if first + excerpt_length < len(line) else ""
    width = min(width, first + excerpt_length - start)
    return before + excerpt + after, start - first + len(before), width


def _terminal_width(text: str) -> int:
    wide = sum(unicodedata.east_asian_width(character) in "WF" for character in text)
    return len(text) + wide - sum(unicodedata.combining(character) != 0 for character in text)
