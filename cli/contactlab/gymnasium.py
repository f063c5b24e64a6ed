"""A wrapper of environments of Gymnasium, which records their episodes."""

from contactlab_loop.environment import Evidence

__all__ = ["Evidence"]
