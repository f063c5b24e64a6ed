"""The error budget: errors of the numerics, and of each modeling choice and effect."""

from contactlab.budget.backward_error import backward_error
from contactlab.budget.counted_time import plan_budget as plan_budget
from contactlab.budget.error_budget import error_budget
from contactlab.budget.fixes import Trial, TriedFix, try_fixes
from contactlab.budget.measuring import Settings as Settings
from contactlab.budget.motion import Motion, motion_of_run
from contactlab.budget.readings import ErrorBudget, PhaseBudget, Reading
from contactlab.budget.report import budget_report
from contactlab.budget.verdict import Verdict, judge

__all__ = [
    "ErrorBudget",
    "Motion",
    "PhaseBudget",
    "Reading",
    "Settings",
    "Trial",
    "TriedFix",
    "Verdict",
    "backward_error",
    "budget_report",
    "error_budget",
    "judge",
    "motion_of_run",
    "plan_budget",
    "try_fixes",
]
