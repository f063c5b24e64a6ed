"""Explains why a model does not compile: the mistake, and the correction.

Other messages of MuJoCo are kept, without the names of its internals.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path

import mujoco

from contactlab.errors import did_you_mean, suggestion

_MESSAGE_PREFIX = re.compile(r"^(?:XML )?(?:Error: )*(?:Schema violation: )?")
_ELEMENT_TAG = re.compile(r"Element '([^']*)'")
_ELEMENT_NAME = re.compile(r"Element name '([^']*)'")
# A line of the schema with an element and its first attributes.
_SCHEMA_ELEMENT = re.compile(r"^( *)(?:\(world\))?(\w+) \(.\)\s+(.*)$")
_ATTRIBUTE_WITH_VALUE = r"""(\w+)\s*=\s*["'](?:[^"']*\s)?{}(?:\s[^"']*)?["']"""
_URDF_JOINTS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
# Elements, and attributes of elements, that MuJoCo read before a version, and the correction. Its
# changelog is the source.
_OMIT = "omit it, since it has no effect"
_REMOVED_NAMES = {
    ("composite", ""): ("4.0.0", 'write <flexcomp dim="1"> with <elasticity>'),
    ("flexvert", ""): ("4.0.0", "write <elasticity> in the <flex>"),
    ("contact", "internal"): ("3.15.0", "omit it, or write selfcollide"),
    ("camera", "orthographic"): ("3.5.0", 'write projection="orthographic" for "true"'),
    ("option", "apirate"): ("3.3.7", _OMIT),
    ("flag", "passive"): ("3.3.6", "write it as spring and as damper"),
    ("compiler", "exactmeshinertia"): ("3.2.5", 'write inertia="exact" in each <mesh> for "true"'),
    ("compiler", "convexhull"): ("3.2.5", _OMIT),
    ("option", "mpr_iterations"): ("3.2.3", "write it as ccd_iterations"),
    ("option", "mpr_tolerance"): ("3.2.3", "write it as ccd_tolerance"),
    ("flag", "sensornoise"): ("3.1.4", "omit it; your program adds the noise"),
    ("joint", "actuatorforcerange"): ("3.0.0", "write it as actuatorfrcrange"),
    ("joint", "actuatorforcelimited"): ("3.0.0", "write it as actuatorfrclimited"),
    ("option", "collision"): ("3.0.0", "omit it; contype and conaffinity choose the pairs"),
}
_SYMBOL_VALUES = {"mjMINVAL": f"{mujoco.mjMINVAL:g}", "mjMAXVAL": "1e10"}


def explain_compile_error(lines: Sequence[str], model: Path) -> Iterator[str]:
    """Yield the reasons why a model does not compile, from the lines of MuJoCo's error."""
    message = _MESSAGE_PREFIX.sub("", lines[0])
    rest = " ".join(lines[1:])
    element = next(iter(_ELEMENT_TAG.findall(rest)), "")
    for pattern, words in _ERROR_EXPLANATIONS.items():
        if match := re.search(pattern, message):
            yield words(match, element, model)
            break
    else:
        for symbol, value in _SYMBOL_VALUES.items():
            message = message.replace(symbol, value)
        element_name = next(iter(_ELEMENT_NAME.findall(rest)), "")
        yield (
            f"{element_name}: {message}"
            if element_name and element_name not in message
            else message
        )
        yield from (
            line for line in lines[1:] if not _ELEMENT_TAG.search(line) and not element_name
        )


@cache
def _mjcf_schema() -> Mapping[str, Mapping[str, set[str]]]:
    # The attributes of an element, by the element around it.
    schema: dict[str, dict[str, set[str]]] = {}
    path: list[tuple[int, str]] = []
    for line in mujoco.mj_printSchema(False, False).splitlines():
        words = line
        if part := _SCHEMA_ELEMENT.match(line):
            depth, name, words = len(part[1]), part[2], part[3]
            path = [*((at, outer) for at, outer in path if at < depth), (depth, name)]
        *_, outer, inner = ("", *(name for _, name in path))
        schema.setdefault(inner, {}).setdefault(outer, set()).update(words.split())
    return schema


@cache
def _enum_keywords() -> frozenset[str]:
    kinds = [getattr(mujoco, name) for name in dir(mujoco) if name.startswith("mjt")]
    members = [name for kind in kinds for name in getattr(kind, "__members__", ())]
    return frozenset(name.rpartition("_")[2].lower() for name in members)


def _removal_text(element: str, attribute: str = "") -> str:
    version, correction = _REMOVED_NAMES.get((element, attribute), ("", ""))
    name = f"'{attribute}' of <{element}>" if attribute else f"<{element}>"
    return f"MuJoCo {version} removed {name}: {correction}" if version else ""


def _unknown_element_text(_: re.Match[str], element: str, model: Path) -> str:
    del model
    if removal := _removal_text(element):
        return removal
    hint = did_you_mean(element, _mjcf_schema()) or "; see MuJoCo's XML reference for all elements"
    return f"there is no element <{element}> here{hint}"


def _unknown_attribute_text(match: re.Match[str], element: str, model: Path) -> str:
    del model
    if removal := _removal_text(element, match[1]):
        return removal
    places = _mjcf_schema().get(element, {})
    if others := [outer for outer, names in places.items() if match[1] in names]:
        # The line's own place is another one.
        return f"<{element}> takes '{match[1]}' only in <{'> or <'.join(others)}>, not here"
    attributes = {name for names in places.values() for name in names}
    hint = suggestion(match[1], attributes) or f"it takes {', '.join(sorted(attributes)) or 'none'}"
    return f"<{element}> has no attribute '{match[1]}'; {hint}"


def _unknown_keyword_text(match: re.Match[str], element: str, model: Path) -> str:
    attribute_match = re.search(
        _ATTRIBUTE_WITH_VALUE.format(re.escape(match[1])), model.read_text(errors="replace")
    )
    attribute = attribute_match[1] if attribute_match else "an attribute"
    keywords = _enum_keywords() - {match[1].lower()}
    hint = did_you_mean(match[1], keywords) or "; see MuJoCo's XML reference for its keywords"
    return f"{attribute} of <{element}> cannot be '{match[1]}'{hint}"


def _bad_number_text(match: re.Match[str], element: str, model: Path) -> str:
    del model
    return f"{match[1]} of <{element}> is not a list of numbers; separate numbers by spaces"


def _short_list_text(match: re.Match[str], element: str, model: Path) -> str:
    del model
    needed = f"; {match[1]} needs two, least and greatest" if "range" in match[1] else ""
    return f"{match[1]} of <{element}> has too few numbers{needed}"


def _bad_size_text(match: re.Match[str], element: str, model: Path) -> str:
    del element, model
    count = int(match[1]) + 1
    return f"size of the {match[2]} needs a number above 0 in place {count}"


def _wrong_root_text(match: re.Match[str], element: str, model: Path) -> str:
    del element, model
    return f"<{match[1]}> is not a model; MJCF begins with <mujoco>, URDF with <robot>"


def _duplicate_name_text(match: re.Match[str], element: str, model: Path) -> str:
    del element, model
    return f"a second {match[2]} is called '{match[1]}'; give it another name"


def _unknown_target_text(match: re.Match[str], element: str, model: Path) -> str:
    del element
    names = re.findall(r"""\sname\s*=\s*["']([^"']*)""", model.read_text(errors="replace"))
    near = did_you_mean(match[1], [name for name in names if name != match[1]])
    return f"an actuator moves '{match[1]}', which is not in the model{near or '; add it'}"


def _missing_object_text(match: re.Match[str], element: str, model: Path) -> str:
    del element, model
    add = f"<asset><{match[1]} name='{match[2]}' .../></asset>"
    remedy = f"add {add}" if match[1] in ("mesh", "hfield", "material", "texture") else "add it"
    return f"a {match[3]} names the {match[1]} '{match[2]}', which is not in the model; {remedy}"


def _unreadable_file_text(match: re.Match[str], element: str, model: Path) -> str:
    del element, model
    return f"cannot open '{match[1]}'"


def _impossible_inertia_text(_: re.Match[str], element: str, model: Path) -> str:
    del element
    compiler = '<compiler balanceinertia="true"/>'
    correction = f"<mujoco>{compiler}</mujoco> in <robot>" if model.suffix == ".urdf" else compiler
    return f"an inertia must satisfy A + B >= C: correct it; {correction} writes the mean instead"


def _massless_body_text(_: re.Match[str], element: str, model: Path) -> str:
    del element, model
    return "a body that moves has no mass or no inertia; give it a geom, or <inertial>"


def _bad_joint_type_text(_: re.Match[str], element: str, model: Path) -> str:
    del element
    types = re.findall(
        r"""<joint\b[^>]*\stype\s*=\s*["']([^"']*)""", model.read_text(errors="replace")
    )
    odd = next((each for each in types if each not in _URDF_JOINTS), "")
    hint = suggestion(odd, _URDF_JOINTS) or f"write one of {', '.join(_URDF_JOINTS)}"
    return f"type of <joint> cannot be '{odd}'; {hint}"


def _too_large_text(_: re.Match[str], element: str, model: Path) -> str:
    del element, model
    return "it takes more memory than there is; make its <size>, counts and assets smaller"


_ERROR_EXPLANATIONS: Mapping[str, Callable[[re.Match[str], str, Path], str]] = {
    r"unrecognized element": _unknown_element_text,
    r"unrecognized attribute: '([^']*)'": _unknown_attribute_text,
    r"invalid keyword: '([^']*)'": _unknown_keyword_text,
    r"bad format in attribute '([^']*)'": _bad_number_text,
    r"problem reading attribute '([^']*)'": _bad_number_text,
    r"attribute '([^']*)' does not have enough data": _short_list_text,
    r"size (\d) must be positive in (\w+)": _bad_size_text,
    r"Unrecognized XML model type: '([^']*)'": _wrong_root_text,
    r"repeated name '([^']*)' in (\w+)": _duplicate_name_text,
    r"unknown transmission target '([^']*)'": _unknown_target_text,
    r"(\w+) '([^']*)' not found in (\w+)": _missing_object_text,
    r"rror opening file '([^']*)'": _unreadable_file_text,
    r"invalid joint type in URDF": _bad_joint_type_text,
    r"inertia must satisfy A \+ B >= C": _impossible_inertia_text,
    r"mass and inertia of moving bodies": _massless_body_text,
    r"unknown exception|bad_alloc|length_error|Could not allocate memory": _too_large_text,
}
"""Functions that write the explanation, by the pattern of MuJoCo's message."""
