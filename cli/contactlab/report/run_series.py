"""What the entries of qpos are called, as the model's joints have it."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import NO_CONTACT, Floats
from contactlab.store.mcap import StoredPair, StoredTrace

_SIZES = {"free": 7, "ball": 4, "slide": 1, "hinge": 1}
_PLACE = ("x", "y", "z")


@dataclass(frozen=True)
class QposEntry:
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


def qpos_entries(model_xml: bytes, size: int) -> tuple[QposEntry, ...]:
    """Return the entries of qpos that are lengths or angles; those of rotations are left out.

    Args:
        model_xml: the MJCF as simulated.
        size: the length of qpos. If the joints of the file do not add up to it, entries are
            called by their index.
    """
    found = list(_walked(model_xml))
    if sum(_SIZES[kind] for _, kind in found) != size:
        return tuple(QposEntry(place, f"qpos[{place}]", "m, rad", False) for place in range(size))
    named: list[QposEntry] = []
    place = 0
    for name, kind in found:
        named += _entries(place, name, kind)
        place += _SIZES[kind]
    return tuple(named)


def _entries(place: int, name: str, kind: str) -> Iterator[QposEntry]:
    if kind == "free":
        for index, axis in enumerate(_PLACE):
            yield QposEntry(place + index, f"{name} {axis}", "m", axis == "z")
    elif kind != "ball":
        yield QposEntry(place, name, "m" if kind == "slide" else "rad", False)


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


POINTS = 400
MOST_COORDINATES = 6


@dataclass(frozen=True)
class Signal:
    """One quantity over time, thinned.

    Attributes:
        name: what it is.
        unit: its unit.
        panel: the chart it belongs to: motion, force or depth.
        time: (P,) [s].
        values: (P,).
    """

    name: str
    unit: str
    panel: str
    time: Floats
    values: Floats


@dataclass(frozen=True)
class ModeBand:
    """When a pair stuck, slid, or did neither.

    Attributes:
        pair: its name.
        starts: (S,) when each stretch begins [s].
        modes: (S,) NO_CONTACT, STICK or SLIDE; a stretch ends where the next begins.
        end: when the last one ends [s].
    """

    pair: str
    starts: Floats
    modes: NDArray[np.int8]
    end: float


@dataclass(frozen=True)
class RunSeries:
    """What a page draws of one run."""

    signals: tuple[Signal, ...]
    ribbons: tuple[ModeBand, ...]


def read_run_series(trace: StoredTrace) -> RunSeries:
    """Return the motion, forces, depths and modes of a run, at 400 points at most each.

    Of each stretch of steps the least and the largest value are kept, at their own times.
    """
    signals = [*_motion(trace)]
    for pair in trace.pairs:
        signals += _contact(trace, pair)
    return RunSeries(tuple(signals), tuple(_ribbon(trace, pair) for pair in trace.pairs))


def decimated(values: Floats, points: int = POINTS) -> NDArray[np.intp]:
    """Return which of (n,) values stand for all: of each stretch the least and the largest.

    The first and the last value are always among them; values that are no numbers are not.
    """
    if len(values) <= points:
        return np.flatnonzero(np.isfinite(values))
    edges = np.linspace(0, len(values), points // 2, dtype=np.intp)
    kept = {0, len(values) - 1}
    for start, stop in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        stretch = values[start:stop]
        if np.isfinite(stretch).any():
            kept |= {start + int(np.nanargmin(stretch)), start + int(np.nanargmax(stretch))}
    places = np.array(sorted(kept), dtype=np.intp)
    return places[np.isfinite(values[places])]


def _signal(name: str, unit: str, panel: str, time: Floats, values: Floats) -> Signal:
    places = decimated(values)
    return Signal(name, unit, panel, time[places], values[places])


def _motion(trace: StoredTrace) -> Iterator[Signal]:
    known = qpos_entries(trace.model_xml, trace.qpos.shape[1])
    for each in _most_active(known, trace.qpos):
        yield _signal(each.name, each.unit, "motion", trace.time, trace.qpos[:, each.place])


def _most_active(known: tuple[QposEntry, ...], qpos: Floats) -> list[QposEntry]:
    """Return heights first, then what moves most; of many coordinates the first few of these."""
    with np.errstate(invalid="ignore"):
        spread = np.nan_to_num(np.nanmax(qpos, axis=0) - np.nanmin(qpos, axis=0))
    ranked = sorted(known, key=lambda each: (not each.is_height, -spread[each.place]))
    return ranked[:MOST_COORDINATES]


def _contact(trace: StoredTrace, pair: StoredPair) -> Iterator[Signal]:
    """Yield forces, 0 where nothing touches, and depth."""
    for name, unit, panel, values in (
        ("normal", "N", "force", pair.normal),
        ("tangential", "N", "force", pair.tangential),
        ("depth", "m", "depth", np.maximum(-pair.distance, 0.0)),
    ):
        full = np.zeros(len(trace.contacts))
        full[pair.steps] = values
        yield _signal(f"{pair.name} {name}", unit, panel, trace.time[:-1], full)


def _ribbon(trace: StoredTrace, pair: StoredPair) -> ModeBand:
    modes = np.full(len(trace.contacts), NO_CONTACT, dtype=np.int8)
    modes[pair.steps] = pair.mode
    changes = np.flatnonzero(np.diff(modes)) + 1
    starts = np.concatenate(([0], changes))[:POINTS]
    return ModeBand(pair.name, trace.time[starts], modes[starts], float(trace.time[-1]))
