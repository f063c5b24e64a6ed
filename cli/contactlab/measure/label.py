"""What a label is, and what a rule is given."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats
from contactlab.measure.context import Context
from contactlab.measure.thresholds import limits


class Finding(NamedTuple):
    """Why a rule applies to a run, and the first step at which it does."""

    reason: str
    step: int


Findings = dict[int, Finding]
"""Findings of one rule by run; runs without one are absent."""


@dataclass(frozen=True)
class Case:
    """What a rule judges.

    Attributes:
        context: the runs.
        metrics: every metric of these runs, (n,) each.
    """

    context: Context
    metrics: Mapping[str, Floats]

    @cached_property
    def limits(self) -> dict[str, float]:
        """Thresholds by name."""
        return limits(self.context.setup.thresholds)


@dataclass(frozen=True)
class Label:
    """A named outcome of a run.

    Attributes:
        name: its name in sweeps, evidence and reports.
        meaning: what it says of a run, in words.
        thresholds: names of the thresholds that its rule reads.
        rule: finds the runs it applies to; None where it is known from outside the trace.
    """

    name: str
    meaning: str
    thresholds: tuple[str, ...]
    rule: Callable[[Case], Findings] | None


class Outcome(NamedTuple):
    """A label that applies to a run, with the reason in words and the first step it is met at."""

    label: str
    reason: str
    step: int


def rows(flag: NDArray[np.bool_]) -> list[int]:
    """Return the runs in which a flag (n,) is set."""
    return np.flatnonzero(flag).tolist()


def first(mask: NDArray[np.bool_]) -> int:
    """Return the first step in which a mask (N,) holds; 0 if none."""
    return int(mask.argmax())
