"""The parameters that every scene offers as axes: name, unit, effect on the settings.

Contact parameters are those of the monitored pairs. Sources are MuJoCo's XML reference (option,
geom) and its Modeling chapter (solver parameters). `contactlab.mjcf` gives each one's MJCF element.
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
    choice_parser,
    integer_parser,
    nonnegative_number,
    number_parser,
    or_off,
    positive_number,
    vector_parser,
)
from contactlab.schema.vocabulary import AxisSpec

Update = Callable[[Settings, object], None]
Vector = tuple[float, ...]


@dataclass(frozen=True)
class Parameter(AxisSpec):
    """An axis with the function that writes its parsed value into the settings.

    Without the function, the value replaces the whole setting.
    """

    update: Update | None = None

    @property
    def sets(self) -> str:
        """The setting that it changes, an attribute of MJCF."""
        return attribute_of(self.name)

    def write_value(self, settings: Settings, value: object) -> None:
        """Write a parsed value into the settings, and keep other settings of its kind."""
        if self.update is None:
            settings[self.sets] = value
        else:
            self.update(settings, value)


PARAMETERS: Registry[Parameter] = Registry("parameter")
"""Every parameter, in the order of application."""

_MJCF_SPELLING = {"EULER": "Euler", "RK4": "RK4", "PGS": "PGS", "CG": "CG", "NEWTON": "Newton"}


def _enum_keywords(enum: object, prefix: str) -> tuple[str, ...]:
    return tuple(_MJCF_SPELLING.get(name, name.lower()) for name in enum_members(enum, prefix))


WORDS: Mapping[str, tuple[str, ...]] = {
    "integrator": _enum_keywords(mujoco.mjtIntegrator, "mjINT_"),
    "cone": _enum_keywords(mujoco.mjtCone, "mjCONE_"),
    "solver": _enum_keywords(mujoco.mjtSolver, "mjSOL_"),
    "jacobian": _enum_keywords(mujoco.mjtJacobian, "mjJAC_"),
}
"""The keywords of each option that takes one, in the order of the engine's enum."""


def _set_numbers(
    name: str, *places: int, form: Callable[[Vector], Vector] = tuple, sign: float = 1.0
) -> Update:
    """Return the update that sets some numbers of a setting, converted by `form`, to a value."""

    def update(settings: Settings, value: object) -> None:
        current = list(form(as_vector(settings[name])))
        for place in places:
            current[place] = sign * as_number(value)
        settings[name] = tuple(current)

    return update


def _standard_form(solref: Vector) -> Vector:
    """Return a solref in standard form; MuJoCo's default replaces a direct form."""
    return solref if solref[0] > 0 else (0.02, 1.0)


def _direct_form(solref: Vector) -> Vector:
    """Return a solref in direct form; a standard form is converted to its equal."""
    if solref[0] <= 0:
        return solref
    stiffness, damping = stiffness_damping(solref)
    return -float(stiffness), -float(damping)


_damping_ratio = cache(damping_ratio_of)


def _set_restitution(settings: Settings, value: object) -> None:
    """Keep the contact's natural frequency w and set the damping for a restitution."""
    stiffness = -_direct_form(as_vector(settings["solref"]))[0]
    damping = 2.0 * float(_damping_ratio(as_number(value))) * stiffness**0.5
    settings["solref"] = (-stiffness, -damping)


def _set_gravity(settings: Settings, value: object) -> None:
    """Set gravity by its magnitude [m/s^2], downwards, or by its vector."""
    settings["gravity"] = (0.0, 0.0, -value) if isinstance(value, float) else value


def _set_friction(settings: Settings, value: object) -> None:
    """Set the contact's five coefficients from the three of a geom in MJCF."""
    slide, torsion, roll = as_vector(value)
    settings["friction"] = (slide, slide, torsion, roll, roll)


def _parse_gravity(value: object) -> object:
    try:
        return number_parser(least=0)(value)
    except ValueError:
        return vector_parser(3, "x y z, or one magnitude downwards", lambda _: None)(value)


def _parse_condim(value: object) -> int:
    dimension = integer_parser(1, 6)(value)
    if dimension not in (1, 3, 4, 6):
        raise ValueError(f"write 1, 3, 4 or 6, not {value!r}")
    return dimension


def _parse_solimp(value: object) -> object:
    """Read five numbers, or three completed with MJCF's defaults."""
    parts = value.split() if isinstance(value, str) else value
    if isinstance(parts, (list, tuple)) and len(parts) == 3:
        parts = [*parts, 0.5, 2]
    return vector_parser(5, "dmin dmax width midpoint power", _solimp_mistake)(parts)


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
    """Return the named parts of a solref in its form; parts of the other form are absent."""
    first, second = as_vector(value)
    if first > 0:
        return dict(zip(_STANDARD_PARTS, (first, second), strict=True))
    return dict(zip(_DIRECT_PARTS, (-first, -second), strict=True))


def _keyword_parameter(name: str, description: str) -> Parameter:
    return Parameter(name, "", description, choice_parser(WORDS[name]), WORDS[name])


def _number_parameter(
    name: str, unit: str, description: str, parse: Parser, *places: int
) -> Parameter:
    """Return the parameter of one number of a setting, which may have several indices."""
    return Parameter(
        name, unit, description, parse, update=_set_numbers(attribute_of(name), *places)
    )


def _split_vector(parts: tuple[str, ...], value: object) -> dict[str, float]:
    return dict(zip(parts, as_vector(value), strict=True))


_set_standard = partial(_set_numbers, "solref", form=_standard_form)
_set_direct = partial(_set_numbers, "solref", form=_direct_form, sign=-1.0)
_OPEN_FRACTION = number_parser(above=0, most=0.9999)
_STANDARD_PARTS, _DIRECT_PARTS = (
    ("solref.timeconst", "solref.dampratio"),
    ("solref.stiffness", "solref.damping"),
)
_SOLIMP_PARTS = tuple(f"solimp.{part}" for part in ("dmin", "dmax", "width", "midpoint", "power"))
_FRICTION_PARTS = ("friction.slide", "friction.torsion", "friction.roll")

# The order is that of application: a restitution keeps the stiffness set before it.
for parameter in (
    Parameter("timestep", "s", "length of a step", positive_number),
    _keyword_parameter("integrator", "integrator"),
    _keyword_parameter("cone", "friction cone"),
    _keyword_parameter("solver", "constraint solver"),
    _keyword_parameter("jacobian", "constraint Jacobian"),
    Parameter("iterations", "1", "most solver iterations", integer_parser(1)),
    Parameter("tolerance", "1", "solver tolerance", nonnegative_number),
    Parameter("ls_iterations", "1", "most line-search iterations", integer_parser(1)),
    Parameter("ls_tolerance", "1", "line-search tolerance", nonnegative_number),
    Parameter("noslip_iterations", "1", "most noslip iterations", integer_parser(0)),
    Parameter("noslip_tolerance", "1", "noslip tolerance", nonnegative_number),
    Parameter(
        "ccd_iterations", "1", "most iterations of convex collision detection", integer_parser(1)
    ),
    Parameter("ccd_tolerance", "m", "tolerance of convex collision detection", nonnegative_number),
    Parameter("sdf_iterations", "1", "iterations in a signed distance field", integer_parser(1)),
    Parameter("sdf_initpoints", "1", "searches in a signed distance field", integer_parser(1)),
    Parameter(
        "impratio", "1", "ratio of frictional to normal impedance", or_off(1.0, positive_number)
    ),
    Parameter("density", "kg/m^3", "density of the medium", nonnegative_number),
    Parameter("viscosity", "Pa s", "viscosity of the medium", nonnegative_number),
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
        vector_parser(2, "timeconst dampratio", _solref_mistake),
        conflicts=(*_STANDARD_PARTS, *_DIRECT_PARTS, "restitution"),
        parts=(*_STANDARD_PARTS, *_DIRECT_PARTS),
        split=_split_solref,
    ),
    Parameter(
        _STANDARD_PARTS[0],
        "s",
        "time constant",
        positive_number,
        (),
        _DIRECT_PARTS,
        update=_set_standard(0),
    ),
    Parameter(
        _STANDARD_PARTS[1],
        "1",
        "damping ratio",
        positive_number,
        (),
        _DIRECT_PARTS,
        update=_set_standard(1),
    ),
    Parameter(_DIRECT_PARTS[0], "1/s^2", "stiffness K", positive_number, update=_set_direct(0)),
    Parameter(_DIRECT_PARTS[1], "1/s", "damping B", nonnegative_number, update=_set_direct(1)),
    Parameter(
        "restitution",
        "1",
        "restitution: sets the damping that produces it at the contact's natural frequency",
        number_parser(above=0, most=1.0),
        conflicts=(*_STANDARD_PARTS, _DIRECT_PARTS[1]),
        update=_set_restitution,
    ),
    Parameter(
        "solimp",
        "1",
        "contact impedance",
        _parse_solimp,
        conflicts=_SOLIMP_PARTS,
        parts=_SOLIMP_PARTS,
        split=partial(_split_vector, _SOLIMP_PARTS),
    ),
    _number_parameter("solimp.dmin", "1", "impedance at zero depth", _OPEN_FRACTION, 0),
    _number_parameter("solimp.dmax", "1", "impedance at full depth", _OPEN_FRACTION, 1),
    _number_parameter("solimp.width", "m", "depth of full impedance", positive_number, 2),
    _number_parameter("solimp.midpoint", "1", "midpoint of the impedance curve", _OPEN_FRACTION, 3),
    _number_parameter(
        "solimp.power", "1", "power of the impedance curve", number_parser(least=1), 4
    ),
    Parameter(
        "friction",
        "1 m m",
        "sliding, torsional and rolling friction",
        vector_parser(
            3, "slide torsion roll; for one of them, sweep friction.slide", _friction_mistake
        ),
        conflicts=_FRICTION_PARTS,
        parts=_FRICTION_PARTS,
        split=partial(_split_vector, _FRICTION_PARTS),
        update=_set_friction,
    ),
    _number_parameter("friction.slide", "1", "sliding friction", nonnegative_number, 0, 1),
    _number_parameter("friction.torsion", "m", "torsional friction", nonnegative_number, 2),
    _number_parameter("friction.roll", "m", "rolling friction", nonnegative_number, 3, 4),
    Parameter("condim", "1", "contact dimensions: 1, 3, 4 or 6", _parse_condim),
    Parameter("margin", "m", "distance at which contact begins", nonnegative_number),
    Parameter(
        "stiffness",
        AT_REST["stiffness"],
        "load over depth of one contact, of any load: sets solref, and dmin of solimp to dmax",
        positive_number,
        conflicts=("solref", _STANDARD_PARTS[0], *_DIRECT_PARTS, "solimp.dmin", "depth_at_rest"),
    ),
    Parameter(
        "depth_at_rest",
        AT_REST["depth_at_rest"],
        "depth of contacts under their load at the start of the model: sets solref",
        positive_number,
        conflicts=("solref", _STANDARD_PARTS[0], *_DIRECT_PARTS),
    ),
    Parameter(
        "gap",
        "m",
        "distance beyond the margin within which contacts exist but exert no force",
        nonnegative_number,
    ),
):
    PARAMETERS.add(parameter)
_APPLICATION_RANK = {name: rank for rank, name in enumerate(PARAMETERS)}


def application_order(names: Iterable[str]) -> list[str]:
    """Return axes in the order of application of their values; parameters come first."""
    return sorted(names, key=lambda name: _APPLICATION_RANK.get(name, len(_APPLICATION_RANK)))
