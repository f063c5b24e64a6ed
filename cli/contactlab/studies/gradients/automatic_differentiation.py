"""The derivative of a run's end by another engine's automatic differentiation."""

import math

from contactlab.engines import ENGINES
from contactlab.engines.adapted_engine import AdaptedEngine
from contactlab.engines.engine import PreparedRuns
from contactlab.errors import EngineError

ENGINE = "mjx"
ADAPTIVE = f"{ENGINE}-adaptive"
"""The same with substeps."""


def engine() -> AdaptedEngine:
    """Return the engine that differentiates."""
    adapted_engine = ENGINES[ENGINE]
    assert isinstance(adapted_engine, AdaptedEngine)
    return adapted_engine


def differentiate_end(
    runs: PreparedRuns, place: int, spread: float, accuracy: float = 0.0
) -> float | None:
    """Return the derivative of a coordinate's end value, or None if it is not finite.

    The runs are the run itself, and it with the parameter above and below, `spread` apart. With an
    accuracy above 0, each step consists of substeps of this accuracy, and one substep ends when a
    contact is made. Raises an EngineError if the engine fails.
    """
    answer = engine().ask(runs, operation="derivative", spread=spread, accuracy=accuracy)
    if isinstance(answer, str):
        raise EngineError(f"the {ENGINE} engine: {answer}")
    value = float(answer["change"][0][place])
    return value if math.isfinite(value) else None
