"""All that a plug-in needs: decorators, and the arguments and results of its functions.

docs/how-to/plugins.md describes it. A name is imported when it is used, so that a plug-in with a
metric alone loads no engine.
"""

from collections.abc import Iterator
from types import ModuleType
from typing import TYPE_CHECKING, Any

from contactlab.parts import register_parts

# ruff: noqa: PLC0415 - a name is imported when it is used

if TYPE_CHECKING:
    from contactlab.engines.engine import (
        Buffers,
        PreparedRuns,
        Proceed,
        Rollout,
        SimulationEngine,
        Watch,
        engine,
        no_limit,
        proceed_always,
    )
    from contactlab.errors import ContactlabError, EngineError, PluginError, SceneError
    from contactlab.judge.limits import Limit, informative
    from contactlab.measure import (
        Context,
        Floats,
        MeasuredRuns,
        Onset,
        OnsetIterator,
        Onsets,
        Threshold,
        cached,
        contact_depths,
        first_step,
        label,
        metric,
        oracle,
        runs_where,
        worst_pair,
    )
    from contactlab.studies.check.check_entries import Measured, check
    from contactlab.tasks.checked_model import CheckedModel

__all__ = [
    "Buffers",
    "CheckedModel",
    "ContactlabError",
    "Context",
    "EngineError",
    "Floats",
    "Limit",
    "Measured",
    "MeasuredRuns",
    "Onset",
    "OnsetIterator",
    "Onsets",
    "PluginError",
    "PreparedRuns",
    "Proceed",
    "Rollout",
    "SceneError",
    "SimulationEngine",
    "Threshold",
    "Watch",
    "cached",
    "check",
    "contact_depths",
    "engine",
    "first_step",
    "informative",
    "label",
    "metric",
    "no_limit",
    "oracle",
    "proceed_always",
    "runs_where",
    "worst_pair",
]
register_parts()


def _find_homes() -> Iterator[ModuleType]:
    """Yield the modules that define these names, each imported when it is reached.

    The cheapest come first; a package has all of its own entries before it gives a name.
    """
    import contactlab.measure

    yield contactlab.measure
    import contactlab.errors

    yield contactlab.errors
    import contactlab.judge.limits

    yield contactlab.judge.limits
    import contactlab.engines.engine

    yield contactlab.engines.engine
    import contactlab.studies.check.check_entries

    yield contactlab.studies.check.check_entries
    import contactlab.tasks.checked_model

    yield contactlab.tasks.checked_model


def __getattr__(name: str) -> Any:  # noqa: ANN401 - each has a type of its own
    if name in __all__:
        for home in _find_homes():
            if hasattr(home, name):
                return getattr(home, name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def __dir__() -> list[str]:
    return __all__
