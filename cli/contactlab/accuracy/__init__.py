"""Distance of runs from the limit of small timesteps, and their own cost."""
