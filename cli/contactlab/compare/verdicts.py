"""Verdicts as numbers, so that a million of them are one array."""

from typing import get_args

import numpy as np
from numpy.typing import NDArray

from contactlab.schema import Verdict

Verdicts = NDArray[np.int8]

# The worse, the larger: a fold is a maximum.
NAMES: tuple[Verdict, ...] = ("same", "better", "changed", "worse", "missing", "not comparable")
SAME, BETTER, CHANGED, WORSE, MISSING, NOT_COMPARABLE = range(len(NAMES))
assert set(NAMES) == set(get_args(Verdict))


def counted(verdicts: Verdicts) -> dict[Verdict, int]:
    """Return how many have which verdict, without those that none has."""
    counts = np.bincount(verdicts, minlength=len(NAMES)).tolist()
    return {name: count for name, count in zip(NAMES, counts, strict=True) if count}


def folded(verdicts: Verdicts) -> Verdict:
    """Return the worst verdict; same if there is none."""
    return NAMES[int(verdicts.max())] if len(verdicts) else "same"
