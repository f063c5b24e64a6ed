"""The parameters that every scene offers as axes: name, unit, how a value changes the settings.

Contact parameters are those of the monitored pairs; sources are MuJoCo's XML reference (option,
geom) and its Modeling chapter (solver parameters). `contactlab.mjcf` says where each stands.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, partial

import mujoco

from contactlab.contact.contact_laws import damping_ratio_of, stiffness_damping
from contactlab.mjcf import AT_REST, attribute_of
from contactlab.registry import Registry
from contactlab.scene.mujoco_versions import enum_members
from contactlab.schema.setting_values import (
    Parser,
    Settings,
    as_number,
    as_vector,
    choice,
    integer,
    number,
    numbers,
    or_off,
)
from contactlab.schema.vocabulary import AxisSpec

Update = Callable[[Settings, object], None]
Vector = tuple[float, ...]


@dataclass(frozen=True)
class Parameter(AxisSpec):
    """An axis, and how its parsed value updates the settings; None sets a setting as a whole."""

    update: Update | None = None

    @property
    def sets(self) -> str:
        """The setting that it changes, which is an attribute of MJCF."""
        return attribute_of(self.name)

    def write(self, settings: Settings, value: object) -> None:
        """Write a parsed value into the settings, other settings of its kind kept."""
        if self.update is None:
            settings[self.sets] = value
        else:
            self.update(settings, value)


PARAMETERS: Registry[Parameter] = Registry("parameter")
"""Every parameter, in the order in which values are applied."""

_SPELLED = {"EULER": "Euler", "RK4": "RK4", "PGS": "PGS", "CG": "CG", "NEWTON": "Newton"}


def _words(enum: object, prefix: str) -> tuple[str, ...]:
    """Return the words of one of MuJoCo's enums as MJCF spells them, for as many as it has."""
    return tuple(_SPELLED.get(name, name.lower()) for name in enum_members(enum, prefix))


WORDS: Mapping[str, tuple[str, ...]] = {
    "integrator": _words(mujoco.mjtIntegrator, "mjINT_"),
    "cone": _words(mujoco.mjtCone, "mjCONE_"),
    "solver": _words(mujoco.mjtSolver, "mjSOL_"),
    "jacobian": _words(mujoco.mjtJacobian, "mjJAC_"),
}
"""The words of each option that takes one, in the order of the engine's enum."""


def _set_places(
    name: str, *places: int, form: Callable[[Vector], Vector] = tuple, sign: float = 1.0
) -> Update:
    """Set some of a setting's numbers, once it has a form, to one value."""

    def update(settings: Settings, value: object) -> None:
        current = list(form(as_vector(settings[name])))
        for place in places:
            current[place] = sign * as_number(value)
        settings[name] = tuple(current)

    return update


def _standard_form(solref: Vector) -> Vector:
    """Return a solref in standard form; a direct form is left for MuJoCo's default."""
    return solref if solref[0] > 0 else (0.02, 1.0)


def _direct_form(solref: Vector) -> Vector:
    """Return a solref in direct form; a standard form is turned into its equal."""
    if solref[0] <= 0:
        return solref
    stiffness, damping = stiffness_damping(solref)
    return -float(stiffness), -float(damping)


_damping_ratio = cache(damping_ratio_of)


def _set_restitution(settings: Settings, value: object) -> None:
    """Keep the contact's natural frequency w and set the damping that restitution asks for."""
    stiffness = -_direct_form(as_vector(settings["solref"]))[0]
    damping = 2.0 * float(_damping_ratio(as_number(value))) * stiffness**0.5
    settings["solref"] = (-stiffness, -damping)


def _set_gravity(settings: Settings, value: object) -> None:
    """Set gravity by its magnitude [m/s^2], downwards, or by its vector."""
    settings["gravity"] = (0.0, 0.0, -value) if isinstance(value, float) else value


def _set_friction(settings: Settings, value: object) -> None:
    """Set the contact's five coefficients by the three that MJCF gives a geom."""
    slide, torsion, roll = as_vector(value)
    settings["friction"] = (slide, slide, torsion, roll, roll)


def _parse_gravity(value: object) -> object:
    try:
        return number(least=0)(value)
    except ValueError:
        return numbers(3, "x y z, or one magnitude downwards", lambda _: None)(value)


def _parse_condim(value: object) -> int:
    parsed = integer(1, 6)(value)
    if parsed not in (1, 3, 4, 6):
        raise ValueError(f"write 1, 3, 4 or 6, not {value!r}")
    return parsed


def _parse_solimp(value: object) -> object:
    """Read five numbers; MJCF's defaults fill in for three."""
    parts = value.split() if isinstance(value, str) else value
    if isinstance(parts, (list, tuple)) and len(parts) == 3:
        parts = [*parts, 0.5, 2]
    return numbers(5, "dmin dmax width midpoint power", _solimp_mistake)(parts)


def _solref_mistake(value: tuple[float, ...]) -> str | None:
    if (value[0] > 0 and value[1] > 0) or (value[0] <= 0 and value[1] <= 0 and any(value)):
        return None
    return 'write "timeconst dampratio", both positive, or "-stiffness -damping", both negative'


def _solimp_mistake(value: tuple[float, ...]) -> str | None:
    dmin, dmax, width, midpoint, power = value
    if 0 < dmin < 1 and 0 < dmax < 1 and width > 0 and 0 < midpoint < 1 and power >= 1:
        return None
    return "write dmin, dmax and midpoint between 0 and 1, width above 0, power of at least 1"


def _friction_mistake(value: tuple[float, ...]) -> str | None:
    return None if min(value) >= 0 else "write friction coefficients of at least 0"


def _split_solref(value: object) -> dict[str, float]:
    """Name the parts of a solref by its form; the other form's are absent."""
    first, second = as_vector(value)
    if first > 0:
        return dict(zip(_STANDARD, (first, second), strict=True))
    return dict(zip(_DIRECT, (-first, -second), strict=True))


def _word(name: str, description: str) -> Parameter:
    return Parameter(name, "", description, choice(WORDS[name]), WORDS[name])


def _part(name: str, unit: str, description: str, parse: Parser, *places: int) -> Parameter:
    """Return the parameter of one number of a setting, which stands in some places."""
    return Parameter(
        name, unit, description, parse, update=_set_places(attribute_of(name), *places)
    )


def _split(parts: tuple[str, ...], value: object) -> dict[str, float]:
    return dict(zip(parts, as_vector(value), strict=True))


_set_standard = partial(_set_places, "solref", form=_standard_form)
_set_direct = partial(_set_places, "solref", form=_direct_form, sign=-1.0)
_POSITIVE = number(above=0)
_NOT_NEGATIVE = number(least=0)
_SHARE = number(above=0, most=0.9999)
_STANDARD, _DIRECT = (
    ("solref.timeconst", "solref.dampratio"),
    ("solref.stiffness", "solref.damping"),
)
_SOLIMP = tuple(f"solimp.{part}" for part in ("dmin", "dmax", "width", "midpoint", "power"))
_FRICTION = ("friction.slide", "friction.torsion", "friction.roll")

# The order is that of application: a restitution keeps the stiffness set before it.
for parameter in (
    Parameter("timestep", "s", "length of a step", _POSITIVE),
    _word("integrator", "integrator"),
    _word("cone", "friction cone"),
    _word("solver", "constraint solver"),
    _word("jacobian", "constraint Jacobian"),
    Parameter("iterations", "1", "most solver iterations", integer(1)),
    Parameter("tolerance", "1", "solver tolerance", _NOT_NEGATIVE),
    Parameter("ls_iterations", "1", "most line-search iterations", integer(1)),
    Parameter("ls_tolerance", "1", "line-search tolerance", _NOT_NEGATIVE),
    Parameter("noslip_iterations", "1", "most noslip iterations", integer(0)),
    Parameter("noslip_tolerance", "1", "noslip tolerance", _NOT_NEGATIVE),
    Parameter("ccd_iterations", "1", "most iterations of convex collision detection", integer(1)),
    Parameter("ccd_tolerance", "m", "tolerance of convex collision detection", _NOT_NEGATIVE),
    Parameter("impratio", "1", "ratio of frictional to normal impedance", or_off(1.0, _POSITIVE)),
    Parameter("density", "kg/m^3", "density of the medium", _NOT_NEGATIVE),
    Parameter("viscosity", "Pa s", "viscosity of the medium", _NOT_NEGATIVE),
    Parameter(
        "gravity",
        "m/s^2",
        "magnitude downwards, or vector",
        or_off(0.0, _parse_gravity),
        update=_set_gravity,
    ),
    Parameter(
        "solref",
        "s 1",
        "contact reference: time constant and damping ratio, or -stiffness and -damping",
        numbers(2, "timeconst dampratio", _solref_mistake),
        conflicts=(*_STANDARD, *_DIRECT, "restitution"),
        parts=(*_STANDARD, *_DIRECT),
        split=_split_solref,
    ),
    Parameter(_STANDARD[0], "s", "time constant", _POSITIVE, (), _DIRECT, update=_set_standard(0)),
    Parameter(_STANDARD[1], "1", "damping ratio", _POSITIVE, (), _DIRECT, update=_set_standard(1)),
    Parameter(_DIRECT[0], "1/s^2", "stiffness K", _POSITIVE, update=_set_direct(0)),
    Parameter(_DIRECT[1], "1/s", "damping B", _NOT_NEGATIVE, update=_set_direct(1)),
    Parameter(
        "restitution",
        "1",
        "restitution: sets the damping that produces it at the contact's natural frequency",
        number(above=0, most=1.0),
        conflicts=(*_STANDARD, _DIRECT[1]),
        update=_set_restitution,
    ),
    Parameter(
        "solimp",
        "1",
        "contact impedance",
        _parse_solimp,
        conflicts=_SOLIMP,
        parts=_SOLIMP,
        split=partial(_split, _SOLIMP),
    ),
    _part("solimp.dmin", "1", "impedance at zero depth", _SHARE, 0),
    _part("solimp.dmax", "1", "impedance at full depth", _SHARE, 1),
    _part("solimp.width", "m", "depth of full impedance", _POSITIVE, 2),
    _part("solimp.midpoint", "1", "midpoint of the impedance curve", _SHARE, 3),
    _part("solimp.power", "1", "power of the impedance curve", number(least=1), 4),
    Parameter(
        "friction",
        "1 m m",
        "sliding, torsional and rolling friction",
        numbers(3, "slide torsion roll; for one of them, sweep friction.slide", _friction_mistake),
        conflicts=_FRICTION,
        parts=_FRICTION,
        split=partial(_split, _FRICTION),
        update=_set_friction,
    ),
    _part("friction.slide", "1", "sliding friction", _NOT_NEGATIVE, 0, 1),
    _part("friction.torsion", "m", "torsional friction", _NOT_NEGATIVE, 2),
    _part("friction.roll", "m", "rolling friction", _NOT_NEGATIVE, 3, 4),
    Parameter("condim", "1", "contact dimensions: 1, 3, 4 or 6", _parse_condim),
    Parameter("margin", "m", "distance at which contact begins", _NOT_NEGATIVE),
    Parameter(
        "stiffness",
        AT_REST["stiffness"],
        "load over depth of one contact, of any load: sets solref, and dmin of solimp to dmax",
        _POSITIVE,
        conflicts=("solref", _STANDARD[0], *_DIRECT, "solimp.dmin", "depth_at_rest"),
    ),
    Parameter(
        "depth_at_rest",
        AT_REST["depth_at_rest"],
        "depth of contacts under what they bear where the model is written: sets solref",
        _POSITIVE,
        conflicts=("solref", _STANDARD[0], *_DIRECT),
    ),
    Parameter(
        "gap",
        "m",
        "distance beyond the margin within which contacts exist but exert no force",
        _NOT_NEGATIVE,
    ),
):
    PARAMETERS.add(parameter)
_RANK = {name: rank for rank, name in enumerate(PARAMETERS)}


def application_order(names: Iterable[str]) -> list[str]:
    """Return axes in the order in which their values are applied: parameters come first."""
    return sorted(names, key=lambda name: _RANK.get(name, len(_RANK)))
