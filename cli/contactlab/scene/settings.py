"""Settings of a run by name, read as the numbers, vectors and words that they are."""


class Settings(dict[str, object]):
    """Every setting of a model or a run, by name, in the units of the parameters.

    A value is a float, an int, a word or a tuple of floats.
    """

    def number(self, name: str) -> float:
        """Return a setting that is a number."""
        return as_number(self[name])

    def vector(self, name: str) -> tuple[float, ...]:
        """Return a setting of several numbers."""
        return as_vector(self[name])

    def word(self, name: str) -> str:
        """Return a setting that is a word."""
        value = self[name]
        if not isinstance(value, str):
            raise TypeError(f"{name} is {value!r}, not a word")
        return value


def as_number(value: object) -> float:
    """Return a setting's or an axis' value as a float.

    Raises:
        TypeError: it is not a number.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is not a number")
    return float(value)


def as_vector(value: object) -> tuple[float, ...]:
    """Return a setting's or an axis' value as a tuple of floats.

    Raises:
        TypeError: it is not a tuple.
    """
    if not isinstance(value, tuple):
        raise TypeError(f"{value!r} is not several numbers")
    return value
