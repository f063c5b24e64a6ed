"""Reliability of derivatives of a simulation through contact."""
