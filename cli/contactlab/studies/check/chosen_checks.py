"""The requested checks, and their findings after waivers."""

from collections.abc import Sequence
from datetime import UTC, datetime

from contactlab.errors import SweepFileError
from contactlab.judge.limits import LIMITS
from contactlab.judge.waivers import apply_waivers
from contactlab.schema.check_report import CheckResult
from contactlab.schema.finding import Finding, Waiver
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


def judged_findings(results: Sequence[CheckResult], waivers: Sequence[Waiver]) -> list[Finding]:
    """Return all findings, failed ones without a waiver first.

    Raises:
        PolicyError: a waiver names a finding of no check.
    """
    all_findings = [finding for result in results for finding in findings_of(result)]
    known_names = {*LIMITS, *(name for check in CHECKS.values() for name in check.findings)}
    waived = apply_waivers(all_findings, waivers, datetime.now(UTC).date(), known_names)
    return sorted(waived, key=lambda finding: ORDER.index(finding.outcome))
