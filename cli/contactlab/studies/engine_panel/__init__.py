"""Comparison of engines on tasks with a known closed form."""
