"""A configuration as lines of MJCF."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from contactlab.schema import EvidenceRecord, Setting

OPTIONS = frozenset(
    (
        *("timestep", "integrator", "cone", "solver", "jacobian", "impratio", "gravity", "wind"),
        *("iterations", "tolerance", "ls_iterations", "ls_tolerance"),
        *("noslip_iterations", "noslip_tolerance", "ccd_iterations", "ccd_tolerance"),
        *("density", "viscosity"),
    )
)
GEOM = frozenset(("solref", "solimp", "friction", "condim", "margin", "gap"))
FLAGS = frozenset(
    (
        *("actuation", "clampctrl", "constraint", "contact", "damper", "diagexact", "equality"),
        *("eulerdamp", "filterparent", "frictionloss", "gravity", "invdiscrete", "island"),
        *("limit", "midphase", "multiccd", "nativeccd", "passive", "refsafe", "sleep"),
        *("speculative", "spring", "warmstart"),
    )
)
_SOLREF = "restitution"


@dataclass(frozen=True)
class MjcfLines:
    """What sets a configuration in a model.

    Attributes:
        mjcf: lines to put below `<mujoco>`; a geom's own attributes go over its defaults.
        other: knobs that are neither options, nor switches, nor defaults of geoms.
    """

    mjcf: tuple[str, ...]
    other: dict[str, Setting]


def mjcf_lines(knobs: Collection[str], record: EvidenceRecord) -> MjcfLines:
    """Return the lines that set some knobs as a run had them.

    Args:
        knobs: names of axes; `solref.timeconst` and the like stand for the whole attribute.
        record: a run of the configuration, for the resolved settings.
    """
    flags = {
        name: value
        for name in knobs
        if name in FLAGS and isinstance(value := record.axes.get(name), bool)
    }
    sets = {name: _attribute(name) for name in knobs if name not in flags}
    options = {name: record.settings[name] for name in sets.values() if name in OPTIONS}
    geom = {name: _geom(name, record.settings[name]) for name in sets.values() if name in GEOM}
    return MjcfLines(
        mjcf=(*_option_lines(options, flags), *_default_lines(geom)),
        other={name: record.axes[name] for name, to in sets.items() if to not in OPTIONS | GEOM},
    )


def _attribute(axis: str) -> str:
    return "solref" if axis == _SOLREF else axis.partition(".")[0]


def _option_lines(options: Mapping[str, Setting], flags: Mapping[str, bool]) -> list[str]:
    if not flags:
        return [f"<option{_written(options)}/>"] if options else []
    words = {name: "enable" if state else "disable" for name, state in flags.items()}
    return [f"<option{_written(options)}>", f"  <flag{_written(words)}/>", "</option>"]


def _default_lines(geom: Mapping[str, Setting]) -> list[str]:
    return ["<default>", f"  <geom{_written(geom)}/>", "</default>"] if geom else []


def _geom(name: str, value: Setting) -> Setting:
    """Return a setting as a geom has it: of the five frictions of a pair, the three of a geom."""
    if name == "friction" and isinstance(value, tuple) and len(value) == 5:
        return value[0], value[2], value[3]
    return value


def _written(attributes: Mapping[str, Setting]) -> str:
    return "".join(f" {name}={quoteattr(_text(value))}" for name, value in attributes.items())


def _text(value: Setting) -> str:
    if isinstance(value, tuple):
        return " ".join(_text(each) for each in value)
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)
