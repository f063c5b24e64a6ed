"""A store as a page or as figures, without the engine."""
