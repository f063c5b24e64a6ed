"""The verdict of a model: one word, which every report, page and file has."""

from typing import Literal, get_args

VerdictWord = Literal["inaccurate", "undecided", "fails", "depends", "ok"]
"""The worst comes first.

`inaccurate`: the numerical error is above the tolerance. `undecided`: the reference has not
converged. `fails`: a failure label holds, or a check fails. `depends`: the numerics are fine, but a
modeling choice decides. `ok`: none of these.
"""

VERDICT_ORDER: tuple[VerdictWord, ...] = get_args(VerdictWord)
"""All words, the worst first."""

PASSING_VERDICTS: frozenset[VerdictWord] = frozenset({"ok", "depends"})
"""Verdicts of a command that exits with 0: a modeling choice may be intended."""


def join_verdict(numerics: VerdictWord, *, failing: bool) -> VerdictWord:
    """Return the verdict of numerics with failing labels, checks or files."""
    return "fails" if failing and numerics in PASSING_VERDICTS else numerics
