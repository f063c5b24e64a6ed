"""A plug-in: one metric with its label, one oracle, one engine."""
