"""Loops over MuJoCo's steps that somebody else makes, recorded as runs of a store."""
