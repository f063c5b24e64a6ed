"""A wrapper that records the episodes of environments; it needs Gymnasium, which is an extra."""

from contactlab.loop.environment import Evidence

__all__ = ["Evidence"]
