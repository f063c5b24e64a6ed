"""A wrapper of environments of Gymnasium, which is an extra, that records their episodes."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from contactlab_loop.environment import Evidence

__all__ = ["Evidence"]


def __getattr__(name: str) -> Any:  # noqa: ANN401 - a class of its own type
    if name not in __all__:
        raise AttributeError(f"module 'contactlab.gymnasium' has no attribute '{name}'")
    from contactlab_loop import environment  # noqa: PLC0415 - only who asks needs the extra

    return environment.Evidence
