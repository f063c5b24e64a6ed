"""Mistakes as data and as text: what is wrong, where, and what to write instead."""

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from contactlab.errors import SweepFileError

Severity = Literal["error", "warning"]
_EXCERPT = 100
_MOST_MISTAKES_SHOWN = 50


@dataclass(frozen=True)
class SourceText:
    """A text in which mistakes are located: a path or what the user calls it, and its lines.

    Lines of a file are numbered; of one command-line argument, their number would not help.
    """

    name: str
    lines: tuple[str, ...]
    numbered: bool = True

    def line(self, number: int) -> str:
        """Return a line by its number, from 1; empty if there is none."""
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
        """The whole line."""
        return self.source.line(self.line)

    @property
    def spot(self) -> str:
        """Where it is, in a few words."""
        return f"in line {self.line}" if self.source.numbered else f"in `{self.text}`"

    def part(self, start: int, width: int) -> "Place":
        """Return a part of the range; `start` counts from its first character."""
        return Place(self.source, self.line, self.column + start, max(width, 1))

    def __str__(self) -> str:
        if not self.source.numbered:
            return f"{self.source.name}, column {self.column}"
        return f"{self.source.name}:{self.line}:{self.column}"


@dataclass(frozen=True)
class Diagnostic:
    """One mistake in a sweep file or option; the code is its kind, in words joined by dashes.

    The hint says what to write instead. An error stops the sweep, a warning does not.
    """

    code: str
    message: str
    place: Place
    hint: str = ""
    severity: Severity = "error"

    def __str__(self) -> str:
        head = f"{self.severity}[{self.code}]: {self.message}"
        return "\n".join([head, *_excerpt(self.place, self.hint)])


class SweepMistakesError(SweepFileError):
    """All mistakes of a sweep file and its options, warnings included, in order of place."""

    def __init__(self, diagnostics: Sequence[Diagnostic]) -> None:
        self.diagnostics = tuple(diagnostics)
        texts = [str(diagnostic) for diagnostic in self.diagnostics[:_MOST_MISTAKES_SHOWN]]
        more = len(self.diagnostics) - len(texts)
        super().__init__("\n\n".join([*texts, f"and {more:,} more"] if more else texts))


def _excerpt(place: Place, hint: str) -> list[str]:
    number = str(place.line) if place.source.numbered else ""
    margin = " " * len(number)
    line, start, width = _window(place)
    before = "".join(
        "\t" if character == "\t" else " " * _cells(character) for character in line[:start]
    )
    caret = before + "^" * max(_cells(line[start : start + width]), 1)
    return [
        f"{margin} --> {place}",
        f"{margin} |",
        f"{number} | {line}".rstrip(),
        f"{margin} | {caret} {hint}".rstrip(),
    ]


def _window(place: Place) -> tuple[str, int, int]:
    """Return the line, cut to what surrounds the place if long, and where the place is in it."""
    line, start = place.text, place.column - 1
    width = max(min(place.width, len(line) - start), 1)
    if len(line) <= _EXCERPT:
        return line, start, width
    first = max(0, min(start - _EXCERPT // 3, len(line) - _EXCERPT))
    excerpt = line[first : first + _EXCERPT]
    before = "..." if first else ""
    after = "..." if first + _EXCERPT < len(line) else ""
    width = min(width, first + _EXCERPT - start)
    return before + excerpt + after, start - first + len(before), width


def _cells(text: str) -> int:
    """Return the width of a text in columns of a terminal."""
    wide = sum(unicodedata.east_asian_width(character) in "WF" for character in text)
    return len(text) + wide - sum(unicodedata.combining(character) != 0 for character in text)
