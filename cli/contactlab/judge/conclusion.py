"""The exit code that findings amount to."""

from collections.abc import Sequence

from contactlab.errors import ContactlabError, ExpectationError, StoreError
from contactlab.schema.finding import Finding


def exit_code(findings: Sequence[Finding]) -> int:
    """Return 0, 1 if a gate fails, or 3 if a gate could not be judged and none fails.

    Stores that differ in a required property come first: other findings have no meaning then.
    """
    opened = [finding.kind for finding in findings if finding.is_open]
    if "evidence" not in opened and failed_names(findings):
        return ExpectationError.exit_code
    return StoreError.exit_code if opened else 0


def failed_names(findings: Sequence[Finding]) -> list[str]:
    """Return the names of the findings that fail the job."""
    return [finding.name for finding in findings if finding.outcome == "failed"]


def error_of(code: int, message: str) -> ContactlabError | None:
    """Return the error that an exit code of a report stands for; None for 0."""
    if not code:
        return None
    return (ExpectationError if code == ExpectationError.exit_code else StoreError)(message)
