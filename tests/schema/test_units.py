"""Units are what their prefixes and parts say."""

import math

import pytest

from contactlab.schema.setting_values import SI_UNITS, read_quantity, split_unit, without_unit

PREFIXES = {"": 1.0, "u": 1e-6, "µ": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3}
BASES = {
    "s": 1.0,
    "m": 1.0,
    "g": 1e-3,
    "N": 1.0,
    "rad": 1.0,
    "Hz": 1.0,
    "deg": math.pi / 180,
    "min": 60,
    "h": 3600,
}


def size_of(unit: str) -> float:
    """Return the size of a unit in SI: a prefix, a base, and what that is divided by."""
    first, _, second = unit.partition("/")
    if second:
        return size_of(first) / size_of(second)
    if first in BASES:
        return BASES[first]
    (size,) = (
        factor * BASES[first.removeprefix(prefix)]
        for prefix, factor in PREFIXES.items()
        if first.startswith(prefix) and first.removeprefix(prefix) in BASES
    )
    return size


@pytest.mark.parametrize("unit", SI_UNITS)
def test_a_unit_is_its_prefix_times_its_base_over_another(unit: str) -> None:
    """Numbers keep 12 digits."""
    kind, size = SI_UNITS[unit]
    assert size == pytest.approx(size_of(unit), rel=1e-12)
    assert SI_UNITS[kind] == (kind, 1.0)
    assert split_unit(f"2.5 {unit}") == (2.5, unit)
    assert read_quantity(f"2.5{unit}") == (pytest.approx(2.5 * size_of(unit)), kind)
    assert without_unit(f"2.5 {unit}", unit) == 2.5
    for other, (own, _) in SI_UNITS.items():
        expected = pytest.approx(2.5 * size_of(unit) / size_of(other)) if own == kind else None
        assert without_unit(f"2.5 {unit}", other) == expected
