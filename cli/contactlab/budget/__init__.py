"""The error budget: what a run's numerics, its model's softness and each effect are worth."""

from contactlab.budget.backward_error import backward_error
from contactlab.budget.error_budget import error_budget
from contactlab.budget.measuring import Settings, affordable
from contactlab.budget.motion import Motion, motion_of_run
from contactlab.budget.readings import ErrorBudget, PhaseBudget, Reading
from contactlab.budget.remedies import Remedy, Trial, remedies
from contactlab.budget.report import budget_report
from contactlab.budget.rows import ROWS, Row
from contactlab.budget.text import budget_lines
from contactlab.budget.verdict import Reason, Verdict, judge

__all__ = [
    "ROWS",
    "ErrorBudget",
    "Motion",
    "PhaseBudget",
    "Reading",
    "Reason",
    "Remedy",
    "Row",
    "Settings",
    "Trial",
    "Verdict",
    "affordable",
    "backward_error",
    "budget_lines",
    "budget_report",
    "error_budget",
    "judge",
    "motion_of_run",
    "remedies",
]
