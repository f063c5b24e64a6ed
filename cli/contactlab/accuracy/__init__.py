"""How far runs are from the limit of small timesteps, and what they cost by themselves."""
