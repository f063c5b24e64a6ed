"""Words and signs of outcomes: text has the word, Markdown the sign."""

from contactlab.rendering.document import Mark
from contactlab.schema.finding import Outcome

_MARKS: dict[Outcome, Mark] = {
    "failed": Mark("FAIL", "❌"),
    "skipped": Mark("SKIP", "⚪"),
    "warned": Mark("WARN", "⚠️"),
    "noted": Mark("note", "ℹ️"),  # noqa: RUF001 - the sign of a note
    "passed": Mark("ok", "✅"),
}
ORDER: tuple[Outcome, ...] = tuple(_MARKS)
"""Outcomes, the worst first."""


def outcome_mark(outcome: Outcome) -> Mark:
    """Return the mark of an outcome."""
    return _MARKS[outcome]
