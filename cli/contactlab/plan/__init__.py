"""Reads sweep files and plans their runs; reads other YAML files as models."""
