"""Numbers with units, as sweep files and options have them: `2ms`, `1 mm`, `5deg`, `10%`."""

import math
import re

_KINDS = {
    "s": {"us": 1e-6, "µs": 1e-6, "ms": 1e-3, "s": 1.0},
    "m": {"um": 1e-6, "µm": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0},
    "kg": {"g": 1e-3, "kg": 1.0},
    "rad": {"deg": math.pi / 180, "rad": 1.0},
    "m/s": {"mm/s": 1e-3, "cm/s": 1e-2, "m/s": 1.0},
    "rad/s": {"deg/s": math.pi / 180, "rad/s": 1.0},
    "N": {"mN": 1e-3, "N": 1.0, "kN": 1e3},
    "N/m": {"N/m": 1.0, "kN/m": 1e3, "N/mm": 1e3},
}
SI_UNITS = {unit: (kind, size) for kind, units in _KINDS.items() for unit, size in units.items()}
"""The SI unit that each unit measures the same as, and its size in it."""
_WITH_UNIT = re.compile(rf"([-+]?\d*\.?\d+(?:e[-+]?\d+)?)\s*({'|'.join(SI_UNITS)})")


def without_unit(value: object, unit: str = "") -> float | None:
    """Return the number, in a unit or else in SI, that a text such as `2ms` means.

    None if it is no such text, or measures something else.
    """
    number, own = split_unit(value)
    kind, size = SI_UNITS.get(own, ("", 1.0))
    wanted, scale = SI_UNITS.get(unit, ("", 1.0)) if unit else (kind, 1.0)
    return float(f"{number * size / scale:.12g}") if own and kind == wanted else None


def split_unit(value: object) -> tuple[float, str]:
    """Return number and unit of a text such as `2ms`; not a number, and no unit, of others."""
    parts = _WITH_UNIT.fullmatch(value.strip()) if isinstance(value, str) else None
    return (float(parts[1]), parts[2]) if parts else (math.nan, "")


def read_quantity(text: str) -> tuple[float, str]:
    """Return a number in SI, and its unit there: `2ms` is 0.002 and s; a share of 1 has none.

    Not a number where the text is none.
    """
    value = text.strip()
    try:
        if value.endswith("%"):
            return float(value[:-1]) / 100, ""
        return float(value), ""
    except ValueError:
        number, unit = split_unit(value)
        kind, size = SI_UNITS.get(unit, ("", math.nan))
        return float(f"{number * size:.12g}"), kind
