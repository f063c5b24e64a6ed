"""From a model to the settings to use: search, and the proof that they are as good."""
