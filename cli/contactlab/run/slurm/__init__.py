"""Runs jobs as an array of a SLURM cluster."""
