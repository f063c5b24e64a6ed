"""The MJCF attributes of settings, and the lines that set them; imports no engine.

Source: MuJoCo's XML reference (option, flag, geom, pair).
"""

from collections.abc import Iterable, Mapping
from xml.sax.saxutils import quoteattr

OPTIONS = (
    *("timestep", "tolerance", "ls_tolerance", "noslip_tolerance", "ccd_tolerance", "impratio"),
    *("density", "viscosity", "iterations", "ls_iterations", "noslip_iterations"),
    *("ccd_iterations", "gravity", "wind", "integrator", "cone", "solver", "jacobian"),
)
"""Attributes of <option>."""

CONTACT = ("solref", "solimp", "friction", "condim", "margin", "gap")
"""Attributes of both <geom> and <pair>."""

FLAGS = frozenset(
    (
        *("actuation", "clampctrl", "constraint", "contact", "damper", "diagexact", "equality"),
        *("eulerdamp", "filterparent", "frictionloss", "gravity", "invdiscrete", "island"),
        *("limit", "midphase", "multiccd", "nativeccd", "passive", "refsafe", "sleep"),
        *("speculative", "spring", "warmstart"),
    )
)
"""Attributes of <flag> that a run may set, of every version of MuJoCo from 3.3 on."""


def attribute_of(axis: str) -> str:
    """Return the attribute that an axis sets: `solref` for `solref.timeconst`, or its own name."""
    return "solref" if axis == "restitution" else axis.partition(".")[0]


def option_lines(options: Mapping[str, str], flags: Mapping[str, bool]) -> list[str]:
    """Return the lines of an <option> with these attributes and flags; none without any."""
    if not flags:
        return [f"<option{attributes(options)}/>"] if options else []
    words = {name: "enable" if state else "disable" for name, state in flags.items()}
    return [f"<option{attributes(options)}>", f"  <flag{attributes(words)}/>", "</option>"]


def default_lines(
    contact: Mapping[str, str], elements: Iterable[str] = ("geom",), comment: str = ""
) -> list[str]:
    """Return the lines of a <default> of these elements, each with the comment behind it.

    There are none without contact parameters.
    """
    if not contact:
        return []
    behind = f" <!-- {comment} -->" if comment else ""
    written = [f"  <{element}{attributes(contact)}/>{behind}" for element in elements]
    return ["<default>", *written, "</default>"]


def attributes(values: Mapping[str, str]) -> str:
    """Return attributes as written in an element, each preceded by a space."""
    return "".join(f" {name}={quoteattr(value)}" for name, value in values.items())
