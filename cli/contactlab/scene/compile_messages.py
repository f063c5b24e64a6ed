"""MuJoCo's reasons why a model does not compile, as: what, and what to write instead.

What it says of other mistakes stays, without the names of its internals.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path

import mujoco

from contactlab.errors import did_you_mean, suggestion

_PREFIX = re.compile(r"^(?:XML )?(?:Error: )*(?:Schema violation: )?")
_ELEMENT = re.compile(r"Element '([^']*)'")
_NAMED = re.compile(r"Element name '([^']*)'")
_PART = re.compile(r"^( *)(\w+) \(.\)\s+(.*)$")  # of the schema: an element, its first attributes
_WRITTEN = r"""(\w+)\s*=\s*["'](?:[^"']*\s)?{}(?:\s[^"']*)?["']"""
_URDF_JOINTS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_SYMBOLS = {"mjMINVAL": f"{mujoco.mjMINVAL:g}", "mjMAXVAL": "1e10"}


def in_words(lines: Sequence[str], model: Path) -> Iterator[str]:
    """Yield why a model does not compile, of what MuJoCo says in lines."""
    said = _PREFIX.sub("", lines[0])
    rest = " ".join(lines[1:])
    element = next(iter(_ELEMENT.findall(rest)), "")
    for pattern, words in _REASONS.items():
        if found := re.search(pattern, said):
            yield words(found, element, model)
            break
    else:
        for symbol, value in _SYMBOLS.items():
            said = said.replace(symbol, value)
        named = next(iter(_NAMED.findall(rest)), "")
        yield f"{named}: {said}" if named and named not in said else said
        yield from (line for line in lines[1:] if not _ELEMENT.search(line) and not named)


@cache
def _schema() -> Mapping[str, set[str]]:
    """Return the elements of MJCF, and the attributes that each may have."""
    found: dict[str, set[str]] = {}
    name = ""
    for line in mujoco.mj_printSchema(False, False).splitlines():
        if part := _PART.match(line):
            name, words = part[2], part[3]
        else:
            words = line
        found.setdefault(name, set()).update(words.split())
    return found


@cache
def _words() -> frozenset[str]:
    """Return the words that enumerations of MuJoCo have: `box`, `hinge`, `rk4`."""
    kinds = [getattr(mujoco, name) for name in dir(mujoco) if name.startswith("mjt")]
    members = [name for kind in kinds for name in getattr(kind, "__members__", ())]
    return frozenset(name.rpartition("_")[2].lower() for name in members)


def _no_element(_: re.Match[str], element: str, model: Path) -> str:
    del model
    known = did_you_mean(element, _schema()) or "; see MuJoCo's XML reference for those there are"
    return f"there is no element <{element}> here{known}"


def _no_attribute(found: re.Match[str], element: str, model: Path) -> str:
    del model
    known = _schema().get(element, set())
    hint = suggestion(found[1], known) or f"it takes {', '.join(sorted(known)) or 'none'}"
    return f"<{element}> has no attribute '{found[1]}'; {hint}"


def _no_word(found: re.Match[str], element: str, model: Path) -> str:
    written = re.search(_WRITTEN.format(re.escape(found[1])), model.read_text(errors="replace"))
    attribute = written[1] if written else "an attribute"
    known = _words() - {found[1].lower()}
    hint = did_you_mean(found[1], known) or "; see MuJoCo's XML reference for its words"
    return f"{attribute} of <{element}> cannot be '{found[1]}'{hint}"


def _no_number(found: re.Match[str], element: str, model: Path) -> str:
    del model
    return f"{found[1]} of <{element}> is no list of numbers; write them with spaces between"


def _size(found: re.Match[str], element: str, model: Path) -> str:
    del element, model
    count = int(found[1]) + 1
    return f"size of the {found[2]} needs a number above 0 in place {count}"


def _root(found: re.Match[str], element: str, model: Path) -> str:
    del element, model
    return f"this is <{found[1]}>, no model; MJCF begins with <mujoco>, URDF with <robot>"


def _twice(found: re.Match[str], element: str, model: Path) -> str:
    del element, model
    return f"a second {found[2]} is called '{found[1]}'; give it another name"


def _no_target(found: re.Match[str], element: str, model: Path) -> str:
    """Name the actuator's target that is missing, and the nearest name that the file has."""
    del element
    names = re.findall(r"""\sname\s*=\s*["']([^"']*)""", model.read_text(errors="replace"))
    near = did_you_mean(found[1], [name for name in names if name != found[1]])
    return f"an actuator moves '{found[1]}', which is not in the model{near or '; add it'}"


def _missing(found: re.Match[str], element: str, model: Path) -> str:
    del element, model
    add = f"<asset><{found[1]} name='{found[2]}' .../></asset>"
    remedy = f"add {add}" if found[1] in ("mesh", "hfield", "material", "texture") else "add it"
    return f"a {found[3]} names the {found[1]} '{found[2]}', which is not in the model; {remedy}"


def _no_file(found: re.Match[str], element: str, model: Path) -> str:
    del element, model
    return f"cannot open '{found[1]}'"


def _light(_: re.Match[str], element: str, model: Path) -> str:
    del element, model
    return "a body that moves has no mass or no inertia; give it a geom, or <inertial>"


def _no_joint(_: re.Match[str], element: str, model: Path) -> str:
    """Name the joint of a URDF whose type is none, and the nearest type."""
    del element
    types = re.findall(
        r"""<joint\b[^>]*\stype\s*=\s*["']([^"']*)""", model.read_text(errors="replace")
    )
    odd = next((each for each in types if each not in _URDF_JOINTS), "")
    hint = suggestion(odd, _URDF_JOINTS) or f"write one of {', '.join(_URDF_JOINTS)}"
    return f"type of <joint> cannot be '{odd}'; {hint}"


_REASONS: Mapping[str, Callable[[re.Match[str], str, Path], str]] = {
    r"unrecognized element": _no_element,
    r"unrecognized attribute: '([^']*)'": _no_attribute,
    r"invalid keyword: '([^']*)'": _no_word,
    r"bad format in attribute '([^']*)'": _no_number,
    r"problem reading attribute '([^']*)'": _no_number,
    r"size (\d) must be positive in (\w+)": _size,
    r"Unrecognized XML model type: '([^']*)'": _root,
    r"repeated name '([^']*)' in (\w+)": _twice,
    r"unknown transmission target '([^']*)'": _no_target,
    r"(\w+) '([^']*)' not found in (\w+)": _missing,
    r"rror opening file '([^']*)'": _no_file,
    r"invalid joint type in URDF": _no_joint,
    r"mass and inertia of moving bodies": _light,
}
"""Words for what MuJoCo says, by a pattern of it."""
