"""Checks that fail and are accepted, with a reason and up to a day."""

from collections.abc import Iterable, Sequence
from datetime import date

from contactlab.errors import PolicyError, did_you_mean
from contactlab.schema import AcceptedCheck, Check


def with_accepted(
    checks: Sequence[Check], accepted: Iterable[AcceptedCheck], today: date
) -> list[Check]:
    """Return the checks, failed ones that an entry accepts being only told.

    Raises:
        PolicyError: an entry names a check that there is not.
    """
    names = {check.name for check in checks}
    entries = list(accepted)
    for entry in entries:
        if entry.check not in names:
            hint = did_you_mean(entry.check, names)
            raise PolicyError(f"the policy accepts '{entry.check}', which is no check{hint}")
    return [_judged(check, entries, today) for check in checks]


def _judged(check: Check, entries: Sequence[AcceptedCheck], today: date) -> Check:
    if check.outcome not in {"failed", "warned"}:
        return check
    for entry in entries:
        if entry.check == check.name and entry.group in {None, check.group}:
            if obstacle := _obstacle(entry, check, today):
                return check.model_copy(update={"message": f"{check.message}; {obstacle}"})
            return check.model_copy(update={"outcome": "noted", "accepted": entry.reason})
    return check


def _obstacle(entry: AcceptedCheck, check: Check, today: date) -> str | None:
    if entry.until is not None and entry.until < today:
        return f"accepted until {entry.until} ({entry.reason})"
    if check.failing > entry.max:
        return f"accepted for {entry.max:,}, but {check.failing:,} fall short ({entry.reason})"
    return None
