"""A comparison as Markdown, for a job summary or a comment."""

from collections.abc import Iterator, Sequence

from contactlab.compare.told import WORDS, Line, labels, passed, runs, side, told
from contactlab.schema import ComparisonReport

MOST_BYTES = 900_000
"""A job summary of more than 1 MiB is lost."""
_MOST_FIRST = 12
_MOST_LINES = 1_000
_SIGNS = {"failed": "❌", "skipped": "⚪", "warned": "⚠️", "noted": "ℹ️", "passed": "✅"}  # noqa: RUF001
_HEAD = ("| | check | found | worst | where |", "|---|---|---|---|---|")


def as_markdown(report: ComparisonReport) -> str:
    """Return a comparison as Markdown of less than 0.9 MB: the verdict, then what to look at."""
    lines: list[str] = []
    left = MOST_BYTES - 1_000
    for line in _lines(report):
        left -= len(line.encode()) + 1
        if left < 0:
            lines.append("\nThere is more; this is as much as a job summary holds.\n")
            break
        lines.append(line)
    return "\n".join(lines) + "\n"


def _lines(report: ComparisonReport) -> Iterator[str]:
    sign = _SIGNS["passed" if report.exit_code == 0 else "failed"]
    yield f"### {sign} {_escaped(report.headline)}"
    if report.baseline is None or report.candidate is None:
        return
    yield ""
    yield f"- baseline {_escaped(side(report.baseline))}"
    yield f"- candidate {_escaped(side(report.candidate))}"
    yield f"- runs: {_escaped(runs(report))}"
    if labels(report):
        yield f"- labels: {_escaped(', '.join(labels(report)))}"
    found = told(report)
    urgent = [line for line in found if line.urgent]
    first = urgent[:_MOST_FIRST]
    rest = [*urgent[_MOST_FIRST:], *(line for line in found if not line.urgent)]
    yield from _table(first)
    yield ""
    yield f"{_SIGNS['passed']} {passed(report)}"
    yield from _folded(f"{len(rest)} more", list(_table(rest))) if rest else ()
    advice = ["", "```sh", *(line.replace("`", "'") for line in _commands(report.advice)), "```"]
    yield from _folded("commands", advice) if report.advice else ()


def _table(lines: Sequence[Line]) -> Iterator[str]:
    if not lines:
        return
    yield ""
    yield from _HEAD
    for line in lines[:_MOST_LINES]:
        cells = (_SIGNS[line.outcome], *(_escaped(cell) for cell in line[1:5]))
        yield f"| {' | '.join(cells)} |"
    if len(lines) > _MOST_LINES:
        yield f"| | and {len(lines) - _MOST_LINES:,} more | | | |"


def _folded(title: str, lines: Sequence[str]) -> Iterator[str]:
    yield ""
    yield f"<details><summary>{title}</summary>"
    yield from lines
    yield ""
    yield "</details>"


def _commands(advice: Sequence[str]) -> Iterator[str]:
    for each in advice:
        what, _, command = each.partition(": ")
        yield f"# {what}"
        yield command


def _escaped(text: str) -> str:
    """Return text that Markdown shows as it is, in one line of a table."""
    plain = " ".join(text.split()).replace("\\", "\\\\")
    for sign in "|`*_<>[]#~$":
        plain = plain.replace(sign, f"\\{sign}")
    return plain


assert set(_SIGNS) == set(WORDS)
