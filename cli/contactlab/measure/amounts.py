"""Formats amounts as a person would say them; numbers of failing runs may be absurdly large."""

import math


def format_amount(number: float) -> str:
    """Return a number as in `0.012`, `4.25`, `4,618` or `more than a million`."""
    if not math.isfinite(number):
        return "beyond all numbers"
    if abs(number) >= 1e6:
        return "more than a million"
    return f"{number:,.0f}" if abs(number) >= 100 else f"{number:.3g}"


def readable_fraction(ratio: float) -> str:
    """Return a ratio as the phrase before a noun: `12 % of`, `4,618 times`, `2e-07 of`."""
    if not abs(ratio) < 1:
        return f"{format_amount(ratio)} times" if math.isfinite(ratio) else format_amount(ratio)
    return f"{ratio:.2g} of" if abs(ratio) < 1e-4 else f"{100 * ratio:.3g} % of"
