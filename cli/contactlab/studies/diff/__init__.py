"""Differences of two models, in numbers and in motion: `contactlab diff A B`."""
