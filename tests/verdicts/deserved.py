"""Flags of public models that plain MuJoCo bears out, each with the measurement that says so."""

from fnmatch import fnmatchcase

# model, drive, label: why. Patterns as of a shell.
_DESERVED: dict[tuple[str, str, str], str] = {}


def deserved(model: str, drive: str, label: str) -> str | None:
    """Return why a flag is deserved, None if nobody has shown that it is."""
    for patterns, why in _DESERVED.items():
        if all(map(fnmatchcase, (model, drive, label), patterns)):
            return why
    return None
