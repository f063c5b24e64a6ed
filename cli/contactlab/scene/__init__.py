"""From what a sweep names to compiled models: scenes, parameters, engine switches."""
