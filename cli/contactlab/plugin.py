"""All that a plug-in needs: decorators, what its functions are given, and what they return.

docs/plugins.md describes it. A name is imported when it is used, so that a plug-in with a metric
alone loads no engine.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

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
        Found,
        MeasuredRuns,
        Onset,
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
    from contactlab.studies.check.checked_model import CheckedModel

__all__ = [
    "Buffers",
    "CheckedModel",
    "ContactlabError",
    "Context",
    "EngineError",
    "Floats",
    "Found",
    "Limit",
    "Measured",
    "MeasuredRuns",
    "Onset",
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
# The cheapest first; a package has all of its own entries before it gives a name.
_HOMES = (
    "contactlab.measure",
    "contactlab.errors",
    "contactlab.judge.limits",
    "contactlab.engines.engine",
    "contactlab.studies.check.check_entries",
    "contactlab.studies.check.checked_model",
)


def __getattr__(name: str) -> Any:  # noqa: ANN401 - each has a type of its own
    if name in __all__:
        for home in _HOMES:
            module = import_module(home)
            if hasattr(module, name):
                return getattr(module, name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def __dir__() -> list[str]:
    return __all__
