"""Two stores to verdicts, without the engine."""

from contactlab.compare.annotations import as_annotations
from contactlab.compare.comparing import DEFAULT_POLICY, compare, paired
from contactlab.compare.junit import as_junit
from contactlab.compare.markdown import as_markdown
from contactlab.compare.pairing import Pairing
from contactlab.compare.policies import accept, acceptance, read_policy
from contactlab.compare.remeasuring import Remeasure
from contactlab.compare.text import as_text
from contactlab.compare.unreadable import unreadable

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
    "paired",
    "read_policy",
    "unreadable",
]
