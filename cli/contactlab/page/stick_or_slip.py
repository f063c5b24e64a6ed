"""Stick or slip over angle and friction: a body at rest on a plane under a constant load."""

import math
from dataclasses import dataclass
from itertools import islice
from typing import Any

import altair as alt
import numpy as np

from contactlab.charts import Rows, Spec, layer_of, word_colours
from contactlab.contact.rotations import rotate_vectors, rotate_vectors_back
from contactlab.contact.trace_arrays import NORMAL, SLIDE, STICK, Floats
from contactlab.page.run_series import is_single_body
from contactlab.palette import INK, mode_colour
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store
from contactlab.store.mcap.trace_reader import StoredTrace

_OUTCOMES = {STICK: "sticks", SLIDE: "slides"}


@dataclass(frozen=True)
class _SlopeRules:
    """Which runs show whether a body sticks to a slope, and their figure."""

    least_runs: int = 3
    most_records: int = 600
    least_angle_deg: float = 0.1  # of the load; the ground is level below it
    # A body that rolls or tips needs another friction than one that slides: its normals turn by
    # more than 0.1 rad.
    least_cosine: float = math.cos(0.1)
    least_bearing_share: float = 0.9  # share of a run that a pair has to touch for
    boundary_points: int = 61
    # The plane ends beyond the steepest load.
    margin_deg: float = 4.0


_RULES = _SlopeRules()


def slope_runs(store: Store) -> Rows:
    """Return the traced runs on slopes, if there are at least three.

    They have a single, undriven body that starts at rest on a plane under a constant load, and
    neither rolls nor tips. Each has the `angle` of the load from the plane's normal [deg], the
    pair's `friction`, the `cone`, and whether the `contact` sticks or slides at its last step.
    """
    if store.manifest.traces_left_out or store.manifest.traces < _RULES.least_runs:
        return []
    records = filter(_is_still, store.records(store.columns.has_value("trace_file")))
    run_rows = (
        _slope_run(store.trace(record), record) for record in islice(records, _RULES.most_records)
    )
    rows = [row for row in run_rows if row is not None]
    sloped = sum(row["angle"] > _RULES.least_angle_deg for row in rows)
    return rows if sloped >= _RULES.least_runs else []


def _is_still(record: EvidenceRecord) -> bool:
    """Return whether a run starts at rest, undriven, on one pair with one friction all around."""
    start, pairs = record.initial, [*record.pairs.values()]
    has_friction = [pair.condim > 1 and pair.friction[0] == pair.friction[1] for pair in pairs]
    return (
        has_friction == [True] and record.drive == "none" and not any(start.qvel) and not start.ctrl
    )


def _slope_run(trace: StoredTrace, record: EvidenceRecord) -> dict[str, Any] | None:
    load, (pair,) = _find_load(record), trace.pairs
    if load is None or not is_single_body(trace) or not len(pair.points):
        return None
    normals, pose = pair.points[:, NORMAL], trace.qpos[[0, -1], 3:7]
    normal = normals[-1]
    turned = rotate_vectors(pose[1], rotate_vectors_back(pose[0], normal)) if pose.size else normal
    bears = pair.steps[-1] >= _RULES.least_bearing_share * len(trace.contacts)
    if not (
        bears
        and turned @ normal > _RULES.least_cosine
        and (normals @ normal).min() > _RULES.least_cosine
    ):
        return None
    angle = np.arctan2(np.linalg.norm(np.cross(load, normal)), abs(load @ normal))
    return {
        "angle": float(np.degrees(angle)),
        "friction": record.pairs[pair.name].friction[0],
        "cone": str(record.settings["cone"]),
        "contact": _OUTCOMES[int(pair.mode[-1])],
    }


def _find_load(record: EvidenceRecord) -> Floats | None:
    """Return (3,) gravity and the force applied to the only body [N]; None if not known."""
    gravity, mass = np.array(record.settings["gravity"]), record.settings.get("mass")
    applied = np.array(record.initial.applied).reshape(-1, 6)[1:, :3]
    if not len(applied):
        return gravity
    if not gravity.any():
        return applied.sum(axis=0)
    return mass * gravity + applied[0] if isinstance(mass, float) and len(applied) == 1 else None


def stick_slip_panel(rows: Rows) -> Spec:
    """Return runs over their loads' angles and friction, with the boundary mu = tan(angle)."""
    steepest = min(max(row["angle"] for row in rows) + _RULES.margin_deg, 89.0)
    most = max(row["friction"] for row in rows) * 1.08
    ends = min(steepest, float(np.degrees(np.arctan(most))))
    boundary = [
        {"angle": angle, "friction": float(np.tan(np.radians(angle))), "line": True, "cone": cone}
        for cone in dict.fromkeys(row["cone"] for row in rows)
        for angle in np.linspace(0, ends, _RULES.boundary_points).tolist()
    ]
    x = alt.X("angle:Q").scale(domain=[0, steepest], nice=False)
    y = alt.Y("friction:Q").scale(domain=[0, most], nice=False)
    x = x.axis(title="angle of the load [°]")
    y = y.axis(title="friction coefficient μ")
    words = [*_OUTCOMES.values()]
    colour = word_colours("contact", words, [mode_colour(mode) for mode in _OUTCOMES])
    shape = alt.Shape("contact:N").scale(domain=words, range=["circle", "triangle-up"])
    base = layer_of("slopes", [*rows, *boundary])
    # Hollow, since runs of one angle and friction may differ.
    points = (
        base.transform_filter("!datum.line")
        .mark_point(size=60, strokeWidth=1.6, opacity=1)
        .encode(x, y, colour.legend(title=None), shape.legend(title=None))
    )
    line = base.transform_filter("datum.line").mark_line(color=INK, strokeDash=[6, 4])
    chart = alt.layer(line.encode(x, y), points).properties(width=300, height=300)
    title = alt.Header(title="dashed: the boundary μ = tan(angle); cone", titleFontWeight="normal")
    return chart.facet(column=alt.Column("cone:N").header(title)).to_dict()
