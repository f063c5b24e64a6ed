"""A wrapper that records the episodes of environments; it needs Gymnasium, which is an extra."""

from contactlab.loop.environment import Evidence
from contactlab.parts import register_parts

__all__ = ["Evidence"]
register_parts()
