"""Knobs that change nothing about how accurate a configuration is."""

from collections.abc import Sequence

from contactlab.schema import Setting
from contactlab.tradeoff.configurations import Weighed

_EQUAL = 1.01


def idle_knobs(found: Sequence[Weighed]) -> list[str]:
    """Return the knobs that change no error by more than 1 %, and no label, all else equal."""
    names = list(found[0].group.values) if found else []
    return [name for name in names if _is_idle(found, name)]


def typical(found: Sequence[Weighed], idle: Sequence[str], chosen: Weighed | None) -> list[Weighed]:
    """Return the configurations with one value of each idle knob: the recommended, or the first."""
    like = (chosen or found[0]).group.values
    return [each for each in found if all(each.group.values[name] == like[name] for name in idle)]


def _is_idle(found: Sequence[Weighed], name: str) -> bool:
    alike: dict[tuple[Setting, ...], list[Weighed]] = {}
    for each in found:
        others = tuple(value for key, value in each.group.values.items() if key != name)
        alike.setdefault(others, []).append(each)
    compared = [each for each in alike.values() if len(each) > 1]
    return bool(compared) and all(_is_equal(each) for each in compared)


def _is_equal(found: Sequence[Weighed]) -> bool:
    errors = [each.summary.error for each in found]
    known = [error for error in errors if error is not None]
    if known and (len(known) < len(errors) or max(known) > _EQUAL * min(known)):
        return False
    return len({tuple(sorted(each.failures)) for each in found}) == 1
