"""A run in a report: its trace in a few hundred points, and in words what it exercised."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import NO_CONTACT, Floats
from contactlab.schema.coverage import ActuatorUse, Coverage, PairUse, Travel
from contactlab.store.mcap.stored_trace import StoredTrace

_POINTS = 400
_MOST_COORDINATES = 6
_JOINT_SIZES = {"free": 7, "ball": 4, "slide": 1, "hinge": 1}


@dataclass(frozen=True)
class QposEntry:
    """One entry of qpos.

    Attributes:
        name: the joint's name, with the direction where it has several.
        is_height: whether it is the height of a free body.
    """

    index: int
    name: str
    unit: str
    is_height: bool


class Signal(NamedTuple):
    """One quantity over time (P,) [s], decimated, in a chart: motion, force or depth."""

    name: str
    unit: str
    panel: str
    time: Floats
    values: Floats


class ModeBand(NamedTuple):
    """When a pair stuck, slid, or was apart.

    Attributes:
        starts: (S,) when each interval begins [s].
        modes: (S,) NO_CONTACT, STICK or SLIDE; an interval ends where the next begins.
        end: when the last one ends [s].
    """

    pair: str
    starts: Floats
    modes: NDArray[np.int8]
    end: float


def read_signals(trace: StoredTrace) -> Iterator[Signal]:
    """Yield the motion, forces and depths of a run, 0 without contact, in at most 400 points."""
    for each in _most_active(qpos_entries(trace.model_xml, trace.qpos.shape[1]), trace.qpos):
        motion = trace.qpos[:, each.index]
        yield _signal(each.name, each.unit, "motion", trace.time, motion)
    for pair in trace.pairs:
        for name, unit, panel, values in (
            ("normal", "N", "force", pair.normal),
            ("tangential", "N", "force", pair.tangential),
            ("depth", "m", "depth", np.maximum(-pair.distance, 0.0)),
        ):
            full = pair.over(len(trace.contacts), values)
            yield _signal(f"{pair.name} {name}", unit, panel, trace.time[:-1], full)


def read_mode_bands(trace: StoredTrace) -> Iterator[ModeBand]:
    """Yield when each pair of a run stuck, slid, or was apart."""
    for pair in trace.pairs:
        modes = pair.over(len(trace.contacts), pair.mode, NO_CONTACT)
        changes = np.flatnonzero(np.diff(modes)) + 1
        starts = np.concatenate(([0], changes))[:_POINTS]
        yield ModeBand(pair.name, trace.time[starts], modes[starts], float(trace.time[-1]))


def decimated(values: Floats, points: int = _POINTS) -> NDArray[np.intp]:
    """Return indices of at most `points` + 2 of (n,) values: the extremes of each interval.

    The first and the last value are always among them; NaN and infinities never are.
    """
    if len(values) <= points:
        return np.flatnonzero(np.isfinite(values))
    edges = np.linspace(0, len(values), points // 2, dtype=np.intp)
    kept = {0, len(values) - 1}
    for start, stop in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        interval = values[start:stop]
        if np.isfinite(interval).any():
            kept |= {start + int(np.nanargmin(interval)), start + int(np.nanargmax(interval))}
    indices = np.array(sorted(kept), dtype=np.intp)
    return indices[np.isfinite(values[indices])]


def _signal(name: str, unit: str, panel: str, time: Floats, values: Floats) -> Signal:
    indices = decimated(values)
    return Signal(name, unit, panel, time[indices], values[indices])


def _most_active(entries: tuple[QposEntry, ...], qpos: Floats) -> list[QposEntry]:
    """Return the first six entries: heights, then those that move most."""
    with np.errstate(invalid="ignore"):
        spread = np.nan_to_num(np.nanmax(qpos, axis=0) - np.nanmin(qpos, axis=0))
    ranked = sorted(entries, key=lambda each: (not each.is_height, -spread[each.index]))
    return ranked[:_MOST_COORDINATES]


def qpos_entries(model_xml: bytes, size: int) -> tuple[QposEntry, ...]:
    """Return the entries of qpos that are lengths or angles, without those of rotations.

    If the joints of the MJCF do not add up to the size of qpos, entries are named by their index.
    """
    joints = list(_joints(model_xml))
    if sum(_JOINT_SIZES[kind] for _, kind in joints) != size:
        return tuple(QposEntry(index, f"qpos[{index}]", "m, rad", False) for index in range(size))
    entries: list[QposEntry] = []
    index = 0
    for name, kind in joints:
        if kind == "free":
            for offset, axis in enumerate("xyz"):
                entries.append(QposEntry(index + offset, f"{name} {axis}", "m", axis == "z"))
        elif kind != "ball":
            entries.append(QposEntry(index, name, "m" if kind == "slide" else "rad", False))
        index += _JOINT_SIZES[kind]
    return tuple(entries)


def _joints(model_xml: bytes) -> Iterator[tuple[str, str]]:
    """Yield name and type of every joint in the order of qpos, depth first."""
    try:
        root = ET.fromstring(model_xml)  # noqa: S314 - written by this program, hashed in the store
    except ET.ParseError:
        return
    for body in root.iterfind("worldbody//body"):
        name = body.get("name", "body")
        for joint in body:
            if joint.tag == "freejoint":
                yield name, "free"
            elif joint.tag == "joint":
                kind = joint.get("type", "hinge")
                yield name if kind == "free" else joint.get("name", f"{name} joint"), kind


_MOST = 4


class CoverageRow(NamedTuple):
    """Parts of one kind: those that a run left alone, and what the others did."""

    kind: str
    idle: str
    used: str


def coverage_rows(coverage: Coverage, pairs: Iterable[str]) -> list[CoverageRow]:
    """Return the rows of the kinds that the model has; `pairs` are all monitored ones."""
    parts = {**coverage.joints, **coverage.tendons}
    limited = {name: each for name, each in parts.items() if each.share is not None}
    kinds = {
        "joints moved": {name: _travel(each) for name, each in coverage.joints.items()},
        "limits reached": {name: ", ".join(each.ends) for name, each in limited.items()},
        "tendons moved": {name: _travel(each) for name, each in coverage.tendons.items()},
        "actuators used": {name: _use(each) for name, each in coverage.actuators.items()},
        "equalities loaded": {
            name: f"{load:g}" if load else "" for name, load in coverage.equalities.items()
        },
        "pairs touched": {
            name: _touching(coverage.pairs[name]) if name in coverage.pairs else ""
            for name in pairs
        },
    }
    rows: list[CoverageRow] = []
    for kind, done in kinds.items():
        idle = [name for name, text in done.items() if not text]
        used = [f"{name} {text}" for name, text in done.items() if text]
        if done:
            rows.append(CoverageRow(kind, _listed(idle, ", "), _listed(used, "; ")))
    return rows


def _listed(texts: list[str], separator: str) -> str:
    rest = len(texts) - _MOST
    more = [f"{rest} more"] if rest > 0 else []
    return separator.join([*texts[:_MOST], *more])


def _travel(travel: Travel) -> str:
    """Return how far something went, nothing where it held still."""
    if not travel.counts and not travel.stretched:
        return ""
    way = f"{travel.moved:g}" if travel.share is None else f"{travel.share:.0%}"
    return f"{way}, turned {travel.turned:g} rad" if travel.turned else way


def _use(use: ActuatorUse) -> str:
    if not use.force and not use.counts:
        return ""
    control = f"{use.share:.0%}, " if use.share else ""
    saturated = f", saturated {use.saturated:.0%}" if use.saturated else ""
    return f"{control}force {use.force:g}{saturated}"


def _touching(use: PairUse) -> str:
    """Return how long a pair did what, in shares of time."""
    names = ("touched", "stuck", "slid", "rolled", "spun")
    return ", ".join(f"{name} {share:.0%}" for name in names if (share := getattr(use, name)))
