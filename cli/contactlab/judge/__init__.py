"""Limits, findings and policies: from numbers and verdicts to a job that passes or fails."""
