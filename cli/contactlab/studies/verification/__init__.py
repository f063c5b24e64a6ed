"""Verifies a changed model: no measure may become worse than that of the original."""

from contactlab.studies.verification.loop_runs import has_policy as has_policy
from contactlab.studies.verification.panel import OriginalRuns as OriginalRuns
from contactlab.studies.verification.panel import Verification as Verification
from contactlab.studies.verification.panel import VerificationRequest as VerificationRequest
from contactlab.studies.verification.panel import count_labels as count_labels
from contactlab.studies.verification.panel import verify_change as verify_change
