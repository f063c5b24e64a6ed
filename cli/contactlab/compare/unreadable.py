"""The report of stores that cannot be compared at all."""

import numpy as np

from contactlab.compare.checks import Subject, made
from contactlab.compare.verdicts import NOT_COMPARABLE, SAME
from contactlab.errors import ContactlabError
from contactlab.schema import Check, ComparePolicy, ComparisonReport, PairCounts

COMPARABLE = Subject("stores can be compared", "evidence", "gate")
_NONE = PairCounts(paired=0, missing=0, new=0, bitwise_equal=0, knife_edge=0, knife_edge_flipped=0)


def unreadable(error: ContactlabError, policy: ComparePolicy) -> ComparisonReport:
    """Return a report that says why there was nothing to compare."""
    verdict = np.full(1, NOT_COMPARABLE, dtype=np.int8)
    check = made(COMPARABLE, verdict, str(error), runs=0)
    return ComparisonReport(
        verdict="not comparable",
        exit_code=error.exit_code,
        headline=f"not comparable: {error}",
        baseline=None,
        candidate=None,
        match=policy.match,
        pairs=_NONE,
        differences=(),
        transitions=(),
        checks=(check,),
        advice=(),
    )


def readable() -> Check:
    """Return the check of stores that can be compared, which all other reports have."""
    return made(COMPARABLE, np.full(1, SAME, dtype=np.int8), "both are sound", runs=0)
