"""Successes of episodes: which of them are physical."""
