"""Failing checks that are known and accepted."""

from collections.abc import Collection, Sequence
from datetime import date
from typing import TypeVar

from contactlab.errors import PolicyError, did_you_mean
from contactlab.schema.judged_check import AcceptedCheck, JudgedCheck

_Check = TypeVar("_Check", bound=JudgedCheck)
_FAILING = {"failed", "warned"}


def apply_acceptances(
    checks: Sequence[_Check],
    accepted: Sequence[AcceptedCheck],
    today: date,
    known: Collection[str] = (),
) -> list[_Check]:
    """Return the checks; those that fail and are accepted become notes.

    Entries may also name checks that are known, but were not made this time.

    Raises:
        PolicyError: an entry names a check that does not exist.
    """
    names = {*known, *(check.name for check in checks)}
    for entry in accepted:
        if entry.check not in names:
            hint = did_you_mean(entry.check, names)
            raise PolicyError(f"the policy accepts '{entry.check}', which is not a check{hint}")
    return [_accepted(check, accepted, today) for check in checks]


def stale_acceptances(
    checks: Sequence[JudgedCheck], accepted: Sequence[AcceptedCheck]
) -> list[AcceptedCheck]:
    """Return the entries whose check was made, and does not fail."""
    made = {check.name for check in checks if check.outcome != "skipped"}
    return [
        entry
        for entry in accepted
        if entry.check in made
        and not any(
            check.outcome in _FAILING or check.accepted for check in checks if _covers(entry, check)
        )
    ]


def _covers(entry: AcceptedCheck, check: JudgedCheck) -> bool:
    return entry.check == check.name and entry.group in {None, check.group}


def _accepted(check: _Check, entries: Sequence[AcceptedCheck], today: date) -> _Check:
    if check.outcome not in _FAILING:
        return check
    for entry in entries:
        if _covers(entry, check):
            if obstacle := _obstacle(entry, check, today):
                return check.model_copy(update={"message": f"{check.message}; {obstacle}"})
            return check.model_copy(update={"outcome": "noted", "accepted": entry.reason})
    return check


def _obstacle(entry: AcceptedCheck, check: JudgedCheck, today: date) -> str | None:
    """Return why an entry does not cover a failing check; None if it does."""
    if entry.until is not None and entry.until < today:
        return f"accepted until {entry.until} ({entry.reason})"
    if check.failing > entry.max:
        return f"accepted for {entry.max:,}, but {check.failing:,} fall short ({entry.reason})"
    return None
