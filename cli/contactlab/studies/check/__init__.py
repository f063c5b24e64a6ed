"""Checks of a model, by published guidelines, and what to change where it fails."""
