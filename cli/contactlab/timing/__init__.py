"""The one clock: models take turns, and their ratios of times have intervals."""
