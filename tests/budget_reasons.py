"""Makes reasons of a budget."""

from contactlab.schema.error_budget import BudgetReason
from contactlab.schema.verdict import VerdictWord


def budget_reason(
    verdict: VerdictWord, phase: str, row: str, error: float, body: str, place: str
) -> BudgetReason:
    """Return a reason at the start of a phase."""
    return BudgetReason(
        verdict=verdict, phase=phase, row=row, error=error, body=body, place=place, time=0,
        sentence="",
    )  # fmt: skip
