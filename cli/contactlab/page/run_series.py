"""A run in a page: its trace in a few hundred points."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import NO_CONTACT, Floats
from contactlab.page.packing import packed_integers, rounded_floats
from contactlab.printable import Replacer
from contactlab.schema.coverage import Travel
from contactlab.store.mcap.trace_reader import StoredTrace

_POINTS = 400
_JOINT_SIZES = {"free": 7, "ball": 4, "slide": 1, "hinge": 1, "hinge or slide": 1}
_UNITS = {"slide": "m", "hinge": "rad", "hinge or slide": "m, rad"}
_NO_JOINTS: Mapping[str, Travel] = {}


@dataclass(frozen=True)
class QposEntry:
    """One entry of qpos: a joint, with the direction where it has several."""

    index: int
    name: str
    unit: str
    is_height: bool


def run_series(
    trace: StoredTrace, replace_geoms: Replacer = str, joints: Mapping[str, Travel] = _NO_JOINTS
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return a run over time: its signals and contact modes in words, and as columns.

    `replace_geoms` names pairs, and the coverage names joints if the trace's own model lacks some
    names. A signal i of motion, force or depth, 0 without contact, has times `ti` [s] and values
    `vi`, at most 402 of them. A pair i begins to stick, slide or part at `si` [s], its modes
    being `mi`.
    """
    columns: dict[str, NDArray[Any]] = {}
    signals: list[tuple[str, str, str]] = []
    bits = 12  # 1e-4 of a plot, a tenth of a pixel
    for index, (name, unit, panel, values, rows) in enumerate(
        _list_signals(trace, replace_geoms, joints)
    ):
        columns[f"t{index}"] = rounded_floats(trace.time[rows], bits)
        values_at_rows = values[rows]
        finite = values_at_rows[np.isfinite(values_at_rows)]
        size = np.abs(finite).max(initial=0.0)
        height = finite.max(initial=-np.inf) - finite.min(initial=np.inf)
        # A mantissa counts from zero, a plot from its least value.
        more = math.ceil(math.log2(size / height)) if 0 < height < size else 0
        columns[f"v{index}"] = rounded_floats(values_at_rows, min(bits + more, 23))
        signals.append((name, unit, panel))
    # A run that ended before its first step has no contacts over time.
    pairs = trace.pairs if len(trace.contacts) else ()
    for index, pair in enumerate(pairs):
        modes = pair.spread_over_steps(len(trace.contacts), pair.mode, NO_CONTACT)
        starts = np.concatenate(([0], np.flatnonzero(np.diff(modes)) + 1))[:_POINTS]
        columns[f"s{index}"] = rounded_floats(trace.time[starts], bits)
        columns[f"m{index}"] = packed_integers(modes[starts])
    bands = [(replace_geoms(pair.name), float(trace.time[-1])) for pair in pairs]
    return {"signals": signals, "bands": bands}, columns


def _list_signals(
    trace: StoredTrace, replace_geoms: Replacer, joints: Mapping[str, Travel]
) -> Iterator[tuple[str, str, str, Floats, NDArray[np.intp]]]:
    """Yield name, unit, panel, values and places to keep of motion, forces and depths of a run.

    Both forces of a pair are kept at the same times, so that one can be drawn over the other.
    """
    with np.errstate(invalid="ignore"):
        spread = np.nan_to_num(np.nanmax(trace.qpos, axis=0) - np.nanmin(trace.qpos, axis=0))
    entries = qpos_entries(trace.model_xml, trace.qpos.shape[1], joints)
    # Heights come first, then the coordinates that move most.
    ranked_entries = sorted(entries, key=lambda entry: (not entry.is_height, -spread[entry.index]))
    most_coordinates = 6
    for entry in ranked_entries[:most_coordinates]:
        values = trace.qpos[:, entry.index]
        yield entry.name, entry.unit, "motion", values, thin_indices(values)
    for pair in trace.pairs:
        name = replace_geoms(pair.name)
        normal, tangential, depth = (
            pair.spread_over_steps(len(trace.contacts), values)
            for values in (pair.normal, pair.tangential, np.maximum(-pair.distance, 0.0))
        )
        rows = np.union1d(
            thin_indices(normal, _POINTS // 2), thin_indices(tangential, _POINTS // 2)
        )
        rows = rows[np.isfinite(normal[rows]) & np.isfinite(tangential[rows])]
        yield f"{name} normal", "N", "force", normal, rows
        yield f"{name} tangential", "N", "force", tangential, rows
        yield f"{name} depth", "m", "depth", depth, thin_indices(depth)


def thin_indices(values: Floats, points: int = _POINTS) -> NDArray[np.intp]:
    """Return indices of at most `points` + 2 of (n,) values: the extremes of each interval.

    The first and the last value are always among them; NaN and infinities never are.
    """
    if len(values) <= points:
        return np.flatnonzero(np.isfinite(values))
    edges = np.linspace(0, len(values), points // 2, dtype=np.intp)
    places = edges[:-1, None] + np.arange(np.diff(edges).max())
    inside = places < edges[1:, None]
    intervals = np.where(inside, values[np.minimum(places, len(values) - 1)], np.nan)
    has_finite = np.isfinite(intervals).any(axis=1)
    least, most = (find(intervals[has_finite], axis=1) for find in (np.nanargmin, np.nanargmax))
    begins = edges[:-1][has_finite]
    ends = np.array([0, len(values) - 1], dtype=np.intp)
    indices = np.unique(np.concatenate([ends, begins + least, begins + most]))
    return indices[np.isfinite(values[indices])]


def qpos_entries(
    model_xml: bytes, size: int, covered: Mapping[str, Travel] = _NO_JOINTS
) -> tuple[QposEntry, ...]:
    """Return the entries of qpos that are lengths or angles, without those of rotations.

    The MJCF lacks joints of included files. If its joints do not add up to the size of qpos, the
    covered joints are used; without these, entries have their index.
    """
    # Coverage has the types of joints as far as their travel tells them, in the order of qpos.
    model_entries = [
        (name, "hinge or slide" if joint.turned is None else "free")
        for name, joint in covered.items()
    ]
    candidates = [*_model_joints(model_xml)], model_entries
    fitting = (each for each in candidates if sum(_JOINT_SIZES[kind] for _, kind in each) == size)
    if (joints := next(fitting, None)) is None:
        return tuple(QposEntry(index, f"qpos[{index}]", "m, rad", False) for index in range(size))
    entries, index = list[QposEntry](), 0
    for name, kind in joints:
        if kind == "free":
            entries += [
                QposEntry(index + offset, f"{name} {axis}", "m", axis == "z")
                for offset, axis in enumerate("xyz")
            ]
        elif kind != "ball":
            entries.append(QposEntry(index, name, _UNITS[kind], False))
        index += _JOINT_SIZES[kind]
    return tuple(entries)


def is_single_body(trace: StoredTrace) -> bool:
    """Return whether one body moves freely, and nothing else: no robot, no held mug."""
    entries = qpos_entries(trace.model_xml, trace.qpos.shape[1])
    return [entry.unit for entry in entries] == ["m", "m", "m"]


def _model_joints(model_xml: bytes) -> Iterator[tuple[str, str]]:
    """Yield name and type of every joint in the order of qpos, depth first."""
    try:
        root = ET.fromstring(model_xml)  # noqa: S314 - written by this program, hashed in the store
    except ET.ParseError:
        return
    for number, body in enumerate(root.iterfind("worldbody//body"), 1):
        name = body.get("name", f"body[{number}]")
        for joint in body:
            if joint.tag == "freejoint":
                yield name, "free"
            elif joint.tag == "joint":
                kind = joint.get("type", "hinge")
                yield name if kind == "free" else joint.get("name", f"{name} joint"), kind
