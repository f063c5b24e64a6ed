"""Examines a model's simulation under its task: `contactlab examine MODEL`."""
