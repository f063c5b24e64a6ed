"""Verifies a changed model: nothing that the original does may become worse."""

from contactlab.studies.verification.panel import OriginalRuns as OriginalRuns
from contactlab.studies.verification.panel import VerificationRequest as VerificationRequest
from contactlab.studies.verification.panel import describe_measure as describe_measure
from contactlab.studies.verification.panel import verify_change as verify_change
