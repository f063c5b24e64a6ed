"""Engines beside each other on tasks whose closed form is known."""
