"""What changing one knob does, all else equal: matched pairs of runs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from contactlab.contact import Floats
from contactlab.report.report_columns import Codes, GridAxis, Quantity, RunLabels, combination_codes

_MOST_VALUES = 12


@dataclass(frozen=True)
class KnobChange:
    """One knob from one value to another.

    Attributes:
        axis: the knob.
        before: the value that it is compared with.
        after: the value.
        pairs: how many pairs of runs differ in nothing else.
        failed: share of these that fail before, and after.
        ratios: quantity to the geometric mean of after over before, over the pairs of which
            neither run fails; None where no pair has two positive values.
    """

    axis: str
    before: str
    after: str
    pairs: int
    failed: tuple[float, float]
    ratios: dict[str, float | None]


def knob_changes(
    axes: Sequence[GridAxis], outcomes: RunLabels, quantities: Sequence[Quantity]
) -> list[KnobChange]:
    """Return every knob's values against its first, where runs can be matched."""
    knobs = [axis for axis in axes if axis.role == "knob" and len(axis.words) <= _MOST_VALUES]
    return [each for axis in knobs for each in _of(axis, axes, outcomes, quantities)]


def _of(
    axis: GridAxis, axes: Sequence[GridAxis], outcomes: RunLabels, quantities: Sequence[Quantity]
) -> Iterator[KnobChange]:
    others = combination_codes([each for each in axes if each is not axis], len(axis.codes))
    base = np.flatnonzero(axis.codes == 0)
    for code in range(1, len(axis.words)):
        rows = np.flatnonzero(axis.codes == code)
        before, after = _matched(others, base, rows)
        if len(before):
            failed = outcomes.failed
            fine = ~(failed[before] | failed[after])
            yield KnobChange(
                axis=axis.name,
                before=axis.words[0],
                after=axis.words[code],
                pairs=len(before),
                failed=(float(failed[before].mean()), float(failed[after].mean())),
                ratios={
                    each.name: _ratio(each.values[before[fine]], each.values[after[fine]])
                    for each in quantities
                },
            )


def _matched(others: Codes, base: Codes, rows: Codes) -> tuple[Codes, Codes]:
    _, first, second = np.intersect1d(others[base], others[rows], return_indices=True)
    return base[first], rows[second]


def _ratio(before: Floats, after: Floats) -> float | None:
    known = (before > 0) & (after > 0)
    if not known.any():
        return None
    return float(np.exp(np.log(after[known] / before[known]).mean()))
