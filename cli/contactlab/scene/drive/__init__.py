"""Drives of runs: controls that hold a posture, noise, exercises, recorded controls."""
