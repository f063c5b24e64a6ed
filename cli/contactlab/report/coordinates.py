"""What the entries of qpos are called, as the model's joints have it."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass

_SIZES = {"free": 7, "ball": 4, "slide": 1, "hinge": 1}
_PLACE = ("x", "y", "z")


@dataclass(frozen=True)
class Coordinate:
    """One entry of qpos.

    Attributes:
        place: its index.
        name: the joint's name, with the direction where it has several.
        unit: m or rad.
        is_height: whether it is the height of a body that moves freely.
    """

    place: int
    name: str
    unit: str
    is_height: bool


def coordinates(model_xml: bytes, size: int) -> tuple[Coordinate, ...]:
    """Return the entries of qpos that are lengths or angles; those of rotations are left out.

    Args:
        model_xml: the MJCF as simulated.
        size: the length of qpos. If the joints of the file do not add up to it, entries are
            called by their index.
    """
    found = list(_walked(model_xml))
    if sum(_SIZES[kind] for _, kind in found) != size:
        return tuple(Coordinate(place, f"qpos[{place}]", "m, rad", False) for place in range(size))
    named: list[Coordinate] = []
    place = 0
    for name, kind in found:
        named += _entries(place, name, kind)
        place += _SIZES[kind]
    return tuple(named)


def _entries(place: int, name: str, kind: str) -> Iterator[Coordinate]:
    if kind == "free":
        for index, axis in enumerate(_PLACE):
            yield Coordinate(place + index, f"{name} {axis}", "m", axis == "z")
    elif kind != "ball":
        yield Coordinate(place, name, "m" if kind == "slide" else "rad", False)


def _walked(model_xml: bytes) -> Iterator[tuple[str, str]]:
    """Yield name and type of every joint, in the order of qpos: depth first."""
    try:
        root = ET.fromstring(model_xml)  # noqa: S314 - written by this program, hashed in the store
    except ET.ParseError:
        return
    world = root.find("worldbody")
    if world is not None:
        for body in world.findall("body"):
            yield from _joints(body)


def _joints(body: ET.Element) -> Iterator[tuple[str, str]]:
    name = body.get("name", "body")
    for joint in body:
        if joint.tag == "freejoint":
            yield name, "free"
        elif joint.tag == "joint":
            kind = joint.get("type", "hinge")
            yield name if kind == "free" else joint.get("name", f"{name} joint"), kind
    for inner in body.findall("body"):
        yield from _joints(inner)
