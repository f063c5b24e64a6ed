"""What a configuration costs: CPU times of matched pairs of runs, timed in turns."""

from collections.abc import Iterator
from math import isfinite
from statistics import median

from contactlab.schema import Ratio
from contactlab.studies.effects.trials import Outcome

_WORK = ("work_iterations", "work_contacts", "work_rows")


def cost_ratio(base: Outcome, other: Outcome) -> Ratio | None:
    """Return the ratio of CPU times, or None if no pair went through."""
    ratios = list(_ratios(base, other, "time_min"))
    if not ratios:
        return None
    return Ratio(ratio=median(ratios), low=min(ratios), high=max(ratios), pairs=len(ratios))


def work_ratios(base: Outcome, other: Outcome) -> dict[str, float]:
    """Return the ratio of each work counter, of those that the base has."""
    found = {name: list(_ratios(base, other, name)) for name in _WORK}
    return {name: median(each) for name, each in found.items() if each}


def _ratios(base: Outcome, other: Outcome, name: str) -> Iterator[float]:
    for first, second in zip(base.flat, other.flat, strict=True):
        below, above = first.get(name), second.get(name)
        if below and above is not None and isfinite(above / below):
            yield above / below
