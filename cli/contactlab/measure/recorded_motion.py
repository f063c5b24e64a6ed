"""Distances between runs and their recordings."""

from collections.abc import Callable

import numpy as np

from contactlab.contact.rotations import angles_between, rotate_vectors_back
from contactlab.contact.trace_arrays import Floats, squared_lengths
from contactlab.measure.context import Context, cached, contact_depths, down, energy, worst_body
from contactlab.measure.entries import metric
from contactlab.numerical_tolerance import COARSE_ROUNDING


@cached
def _simulated_states(context: Context) -> tuple[Floats, Floats]:
    """Return (n, M, nq) and (n, M, nv) states at recorded times; NaN after the end of a run."""
    trace, recorded = context.trace, context.setup.recorded
    assert recorded is not None
    places = recorded.times / trace.timestep[:, None]
    within = places <= trace.steps + COARSE_ROUNDING
    before = np.minimum(np.where(within, places, 0).astype(np.intp), trace.steps - 1)
    share = np.where(within, places - before, np.nan)[..., None]
    runs = np.arange(trace.runs)[:, None]
    first, then = (runs, before), (runs, before + 1)
    qpos = trace.qpos[first] + share * (trace.qpos[then] - trace.qpos[first])
    return qpos, trace.qvel[first] + share * (trace.qvel[then] - trace.qvel[first])


@cached
def _recording_distances(context: Context) -> dict[str, Floats]:
    """Return (n, M) distances from the recording, each of the part that differs most.

    Positions [m], rotations [rad], velocities [m/s], and shares of the size of the part [1]; NaN
    where nothing was recorded. It is empty for runs that ended early.
    """
    recorded = context.setup.recorded
    assert recorded is not None
    if context.trace.steps < context.trace.steps_asked:
        return {}
    distances: dict[str, list[Floats]] = {}
    qpos, qvel = _simulated_states(context)
    for part in recorded.parts:
        there, here = qpos[..., part.qpos], recorded.qpos[..., part.qpos]
        distance = np.sqrt(squared_lengths(there - here))
        if part.kind == "turn":
            distance = angles_between(there.reshape(-1, 4), here.reshape(-1, 4)).reshape(
                distance.shape
            )
        name = "position" if part.kind in ("point", "slide") else "rotation"
        distances.setdefault(name, []).append(distance)
        distances.setdefault("share", []).append(
            np.where(np.isnan(distance), np.nan, distance / part.size)
        )
        if part.kind == "point":
            speeds = np.linalg.norm((qvel - recorded.qvel)[..., part.qvel], axis=2)
            distances.setdefault("velocity", []).append(speeds)
    return {name: np.fmax.reduce(values) for name, values in distances.items()}


def _last_value(context: Context, values: Floats) -> Floats:
    """Return (n, ...) the values (n, M, ...) at the last recorded time within each run."""
    is_known = np.isfinite(_simulated_states(context)[0][..., 0])
    return values[np.arange(len(values)), is_known.sum(axis=1) - 1]


def _mean_value(_: Context, values: Floats) -> Floats:
    return np.nanmean(values, axis=1)


def _peak_value(_: Context, values: Floats) -> Floats:
    return np.max(values, axis=1, where=np.isfinite(values), initial=0.0)


def _declare_metric(
    name: str, unit: str, reduce: Callable[[Context, Floats], Floats], text: str
) -> None:
    """Declare a metric that reduces one quantity, named in the metric's name, over time."""
    quantity = (*name.split("_"), "share")[1]

    def measure_distance(context: Context) -> Floats:
        values = _recording_distances(context).get(quantity) if context.setup.recorded else None
        return context.undefined() if values is None else reduce(context, values)

    measure_distance.__doc__ = text
    metric(unit, "lower", name=name, heading=name if name == "reality" else "")(measure_distance)


_PLACE_TEXT, _TURN_TEXT = "distance of bodies and slides from", "angle of bodies and hinges to"
_SHARE_TEXT = (
    "Mean distance from the recording: of bodies in widths, of joints in shares of their range"
)
for _entry in (
    (
        "reality",
        "1",
        _mean_value,
        f"{_SHARE_TEXT}. A width is the smallest side of the box around a body.",
    ),
    ("reality_position", "m", _mean_value, f"Mean {_PLACE_TEXT} the recording, over time."),
    ("reality_position_peak", "m", _peak_value, f"Largest {_PLACE_TEXT} the recording."),
    (
        "reality_position_end",
        "m",
        _last_value,
        f"Final {_PLACE_TEXT} the recording: where they stopped.",
    ),
    ("reality_rotation", "rad", _mean_value, f"Mean {_TURN_TEXT} the recording, over time."),
    ("reality_rotation_peak", "rad", _peak_value, f"Largest {_TURN_TEXT} the recording."),
    ("reality_rotation_end", "rad", _last_value, f"Final {_TURN_TEXT} the recording."),
    (
        "reality_velocity",
        "m/s",
        _mean_value,
        "Mean difference of bodies' velocities from recorded ones.",
    ),
):
    _declare_metric(*_entry)


@metric("s")
def reality_delay(context: Context) -> Floats:
    """Time of the first contact, less that at which the recorded body first touches anything."""
    recorded = context.setup.recorded
    if recorded is None:
        return context.undefined()
    touching = np.logical_or.reduce(contact_depths(context)[0])
    first = np.where(touching.any(axis=1), touching.argmax(axis=1), np.nan)
    return first * context.trace.timestep - recorded.touched


@metric("N s", "lower")
def reality_impulse(context: Context) -> Floats:
    """Difference of the impulse of the first contact from the recorded one, to 50 ms after it."""
    recorded = context.setup.recorded
    if recorded is None or not _recording_distances(context):
        return context.undefined()
    difference, rows = _simulated_states(context)[1] - recorded.qvel, np.arange(context.trace.runs)
    before, after = (difference[rows, side] for side in recorded.impact.T)
    hit = np.where(recorded.impact[:, :1] >= 0, after - before, np.nan)
    bodies = context.setup.free_bodies
    changes = [np.linalg.norm(hit[:, body.dof : body.dof + 3], axis=1) for body in bodies]
    impulses = [body.mass * own for body, own in zip(bodies, changes, strict=True)]
    return worst_body(context, impulses)


@metric("J", requires="energy")
def reality_energy(context: Context) -> Floats:
    """Energy that the first contact takes, to 50 ms after it, less that in the recording."""
    recorded = context.setup.recorded
    if recorded is None or not _recording_distances(context):
        return context.undefined()
    steps = np.take_along_axis(recorded.times, recorded.impact, axis=1)
    steps /= context.trace.timestep[:, None]
    every = np.arange(context.trace.steps)
    rows = zip(steps, energy(context), strict=True)
    before, after = np.array([np.interp(at, every, values) for at, values in rows]).T
    return before - after - recorded.lost


@metric("1", "higher")
def reality_side(context: Context) -> Floats:
    """1 if every free body ends on the same side as in the recording, otherwise 0."""
    recorded, same = context.setup.recorded, list[Floats]()
    if recorded is None or not _recording_distances(context):
        return context.undefined()
    for body in context.setup.free_bodies:
        turn = slice(body.qpos + 3, body.qpos + 7)
        ends = [
            _last_value(context, positions[..., turn])
            for positions in (_simulated_states(context)[0], recorded.qpos)
        ]
        here, there = (_nearest_axis(rotate_vectors_back(end, down(context))) for end in ends)
        same.append(np.where(np.isnan(here + there), np.nan, here == there))
    return np.fmin.reduce(same) if same else context.undefined()


def _nearest_axis(direction: Floats) -> Floats:
    """Return (n,) the body axis, of six, nearest to a direction (n, 3); NaN if unknown."""
    axis = np.abs(direction).argmax(axis=1)
    sign = np.take_along_axis(direction, axis[:, None], axis=1)[:, 0]
    return np.where(np.isnan(sign), np.nan, 2.0 * axis + (sign > 0))
