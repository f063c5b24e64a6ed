"""Two stores to verdicts, without the engine."""

from contactlab.comparison.ci_output import as_annotations, as_junit, as_markdown
from contactlab.comparison.compare_stores import (
    DEFAULT_POLICY,
    compare,
    pair_stores,
    unreadable_report,
)
from contactlab.comparison.pairing import Pairing
from contactlab.comparison.policies import accept, acceptance, read_policy
from contactlab.comparison.remeasured_time import Remeasure
from contactlab.comparison.report_lines import as_text

__all__ = [
    "DEFAULT_POLICY",
    "Pairing",
    "Remeasure",
    "accept",
    "acceptance",
    "as_annotations",
    "as_junit",
    "as_markdown",
    "as_text",
    "compare",
    "pair_stores",
    "read_policy",
    "unreadable_report",
]
