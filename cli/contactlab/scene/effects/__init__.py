"""Effects: their definitions, the choice of the effects of a run, and the removal of the others."""
