"""Scenes, parameters and engine switches: from the names in a sweep to compiled models."""
