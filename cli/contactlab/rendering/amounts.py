"""Formats numbers with their units: one spelling of a share, a time, a length and a count."""

import math

_SCALED = {"mm": 1e3, "mm/s": 1e3, "ms": 1e3, "us": 1e6}
"""Units that are printed for SI numbers, and the factor from the SI unit."""
LEAST_ERROR = 1e-4
"""A smaller numerical error decides nothing: tables write 0 %, without its body."""


def format_amount(
    value: float | None, unit: str = "", *, digits: int | None = None, signed: bool = False
) -> str:
    """Return a number with its unit.

    Args:
        value: in SI units; of a share or a ratio, 0.5 is a half. None is unknown.
        unit: `%` for a share, `x` for a ratio of times, `count` for a whole number with its
            thousands, `N` with a prefix as needed, `B` for a size in MB or GB, `long` for a time
            in s, min, h or days, `mm` or `mm/s` for a length or speed that is in m or m/s from
            1 on, `ms` or `us` for small SI numbers; any other unit is written after the number,
            and "" and "1" are not.
        digits: significant digits; 2 of shares and forces, 3 of other numbers. Digits before the
            point are never lost below 1e5.
        signed: whether positive numbers have a sign.
    """
    if value is None or not math.isfinite(value):
        return "-" if value is None or math.isnan(value) else "∞" if value > 0 else "-∞"
    match unit:
        case "%":
            text = f"{format_digits(100 * value, digits or 2)} %"
        case "x":
            # Below 0.1, two decimals show fewer than two significant digits.
            text = f"x{value:.2f}" if value >= 0.1 else f"x{value:.2g}"
        case "count":
            text = f"{value:,.0f}"
        case "N":
            power = min(3, max(0, math.floor(math.log10(value) / 3))) if value > 0 else 0
            name = ("N", "kN", "MN", "GN")[power]
            text = f"{format_digits(value / 1e3**power, digits or 2)} {name}"
        case "B":
            power, name = (1e9, "GB") if value >= 1e9 else (1e6, "MB")
            text = f"{format_digits(value / power, digits or 3)} {name}"
        case "long":
            text = _format_long_time(value)
        case "" | "1":
            text = format_digits(value, digits or 3)
        case "mm" | "mm/s" if abs(value) >= 1:
            text = f"{format_digits(value, digits or 3)} {unit[1:]}"
        case _:
            text = f"{format_digits(_SCALED.get(unit, 1.0) * value, digits or 3)} {unit}"
    return f"+{text}" if signed and value > 0 else text


def format_percent(share: float | None, *, signed: bool = False) -> str:
    """Return a share in percent: two digits, or all before the point."""
    return format_amount(share, "%", signed=signed)


def format_error(share: float) -> str:
    """Return a numerical error in percent; `below 0.01 %` where tables write 0 %."""
    return f"below {format_percent(LEAST_ERROR)}" if share < LEAST_ERROR else format_percent(share)


def format_table_error(share: float | None) -> str:
    """Return a numerical error in a table: in percent, and 0 % below 0.01 %."""
    return "0 %" if share is not None and share < LEAST_ERROR else format_percent(share)


def format_interval(low: float | None, high: float | None, unit: str = "%") -> str:
    """Return `58 to 92 %`: two numbers with their unit written once."""
    suffix = "" if unit == "x" else f" {unit}"
    first, last = format_amount(low, unit), format_amount(high, unit)
    return f"{first.removesuffix(suffix).removeprefix('x')} to {last.removeprefix('x')}"


def format_others(count: int, noun: str) -> str:
    """Return `; so do 2 more pairs` after a sentence about the first of several, or nothing."""
    return f"; so do {count} more {noun}s" if count > 1 else f"; so does another {noun}" * count


def format_setting(value: object, digits: int = 6) -> str:
    """Return the value of a setting or an axis: `0.02 1`, `elliptic`."""
    if isinstance(value, tuple):
        return " ".join(format_setting(item, digits) for item in value)
    return f"{value:.{digits}g}" if isinstance(value, float) else str(value)


def format_above(share: float, limit: float) -> str:
    """Return a share in percent with as many digits as show that it is above a limit."""
    if not math.isfinite(share) or format_percent(share) != format_percent(limit):
        return format_percent(share)
    for digits in range(3, 9):  # more are rounding
        if (text := format_digits(100 * share, digits)) != format_digits(100 * limit, digits):
            return f"{text} %"
    return format_percent(share)


def format_digits(number: float, digits: int = 3) -> str:
    """Return a number in this many digits, without an exponent from 1e-3 to 1e5."""
    short = f"{number:.{digits}g}"
    if "e" not in short or not 1e-3 <= abs(number) < 1e5:
        return short
    return f"{float(short):.0f}" if abs(number) < 10**digits else f"{number:.0f}"


def _format_long_time(seconds: float) -> str:
    # From 99 of a unit on, the next one is shown.
    for unit, size in (("s", 1.0), ("min", 60.0), ("h", 3600.0)):
        if seconds < 99 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds / 86_400:,.0f} days"
