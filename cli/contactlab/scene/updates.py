"""How an axis value changes the resolved settings, other settings of its kind kept."""

from collections.abc import Callable, Mapping, MutableMapping
from functools import cache

from contactlab.contact import damping_ratio_of, stiffness_damping

Settings = MutableMapping[str, object]
Update = Callable[[Settings, object], None]


def whole(name: str) -> Update:
    """Set a setting as a whole."""

    def update(settings: Settings, value: object) -> None:
        settings[name] = value

    return update


def part(name: str, places: tuple[int, ...]) -> Update:
    """Set some of a setting's numbers to one value."""

    def update(settings: Settings, value: object) -> None:
        current = list(_tuple(settings, name))
        for place in places:
            current[place] = float(str(value))
        settings[name] = tuple(current)

    return update


def _tuple(settings: Mapping[str, object], name: str) -> tuple[float, ...]:
    value = settings[name]
    assert isinstance(value, tuple)
    return value


def standard(place: int) -> Update:
    """Set solref's time constant or damping ratio; a direct form is left for the standard one."""

    def update(settings: Settings, value: object) -> None:
        current = _tuple(settings, "solref")
        both = list(current if current[0] > 0 else (0.02, 1.0))
        both[place] = float(str(value))
        settings["solref"] = tuple(both)

    return update


def direct(place: int) -> Update:
    """Set solref's stiffness or damping; a standard form is turned into its equal first."""

    def update(settings: Settings, value: object) -> None:
        current = list(_direct_form(settings))
        current[place] = -float(str(value))
        settings["solref"] = tuple(current)

    return update


def _direct_form(settings: Settings) -> tuple[float, float]:
    solref = _tuple(settings, "solref")
    if solref[0] <= 0:
        return solref[0], solref[1]
    stiffness, damping = stiffness_damping(solref)
    return -float(stiffness), -float(damping)


@cache
def _damping_ratio(restitution: float) -> float:
    return float(damping_ratio_of(restitution))


def restitution(settings: Settings, value: object) -> None:
    """Keep the contact's natural frequency w and set the damping that restitution asks for."""
    stiffness = -_direct_form(settings)[0]
    damping = 2.0 * _damping_ratio(float(str(value))) * stiffness**0.5
    settings["solref"] = (-stiffness, -damping)


def gravity(settings: Settings, value: object) -> None:
    """Set gravity by its magnitude [m/s^2], downwards, or by its vector."""
    settings["gravity"] = (0.0, 0.0, -value) if isinstance(value, float) else value


def friction(settings: Settings, value: object) -> None:
    """Set the contact's five coefficients by the three that MJCF gives a geom."""
    assert isinstance(value, tuple)
    slide, torsion, roll = value
    settings["friction"] = (slide, slide, torsion, roll, roll)
