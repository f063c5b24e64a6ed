"""What an oracle is: a closed form that says what a scene should do."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from contactlab.contact import Floats
from contactlab.measure.context import Context


class OracleResult(NamedTuple):
    """What a closed form expects of n runs, what they did, and how far apart that is, each (n,)."""

    expected: Floats
    measured: Floats
    error: Floats


@dataclass(frozen=True)
class Oracle:
    """A closed form.

    Attributes:
        name: its name in scenes.
        unit: unit of what is expected and measured.
        relative: whether the error is a share of what is expected; else it has the same unit.
        definition: the law, with its source, and what is measured against it.
        settings: names of the settings that it reads.
        function: expected and measured values of every run, each (n,).
    """

    name: str
    unit: str
    relative: bool
    definition: str
    settings: tuple[str, ...]
    function: Callable[[Context], tuple[Floats, Floats]]

    def of(self, context: Context) -> OracleResult:
        """Return what the law expects of every run of a context, and how far off it is."""
        with np.errstate(all="ignore"):
            expected, measured = self.function(context)
            error = np.abs(measured - expected)
            scale = np.abs(expected) if self.relative else 1
            return OracleResult(expected, measured, error / scale)


def setting(context: Context, name: str) -> Floats:
    """Return a setting of every run: (n,) for a number, (n, k) for k of them."""
    return np.asarray(context.setup.settings[name], dtype=np.float64)
