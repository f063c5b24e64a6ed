"""How much a metric may change before an effect is said to matter."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from contactlab.measure import METRICS

# Metrics that count work, or that a second pass measures: no results of the physics.
_WORK = {
    "solver_iterations_mean",
    "solver_iterations_max",
    "solver_iterations",
    "saturated_share",
    "contacts_mean",
    "contacts_max",
    "contacts_cut",
    "ungraded_contacts",
    "solver_residual",
    "jacobian_difference",
    "overlap_missed",
    "distance_phantom",
    "repeats",
    "oracle_expected",
    "oracle_measured",
}
JUDGED = tuple(name for name in METRICS if name not in _WORK)
# What cannot be measured with an effect off, or on: energies that are not recorded, and depths of
# contacts ahead of touch, whose distance is made up.
UNMEASURED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "energy": (
            "energy_gain",
            "energy_drift",
            "speed_ratio",
            "momentum_drift",
            "spin_drift",
            "settle_time",
        ),
        "speculative": (
            "penetration_max",
            "penetration_mean",
            "penetration_steady",
            "penetration_growth",
            "hold_penetration",
            "distance_min",
        ),
    }
)
# By unit: 0.1 mm is the depth that practice accepts; 1 mm/s is a fifth of what tells sliding
# from sticking; ratios count to 1 %.
_BY_UNIT = {
    "m": 1e-4,
    "m/s": 1e-3,
    "rad": 0.01,
    "1": 0.01,
    "any": 0.01,
    "s": 0.02,
    "J": 1e-3,
    "N s": 0.0,
}
# 0.1 % a second is what practice lets free motion lose; 5 a second is what it calls chatter.
_BY_NAME = {
    "energy_drift": 1e-3,
    "mode_switches": 5.0,
    "contact_losses": 5.0,
    "hold_switches": 5.0,
    "penetration_growth": 1e-4,
    "creep_speed": 1e-4,
}
_SHARE = 0.01


def tolerance_of(name: str, given: Mapping[str, float], values: Sequence[float]) -> float:
    """Return the largest change of a metric that is none, in its unit.

    Args:
        name: the metric.
        given: what sweep or scene say; taken as it is.
        values: the metric without the change; 1 % of its largest size is none.
    """
    if name in given:
        return given[name]
    usual = _BY_NAME.get(name, _BY_UNIT.get(METRICS[name].unit, 0.0))
    return max(usual, _SHARE * max(map(abs, values), default=0.0))
