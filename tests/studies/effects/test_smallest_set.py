"""The set that a search finds is free as a whole, and no effect can be added to it."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from contactlab.studies.effects.ablation import SmallestSetSearch, merge_names
from contactlab.studies.effects.configuration_runs import ConfigurationRows
from contactlab.studies.effects.effect_toggles import Changed, judged_metrics

NAMES = ("air", "damper", "elliptic", "noslip", "spring")
TOLERANCE = 1.0


def outcome(drift: float) -> ConfigurationRows:
    """Return one run that drifts so far."""
    row: dict[str, Any] = {**dict.fromkeys(judged_metrics()), "drift": drift, "label": "stable"}
    return ConfigurationRows([{}], [(row,)])


@given(
    shifts=st.fixed_dictionaries(dict.fromkeys(NAMES, st.integers(0, 12))),
    order=st.permutations(NAMES),
    certain=st.integers(0, 2),
)
def test_small_changes_cannot_add_up(
    shifts: dict[str, int], order: Sequence[str], certain: int
) -> None:
    """Each effect shifts a metric by some tenths of its tolerance, and shifts add up."""
    for name in order[:certain]:
        shifts[name] = 0  # that it changes nothing is proven

    def drift(changed: Changed) -> float:
        return sum(shifts[name] for name in changed) / 10

    def ran(_: str, __: str, configurations: Sequence[Changed], ___: object) -> Any:
        return {each: outcome(drift(each)) for each in configurations}

    setup = SimpleNamespace(tolerances={"drift": TOLERANCE}, seeds=(0,))
    trials: Any = SimpleNamespace(setup=setup, run=ran)
    free = SmallestSetSearch(trials, outcome(0.0)).find_smallest(order[:certain], order[certain:])
    assert drift(free) <= TOLERANCE
    assert set(order[:certain]) <= set(free)
    assert all(drift(merge_names(free, [name])) > TOLERANCE for name in NAMES if name not in free)
