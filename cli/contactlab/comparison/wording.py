"""How messages write numbers, changes, counts and settings."""

from contactlab.schema.evidence import Setting


def format_number(value: float) -> str:
    """Return a number to four digits."""
    return f"{value:.4g}"


def value_change(baseline: float, candidate: float, unit: str) -> str:
    """Return `0.1 -> 0.12 m (+20 %)`: two values and their relative change."""
    shown = f"{format_number(baseline)} -> {format_number(candidate)}"
    if format_number(baseline) == format_number(candidate):
        shown = f"{baseline:.10g} -> {candidate:.10g}"
    named = shown if unit in {"", "1", "any"} else f"{shown} {unit}"
    if baseline <= 0 or not abs(candidate / baseline) < 1e3:
        return named
    return f"{named} ({format_percent(candidate / baseline - 1, signed=True)})"


def format_percent(value: float, *, signed: bool = False) -> str:
    """Return a fraction in percent, to two digits."""
    sign = "+" if signed else ""
    percent = 100 * value
    digits = f"{percent:{sign}.0f}" if abs(percent) >= 10 else f"{percent:{sign}.2g}"
    return f"{digits} %"


def out_of(count: int, total: int, noun: str = "run") -> str:
    """Return `2 of 6 runs`."""
    return f"{count:,} of {total:,} {noun}{'' if total == 1 else 's'}"


def plural(count: int, noun: str = "run") -> str:
    """Return `1 run` or `2 runs`."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def format_settings(values: dict[str, Setting]) -> str:
    """Return axis values as `cone=elliptic direction=45`."""
    return " ".join(f"{name}={_setting(value)}" for name, value in values.items())


def _setting(value: Setting) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    return f"'{value}'" if isinstance(value, str) and " " in value else str(value)
