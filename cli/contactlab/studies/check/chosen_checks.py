"""The checks that a request names, and what they find, once it is known what is accepted."""

from collections.abc import Sequence
from datetime import UTC, datetime

from contactlab.errors import SweepFileError
from contactlab.judge.acceptances import apply_acceptances
from contactlab.judge.limits import LIMITS
from contactlab.schema.check_report import CheckResult
from contactlab.schema.finding import Acceptance, Finding
from contactlab.studies.check.check_entries import CHECKS
from contactlab.studies.check.check_results import findings_of
from contactlab.writers.report import ORDER


def chosen_checks(only: Sequence[str]) -> list[str]:
    """Return the names of the checks that are wanted; all if none is named.

    Raises:
        SweepFileError: there is no such check.
    """
    for name in only:
        others = f"; there are {', '.join(CHECKS)}"
        SweepFileError.unless_known(name, CHECKS, f"no check '{name}'", others)
    return [name for name in CHECKS if name in only or not only]


def judged_findings(
    results: Sequence[CheckResult], accepted: Sequence[Acceptance]
) -> list[Finding]:
    """Return all findings, those first that fail and are not accepted.

    Raises:
        PolicyError: what is accepted is no finding of any check.
    """
    found = [finding for result in results for finding in findings_of(result)]
    known = {*LIMITS, *(name for check in CHECKS.values() for name in check.findings)}
    judged = apply_acceptances(found, accepted, datetime.now(UTC).date(), known)
    return sorted(judged, key=lambda finding: ORDER.index(finding.outcome))
