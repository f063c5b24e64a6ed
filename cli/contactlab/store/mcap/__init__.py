"""Traces in MCAP."""
