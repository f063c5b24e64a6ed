"""Outcomes that a repository keeps in a small file, and the MuJoCo release that changed some."""
