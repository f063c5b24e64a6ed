"""What practice checks of a model before it is trusted, and what to change where it fails."""

from contactlab.pipeline.check.checking import CHECKS, PAGE, REPORT, CheckAsk, check_model

__all__ = ["CHECKS", "PAGE", "REPORT", "CheckAsk", "check_model"]
