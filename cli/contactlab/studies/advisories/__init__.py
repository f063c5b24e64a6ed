"""Replays witnesses of advisories under releases of MuJoCo."""
