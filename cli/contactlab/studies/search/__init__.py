"""Settings of a model, searched by time and error budget: `tune`, and `tradeoff` of a model."""
