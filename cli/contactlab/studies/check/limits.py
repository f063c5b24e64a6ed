"""What each measure is held against, and what it means to miss that.

An error is what a run of the model itself shows to be wrong, or what no physical body can be; a
warning is a rule of thumb of people who simulate contact with MuJoCo.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from contactlab.errors import SweepFileError, did_you_mean
from contactlab.schema.check_report import Measure, Severity

_SLACK = 1 + 1e-9
"""Keeps a value that equals its limit within it, whatever its rounding error."""


@dataclass(frozen=True)
class Limit:
    """The limit of all measures of one name: None where the model or its task decides.

    Attributes:
        strict: whether the limit itself misses it.
        shown: factor and unit in which people read it.
    """

    unit: str
    severity: Severity
    value: float | None = None
    strict: bool = False
    shown: tuple[float, str] = (1.0, "")


_MM, _MS, _PERCENT = (1e3, " mm"), (1e3, " ms"), (1e2, " %/s")
LIMITS: Mapping[str, Limit] = MappingProxyType(
    {
        "timestep": Limit("s", "warning", shown=_MS),
        "step_ratio": Limit("1", "warning", 0.8),
        "travel": Limit("m", "error", shown=_MM),
        "energy_drift": Limit("1/s", "warning", 1e-3, shown=_PERCENT),
        "energy_gain": Limit("1/s", "error", 1e-2, shown=_PERCENT),
        "penetration_steady": Limit("m", "warning", 1e-4, strict=True, shown=_MM),
        "penetration_growth": Limit("m/s", "warning", 1e-6, shown=(1e6, " µm/s")),
        "steps_lost": Limit("1", "error", 1, strict=True),
        "mode_switches": Limit("1/s", "error", 5, strict=True, shown=(1.0, " a second")),
        "penetration_mean": Limit("m", "warning", 1e-3, strict=True, shown=_MM),
        "slip": Limit("m", "warning", 1e-4, strict=True, shown=_MM),
        "loose_share": Limit("1", "error", 0.5),
        "trajectories_differ": Limit("1", "error", 0),
        "shell": Limit("m", "warning", 1e-4, shown=_MM),
        "softness": Limit("s", "warning", 0.02, shown=_MS),
    }
)
"""By the name of a measure, which is unique among all checks."""


def settable_limits() -> list[str]:
    """Return the names of the limits that a request may replace."""
    return [name for name, limit in LIMITS.items() if limit.value is not None]


@dataclass(frozen=True)
class Limits:
    """The limits of one request, some of them its own."""

    given: Mapping[str, float] = field(default_factory=dict[str, float])

    def __post_init__(self) -> None:
        known = [*settable_limits(), "timestep"]
        for name in self.given:
            if name not in known:
                hint = did_you_mean(name, known)
                raise SweepFileError(f"no limit '{name}'{hint}; there are {', '.join(known)}")

    def measure(
        self,
        name: str,
        value: float,
        of: str | None = None,
        *,
        limit: float | None = None,
        severity: Severity | None = None,
    ) -> Measure:
        """Return a value, and whether it meets its limit; NaN never does.

        A limit or severity that is given replaces that of the table, but not that of the request.
        """
        rule = LIMITS[name]
        bound = self.given.get(name, rule.value if limit is None else limit)
        assert bound is not None
        return Measure(
            name=name,
            of=of,
            value=value if math.isfinite(value) else None,
            unit=rule.unit,
            limit=bound,
            holds=bool(value < bound if rule.strict else value <= bound * _SLACK),
            severity=severity or rule.severity,
        )


DEFAULT_LIMITS = Limits()


def informative(name: str, value: float, unit: str, of: str | None = None) -> Measure:
    """Return a measure without a limit."""
    kept = value if math.isfinite(value) else None
    return Measure(name=name, of=of, value=kept, unit=unit, limit=None, holds=None)


def utilization(measure: Measure) -> float:
    """Return a measure as a fraction of its limit; infinite where it has no value."""
    if measure.value is None or measure.limit is None:
        return math.inf
    if not measure.limit:
        return math.inf if measure.value else 0.0
    return measure.value / measure.limit


def in_words(measure: Measure) -> str:
    """Return a limited measure as text: `slip 0.2 mm (floor-foot, limit 0.1 mm)`."""
    factor, unit = LIMITS[measure.name].shown if measure.name in LIMITS else (1.0, "")
    unit = unit or ("" if measure.unit == "1" else f" {measure.unit}")
    value = "none" if measure.value is None else f"{measure.value * factor:.3g}{unit}"
    of = f"{measure.of}, " if measure.of else ""
    limit = f"{(measure.limit or 0) * factor:.3g}{unit}"
    return f"{measure.name.replace('_', ' ')} {value} ({of}limit {limit})"
