"""A comparison as text for people."""

from collections.abc import Iterator, Sequence

from contactlab.compare.told import WORDS, Line, labels, passed, runs, side, told
from contactlab.schema import ComparisonReport

_MOST_LINES = 25
_WIDEST = 60


def as_text(report: ComparisonReport) -> str:
    """Return a comparison as lines of plain text, the worst first."""
    return "\n".join(line.rstrip() for line in _lines(report)) + "\n"


def _lines(report: ComparisonReport) -> Iterator[str]:
    yield report.headline
    if report.baseline is None or report.candidate is None:
        return
    yield ""
    yield f"  baseline   {side(report.baseline)}"
    yield f"  candidate  {side(report.candidate)}"
    yield f"  runs       {runs(report)}"
    for each in labels(report):
        yield f"  label      {each}"
    yield ""
    yield from _table(told(report))
    yield f"{WORDS['passed']:4}  {passed(report)}"
    if report.advice:
        yield ""
        yield from report.advice


def _table(lines: Sequence[Line]) -> Iterator[str]:
    shown: list[Line] = []
    for outcome, word in WORDS.items():
        of_it = [line for line in lines if line.outcome == outcome]
        shown += of_it[:_MOST_LINES]
        if len(of_it) > _MOST_LINES:
            more = f"and {len(of_it) - _MOST_LINES:,} more ({word})"
            shown.append(Line(outcome, more, "", "", ""))
    names, found, worst = (
        min(max((len(str(line[column])) for line in shown), default=0), _WIDEST)
        for column in (1, 2, 3)
    )
    for line in shown:
        start = f"{WORDS[line.outcome]:4}  {line.name:{names}}  {line.found:{found}}"
        yield f"{start}  {line.worst:{worst}}  {line.where}"
