"""Distance of runs from the limit of small timesteps, and the cost of single runs."""
