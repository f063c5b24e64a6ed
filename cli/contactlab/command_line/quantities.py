"""Reads quantities of options: times, lengths and errors with their units."""

import math

from contactlab.errors import SweepFileError


def read_seconds(text: float | str, option: str = "--max-time") -> float:
    """Return the time of an option [s].

    Raises:
        SweepFileError: it is not a positive time.
    """
    return _read_positive(
        str(text), ("", "s"), f"{option} {text}: write a time, such as 90s, 5min or 1h"
    )


def read_length(text: float | str | None, option: str, example: str) -> float | None:
    """Return the length of an option [m], or None if it was not given.

    Raises:
        SweepFileError: it is not a positive length.
    """
    if text is None:
        return None
    return _read_positive(
        str(text), ("", "m"), f"{option} {text}: write a length, such as {example}"
    )


def read_error(error: float | str | None) -> float | None:
    """Return a target error as a number, or None if it was not given; 2% is 0.02.

    Raises:
        SweepFileError: it is neither a share nor an amount of an observed output.
    """
    if error is None:
        return None
    expected = "a share, such as 2%, or with --error-at a number in the unit of the observed output"
    return _read_positive(str(error), ("", "m", "rad", "1"), f"--error {error}: write {expected}")


def read_share(text: float | str, option: str) -> float:
    """Return the share of an option; 5% is 0.05.

    Raises:
        SweepFileError: it is not a share above 0 and of at most 1.
    """
    mistake = f"{option} {text}: write a share of at most 100%, such as 5%"
    share = _read_positive(str(text), ("", "1"), mistake)
    if share > 1:
        raise SweepFileError(mistake)
    return share


def _read_positive(text: str, units: tuple[str, ...], mistake: str) -> float:
    from contactlab.schema.setting_values import read_quantity

    value, unit = read_quantity(text)
    if not 0 < value < math.inf or unit not in units:
        raise SweepFileError(mistake)
    return value
