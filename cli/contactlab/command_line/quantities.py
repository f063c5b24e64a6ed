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


def read_error(error: float | str | None, *, is_share: bool = True) -> float | None:
    """Return a target error as a number, or None if it was not given; 2% is 0.02.

    Without `is_share` it is an amount in the unit of an observed output.

    Raises:
        SweepFileError: it is not a share, or not such an amount.
    """
    if error is None:
        return None
    if is_share:
        mistake = (
            f"--error {error}: write a share of the real forces, such as 2%, or for a distance "
            "--observe BODY --error-at end --error 1e-5m"
        )
        return _read_positive(str(error), ("", "1"), mistake)
    mistake = (
        f"--error {error}: --error-at takes an amount in the unit of the observed output, such as "
        "1e-5m; leave it out for a share"
    )
    if "%" in str(error):
        raise SweepFileError(mistake)
    return _read_positive(str(error), ("", "m", "rad"), mistake)


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
