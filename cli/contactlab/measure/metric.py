"""What a metric is."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from contactlab.contact import Floats
from contactlab.measure.context import Context

Direction = Literal["lower", "higher", "none"]


@dataclass(frozen=True)
class Metric:
    """One number a run, and how to read it.

    Attributes:
        name: its name in sweeps, evidence and reports.
        unit: its unit; `1` for counts and ratios.
        better: which direction is an improvement; none where it depends on what is wanted.
        resolution: magnitude below which the value is 0, in its unit.
        version: grows whenever the definition changes.
        definition: what it is, in words, with its source.
        function: the metric of every run of a context, (n,); NaN where it does not apply.
    """

    name: str
    unit: str
    better: Direction
    resolution: float
    version: int
    definition: str
    function: Callable[[Context], Floats]

    def of(self, context: Context) -> Floats:
        """Return (n,) values, 0 below the resolution, NaN for runs without a single step."""
        if context.trace.steps == 0:
            return context.nothing()
        with np.errstate(all="ignore"):
            values = np.asarray(self.function(context), dtype=np.float64)
            return np.where(np.abs(values) < self.resolution, 0, values)
