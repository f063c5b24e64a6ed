"""The parameters that every scene offers as axes: name, unit, how a value changes the settings.

Contact parameters are those of the monitored pairs; sources are MuJoCo's XML reference (option,
geom) and its Modeling chapter (solver parameters).
"""

from collections.abc import Callable, Iterable, Mapping, MutableMapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import mujoco

from contactlab.contact import damping_ratio_of, stiffness_damping
from contactlab.scene.value_parsers import Parser, choice, integer, number, numbers, or_off
from contactlab.schema import AxisSpec

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


@dataclass(frozen=True)
class Parameter:
    """An axis and the resolved setting that it changes.

    Attributes:
        axis: name, unit, description and parser.
        sets: the resolved setting it changes.
        update: writes a parsed value into the settings.
    """

    axis: AxisSpec
    sets: str
    update: Update


_SPELLED = {"EULER": "Euler", "RK4": "RK4", "PGS": "PGS", "CG": "CG", "NEWTON": "Newton"}


def _words(enum: Any, prefix: str) -> tuple[str, ...]:  # noqa: ANN401 - a pybind11 enum
    """Return the words of an engine's enum as MJCF spells them, for as many as it has."""
    names: list[str] = [name.removeprefix(prefix) for name in enum.__members__]
    return tuple(_SPELLED.get(name, name.lower()) for name in names)


INTEGRATORS = _words(mujoco.mjtIntegrator, "mjINT_")
CONES = _words(mujoco.mjtCone, "mjCONE_")
SOLVERS = _words(mujoco.mjtSolver, "mjSOL_")
JACOBIANS = _words(mujoco.mjtJacobian, "mjJAC_")


def _gravity_value(value: object) -> object:
    try:
        return number(least=0)(value)
    except ValueError:
        return numbers(3, "x y z, or one magnitude downwards", lambda _: None)(value)


def _solref_mistake(value: tuple[float, ...]) -> str | None:
    if (value[0] > 0 and value[1] > 0) or (value[0] <= 0 and value[1] <= 0 and any(value)):
        return None
    return 'write "timeconst dampratio", both positive, or "-stiffness -damping", both negative'


def _solimp_mistake(value: tuple[float, ...]) -> str | None:
    dmin, dmax, width, midpoint, power = value
    fine = 0 < dmin < 1 and 0 < dmax < 1 and width > 0 and 0 < midpoint < 1 and power >= 1
    if fine:
        return None
    return "write dmin, dmax and midpoint between 0 and 1, width above 0, power of at least 1"


def _friction_mistake(value: tuple[float, ...]) -> str | None:
    return None if min(value) >= 0 else "write friction coefficients of at least 0"


def _parts(names: tuple[str, ...], value: object) -> dict[str, float]:
    assert isinstance(value, tuple)
    return dict(zip(names, value, strict=True))


def _solref_parts(value: object) -> dict[str, float]:
    """Name the parts of a solref by its form; the other form's are absent."""
    assert isinstance(value, tuple)
    if value[0] > 0:
        return {_TC: value[0], _DR: value[1]}
    return {_K: -value[0], _B: -value[1]}


def _condim(value: object) -> int:
    parsed = integer(1, 6)(value)
    if parsed not in (1, 3, 4, 6):
        raise ValueError(f"write 1, 3, 4 or 6, not {value!r}")
    return parsed


_POSITIVE = number(above=0)
_SHARE = number(above=0, most=0.9999)
_SOLREF = numbers(2, "timeconst dampratio", _solref_mistake)
_SOLIMP = numbers(5, "dmin dmax width midpoint power", _solimp_mistake)


def _solimp_value(value: object) -> object:
    """Read five numbers; MJCF's defaults fill in for three."""
    parts = value.split() if isinstance(value, str) else value
    if isinstance(parts, (list, tuple)) and len(parts) == 3:
        parts = [*parts, 0.5, 2]
    return _SOLIMP(parts)


_SOLREF_PARTS = ("solref.timeconst", "solref.dampratio", "solref.stiffness", "solref.damping")
_SOLIMP_PARTS = tuple(f"solimp.{part}" for part in ("dmin", "dmax", "width", "midpoint", "power"))
_FRICTION_PARTS = ("friction.slide", "friction.torsion", "friction.roll")
_TC, _DR, _K, _B = _SOLREF_PARTS
_E = "restitution"


def _parameter(  # noqa: PLR0913
    name: str,
    unit: str,
    description: str,
    parse: Parser,
    *,
    sets: str | None = None,
    update: Update | None = None,
    choices: tuple[str, ...] = (),
    conflicts: tuple[str, ...] = (),
    parts: tuple[str, ...] = (),
    split: Callable[[object], Mapping[str, float]] | None = None,
) -> Parameter:
    sets = sets or name
    axis = AxisSpec(name, unit, description, parse, choices, conflicts, parts, split)
    return Parameter(axis, sets, update or whole(sets))


_OPTION = [
    _parameter("timestep", "s", "length of a step", _POSITIVE),
    _parameter("integrator", "", "integrator", choice(INTEGRATORS), choices=INTEGRATORS),
    _parameter("cone", "", "friction cone", choice(CONES), choices=CONES),
    _parameter("solver", "", "constraint solver", choice(SOLVERS), choices=SOLVERS),
    _parameter("jacobian", "", "constraint Jacobian", choice(JACOBIANS), choices=JACOBIANS),
    _parameter("iterations", "1", "limit of solver iterations", integer(1)),
    _parameter("tolerance", "1", "solver's tolerance", number(least=0)),
    _parameter("ls_iterations", "1", "limit of line-search iterations", integer(1)),
    _parameter("ls_tolerance", "1", "line search's tolerance", number(least=0)),
    _parameter("noslip_iterations", "1", "limit of noslip iterations", integer(0)),
    _parameter("noslip_tolerance", "1", "noslip's tolerance", number(least=0)),
    _parameter("ccd_iterations", "1", "limit of collision iterations", integer(1)),
    _parameter("ccd_tolerance", "m", "collision's tolerance", number(least=0)),
    _parameter("impratio", "1", "frictional over normal impedance", or_off(1.0, _POSITIVE)),
    _parameter("density", "kg/m^3", "density of the medium", number(least=0)),
    _parameter("viscosity", "Pa s", "viscosity of the medium", number(least=0)),
    _parameter(
        "gravity", "m/s^2", "magnitude, or vector", or_off(0.0, _gravity_value), update=gravity
    ),
]

_SOLREF_AXES = [
    _parameter(
        "solref",
        "s 1",
        "contact reference",
        _SOLREF,
        conflicts=(*_SOLREF_PARTS, _E),
        parts=_SOLREF_PARTS,
        split=_solref_parts,
    ),
    _parameter(
        _TC, "s", "time constant", _POSITIVE, sets="solref", update=standard(0), conflicts=(_K, _B)
    ),
    _parameter(
        _DR, "1", "damping ratio", _POSITIVE, sets="solref", update=standard(1), conflicts=(_K, _B)
    ),
    _parameter(_K, "1/s^2", "stiffness K", _POSITIVE, sets="solref", update=direct(0)),
    _parameter(_B, "1/s", "damping B", number(least=0), sets="solref", update=direct(1)),
    _parameter(
        _E,
        "1",
        "restitution: the damping that gives it at the contact's natural frequency",
        number(above=0, most=1.0),
        sets="solref",
        update=restitution,
        conflicts=(_TC, _DR, _B),
    ),
]

_SOLIMP_AXES = [
    _parameter(
        "solimp",
        "1",
        "impedance",
        _solimp_value,
        conflicts=_SOLIMP_PARTS,
        parts=_SOLIMP_PARTS,
        split=partial(_parts, _SOLIMP_PARTS),
    ),
    *(
        _parameter(name, unit, text, parse, sets="solimp", update=part("solimp", (place,)))
        for place, (name, unit, text, parse) in enumerate(
            [
                (_SOLIMP_PARTS[0], "1", "impedance at zero depth", _SHARE),
                (_SOLIMP_PARTS[1], "1", "impedance at full depth", _SHARE),
                (_SOLIMP_PARTS[2], "m", "depth of full impedance", _POSITIVE),
                (_SOLIMP_PARTS[3], "1", "midpoint of the impedance curve", _SHARE),
                (_SOLIMP_PARTS[4], "1", "power of the impedance curve", number(least=1)),
            ]
        )
    ),
]

_FRICTION_AXES = [
    _parameter(
        "friction",
        "1 m m",
        "sliding, torsional and rolling friction",
        numbers(3, "slide torsion roll; for one of them, sweep friction.slide", _friction_mistake),
        update=friction,
        conflicts=_FRICTION_PARTS,
        parts=_FRICTION_PARTS,
        split=partial(_parts, _FRICTION_PARTS),
    ),
    *(
        _parameter(
            name, unit, text, number(least=0), sets="friction", update=part("friction", places)
        )
        for name, unit, text, places in [
            (_FRICTION_PARTS[0], "1", "sliding friction", (0, 1)),
            (_FRICTION_PARTS[1], "m", "torsional friction", (2,)),
            (_FRICTION_PARTS[2], "m", "rolling friction", (3, 4)),
        ]
    ),
]

_SHELL_AXES = [
    _parameter("condim", "1", "contact dimensions: 1, 3, 4 or 6", _condim),
    _parameter("margin", "m", "distance at which contact begins", number(least=0)),
    _parameter(
        "gap", "m", "distance beyond the margin at which contacts exist, forceless", number(least=0)
    ),
]

# The order is that of application: a restitution keeps the stiffness set before it.
_ALL = [*_OPTION, *_SOLREF_AXES, *_SOLIMP_AXES, *_FRICTION_AXES, *_SHELL_AXES]
PARAMETERS: dict[str, Parameter] = {each.axis.name: each for each in _ALL}
CONTACT_SETTINGS = ("solref", "solimp", "friction", "condim", "margin", "gap")
_RANK = {name: rank for rank, name in enumerate(PARAMETERS)}


def application_order(names: Iterable[str]) -> list[str]:
    """Return axes in the order in which their values are applied: parameters come first."""
    return sorted(names, key=lambda name: _RANK.get(name, len(_RANK)))
