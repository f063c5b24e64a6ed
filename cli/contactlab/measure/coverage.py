"""Coverage of runs: parts that moved, were loaded, touched, slid, rolled, or met limits.

A limit of a joint or a tendon acts exactly when the engine has a constraint for it: nearer to its
end than its margin. Nothing stops the motion earlier, so a coarse timestep cannot hide that the
limit was reached.
"""

from collections.abc import Iterable, Mapping, Sequence
from math import isnan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import (
    SLIDE,
    STICK,
    Floats,
    PairTrace,
    Trace,
    squared_lengths,
)
from contactlab.contact.trace_setup import Mechanism, Part
from contactlab.measure.context import Context, bearing, share
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.schema.coverage import Coverage, End

TURNING = 0.1
"""Least angular velocity [rad/s] of a rolling or spinning contact; soft ones rock more slowly."""
_LARGEST_NUMBER = float(np.finfo(np.float64).max)
_RANGE = ("low", "high", "margin")
_END_CODES: tuple[tuple[End, ...], ...] = ((), ("upper",), ("lower",), ("lower", "upper"))

Fields = Mapping[str, NDArray[Any]]
"""Measures of parts, (n, parts) for each field of the record; NaN if it does not apply."""


def run_coverages(context: Context) -> tuple[Coverage, ...] | None:
    """Return the coverage of each run of a context; None if its setup names no mechanism."""
    trace, mechanism = context.trace, context.setup.mechanism
    n = trace.runs
    if mechanism is None:
        return None
    if not trace.steps:
        return tuple(Coverage() for _ in range(n))
    with np.errstate(all="ignore"):
        joints = _rows_by_part(mechanism.joints, _joint_fields(mechanism.joints, trace.qpos), n)
        tendon_fields: Fields = {}
        if trace.lengths is not None and mechanism.tendons:
            least, greatest = trace.lengths.min(axis=1), trace.lengths.max(axis=1)
            short, long = mechanism.slack.T
            stretched = np.maximum(np.maximum(short - least, greatest - long), 0)
            travel = _travel_fields(mechanism.tendons, least, greatest, greatest - least)
            tendon_fields = {**travel, "stretched": stretched}
        tendons = _rows_by_part(mechanism.tendons, tendon_fields, n)
        actuators = _rows_by_part(mechanism.actuators, _actuator_fields(mechanism, trace), n)
        touched = [trace.pairs[place] for place in context.pairs.places]
        # All contacts of a pair turn like its first one.
        net, series, bears = context.net, context.net.series, bearing(context)
        sticks, largest = series.mode == STICK, series.normal.max(axis=-1)
        shares = {
            "touched": bears,
            "stuck": sticks,
            "slid": series.mode == SLIDE,
            "rolled": bears & sticks & (net.rolling > TURNING),
            "spun": bears & (net.spinning > TURNING),
        }
        friction = series.tangential.max(axis=-1) / np.where(largest > 0, largest, np.inf)
        pairs = _rows_by_part(
            touched,
            {**{name: share(values).T for name, values in shares.items()}, "friction": friction.T},
            n,
        )
    loads = np.zeros((n, 0)) if trace.equality_loads is None else trace.equality_loads
    weight = context.setup.moving_mass * context.setup.pull
    least_load_share = 1e-4  # smallest load of an equality that counts, as a share of the weight
    loads = np.where(loads < least_load_share * weight[:, None], 0, loads)
    names = [equality.name for equality in mechanism.equalities]
    contacts = share(trace.contacts > 0)
    covered = (
        {
            "joints": joints[run],
            "tendons": tendons[run],
            "actuators": actuators[run],
            "equalities": dict(zip(names, loads[run].tolist(), strict=False)),
            "pairs": {name: use for name, use in pairs[run].items() if use["touched"]},
            "touched": contacts[run],
        }
        for run in range(n)
    )
    return tuple(map(Coverage.model_validate, covered))


def _rows_by_part(
    parts: Sequence[Part | PairTrace], fields: Fields, runs: int
) -> list[dict[str, dict[str, Any]]]:
    """Return the measures of each part in each run, by name; infinities become largest numbers."""
    values = np.stack([*fields.values()], axis=-1) if parts else np.zeros((runs, 0, 0))
    return [
        {part.name: _row_by_field(fields, row) for part, row in zip(parts, rows, strict=True)}
        for rows in np.clip(values, -_LARGEST_NUMBER, _LARGEST_NUMBER).tolist()
    ]


def _row_by_field(names: Iterable[str], values: Sequence[float]) -> dict[str, Any]:
    return {
        name: _END_CODES[int(value)] if name == "ends" else value
        for name, value in zip(names, values, strict=True)
        if not isnan(value)
    }


def _joint_fields(joints: Sequence[Part], qpos: Floats) -> Fields:
    widths = [3 if joint.kind == "free" else 1 for joint in joints]
    columns = [
        joint.place + k for joint, width in zip(joints, widths, strict=True) for k in range(width)
    ]
    # Process run by run, so that its rows stay in the cache.
    ends = [(rows.min(axis=0), rows.max(axis=0)) for rows in qpos]
    first, last = np.moveaxis(np.array(ends)[..., columns], 1, 0)
    starts = np.cumsum([0, *widths])[:-1]
    least, greatest = first[:, starts], last[:, starts]
    moved, turned = greatest - least, np.full(least.shape, np.nan)
    for index, (joint, start) in enumerate(zip(joints, starts, strict=True)):
        if joint.kind == "free":
            span = slice(start, start + 3)
            moved[:, index] = np.sqrt(squared_lengths(last[:, span] - first[:, span]))
            turned[:, index] = _largest_rotation(qpos, joint.place + 3)
        if joint.kind == "ball":
            angle = 2 * np.arccos(np.abs(qpos[:, :, joint.place]).min(axis=1))
            least[:, index] = greatest[:, index] = angle
            moved[:, index] = _largest_rotation(qpos, joint.place)
    return {**_travel_fields(joints, least, greatest, moved), "turned": turned}


def _largest_rotation(qpos: Floats, place: int) -> Floats:
    """Return (n,) the largest angle [rad] of the quaternion at an index of qpos to its first."""
    first = np.zeros((len(qpos), qpos.shape[2], 1))
    first[:, place : place + 4, 0] = qpos[:, 0, place : place + 4]
    # A product of whole rows is faster than gathering four of their columns.
    cosine = np.abs(qpos @ first).min(axis=(1, 2))
    return 2 * np.arccos(np.minimum(cosine, 1))


def _travel_fields(parts: Sequence[Part], least: Floats, greatest: Floats, moved: Floats) -> Fields:
    """Return travels from the least and greatest position of each part in each run, (n, parts)."""
    low, high, margin = (np.array([getattr(part, name) for part in parts]) for name in _RANGE)
    balls = np.array([part.kind == "ball" for part in parts])
    span = high - np.where(balls, 0, low)
    return {
        "moved": moved,
        "share": np.where((span > 0) & np.isfinite(span), moved / span, np.nan),
        "ends": 2.0 * (least < low + margin) + (greatest > high - margin),
    }


def _actuator_fields(mechanism: Mechanism, trace: Trace) -> Fields:
    shape = (trace.runs, trace.steps, len(mechanism.actuators))
    forces = np.zeros(shape) if trace.forces is None else trace.forces
    ranges = trace.control_ranges
    controls = np.zeros((trace.runs, shape[2], 2)) if ranges is None else ranges
    low, high = mechanism.forces.T
    slack = np.where(np.isfinite(high - low), SUM_ROUNDING * (high - low), 0)
    at_limit = (forces <= low + slack) | (forces >= high - slack)
    least, greatest = controls[:, :, 0], controls[:, :, 1]
    first = np.array([actuator.low for actuator in mechanism.actuators])
    last = np.array([actuator.high for actuator in mechanism.actuators])
    travel = np.clip(greatest, first, last) - np.clip(least, first, last)
    return {
        **_travel_fields(mechanism.actuators, least, greatest, travel),
        "force": np.abs(forces).max(axis=1),
        "saturated": at_limit.mean(axis=1),
    }
