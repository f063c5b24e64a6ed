"""Violation of constraints other than contacts: limits of joints and tendons, equalities."""

from dataclasses import dataclass

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.contact.trace_setup import DEGREES, QUARTER_TURN, Part
from contactlab.measure.backward_error import TOLERANCE, numerical_error_text, unresolved_runs
from contactlab.measure.context import Context, cached, first_step, runs_where, worst_pair
from contactlab.measure.entries import (
    MeasuredRuns,
    Onset,
    OnsetIterator,
    Threshold,
    label,
    metric,
    threshold_values,
)
from contactlab.measure.friction import RATE
from contactlab.rendering.amounts import format_amount, format_percent

_PEAK_THRESHOLD = Threshold(
    "constraint_violation",
    0.5,
    "1",
    "A limit off by half its range or half its body's reach, the larger, no longer holds.",
)


@dataclass(frozen=True)
class _Violation:
    """Violation of one constraint in n runs, in `unit`."""

    name: str
    unit: str
    scale: float  # reference size for the violation
    peak: Floats  # (n,) the largest; for limits, beyond that at the start
    rest: Floats  # (n,) in the last quarter, or where a limit comes to rest later, likewise
    course: Floats | None = None  # (n, N) over time; None for a sampled violation
    bodies: tuple[str, ...] = ()  # the bodies that it holds
    width: float = np.nan  # the range of a limit


@cached
def _find_violations(context: Context) -> list[_Violation]:
    mechanism, trace = context.setup.mechanism, context.trace
    if mechanism is None:
        return []
    violations = [
        _limit_violation(context, part, _joint_positions(context, part))
        for part in mechanism.joints
    ]
    if trace.lengths is not None:
        of_tendons = zip(mechanism.tendons, np.moveaxis(trace.lengths, 2, 0), strict=True)
        violations += [_limit_violation(context, part, length) for part, length in of_tendons]
    if trace.equality_gaps is not None:
        gaps = np.moveaxis(trace.equality_gaps, 0, 2)
        for one, (peak, rest) in zip(mechanism.equalities, gaps, strict=True):
            most = peak * np.nan if one.elastic else peak
            violations.append(
                _Violation(one.name, one.unit, one.scale, most, rest, bodies=one.bodies)
            )
    return [
        violation
        for violation in violations
        if violation is not None and np.isfinite(violation.scale)
    ]


def _format_violation(amount: float, unit: str) -> str:
    return format_amount(amount, "mm" if unit == "m" else unit, digits=3)


def _creeping_brakes(runs: MeasuredRuns) -> OnsetIterator:
    """Find parts that friction loss could hold, but that move on as fast as it lets them."""
    trace, mechanism = runs.context.trace, runs.context.setup.mechanism
    if trace.creep is None or mechanism is None:
        return
    braked = [joint for joint in mechanism.joints for _ in range(DEGREES[joint.kind])]
    braked += mechanism.tendons
    for place in np.flatnonzero(trace.creep[:, 0].any(axis=0)).tolist():
        part = braked[place]
        turns = part.kind in {"ball", "hinge"}
        scale, unit = (
            (QUARTER_TURN, "rad") if turns else (part.reach or runs.context.setup.size, "m")
        )
        limit = runs.limits[RATE.name] * scale
        speeds, steps = trace.creep[:, 0, place], trace.creep[:, 1, place]
        for run in runs_where(speeds > limit):
            reason = (
                f"{part.name} creeps at {speeds[run]:.3g} {unit}/s under less than its friction "
                f"loss (limit {limit:.3g} {unit}/s)"
            )
            yield run, Onset(reason, int(steps[run]), part.bodies)


def _joint_positions(context: Context, joint: Part) -> Floats:
    """Return (n, N) the position of a joint; for a ball joint, its angle."""
    places = context.trace.qpos[:, :-1, joint.place]
    return 2 * np.arccos(np.minimum(np.abs(places), 1)) if joint.kind == "ball" else places


def _limit_violation(context: Context, part: Part, places: Floats) -> _Violation | None:
    if part.kind == "free" or not np.isfinite(part.high) or places.shape[1] == 0:
        return None
    beyond = np.maximum(np.maximum(part.low - places, places - part.high), 0)
    # A limit with a wide margin already acts ahead of its end.
    ahead = np.minimum(places - part.low, part.high - places)
    ahead = np.where(ahead < part.margin, np.maximum(ahead, 0), 0)
    if context.setup.limits_act is not None:
        beyond, ahead = (
            distance * context.setup.limits_act[:, None] for distance in (beyond, ahead)
        )
    beyond = np.maximum(beyond - beyond[:, :1], 0)
    turns = part.kind in {"ball", "hinge"}
    width = part.high - (0 if part.kind == "ball" else part.low)
    # A range may be next to nothing, to lock a joint.
    scale = np.clip(width, QUARTER_TURN / 2, QUARTER_TURN) if turns else max(width, part.reach)
    # Quantile of the violation that counts as resting; a shaken part swings back from its limits.
    resting_quantile = 0.1
    late = (beyond + ahead)[:, 3 * beyond.shape[1] // 4 :]
    rest = np.quantile(late, resting_quantile, axis=1)
    least_speed = threshold_values(context.setup.thresholds)[RATE.name] * scale
    for run in runs_where(rest > 0):
        step = context.trace.timestep[run]
        if np.abs(np.diff(late[run])).mean() > least_speed * step:
            rest[run] = min(rest[run], max(_predict_rest(late[run]), 0))
    unit = "rad" if turns else "m"
    peak = beyond.max(axis=1)
    name = f"the limit of {part.name}"
    return _Violation(name, unit, scale, peak, rest, beyond, part.bodies, width)


def _predict_rest(course: Floats) -> float:
    # Predicts where a moving limit comes to rest, by its law: while it acts, its acceleration is
    # linear in position and speed. If the course (N,) does not obey it, 0 if it keeps returning, as
    # a door that coasts back without force; otherwise infinite.
    acts = (course[2:] > 0) & (course[1:-1] > 0) & (course[:-2] > 0)
    min_steps = 12  # four for each of three coefficients
    unknown = 0.0 if (np.diff(course) <= 0).all() else np.inf
    if np.count_nonzero(acts) < min_steps:
        return unknown
    motion = course[1:-1], (course[2:] - course[:-2]) / 2, np.diff(course, n=2)
    place, speed, acceleration = (float(one[acts].mean()) for one in motion)
    places, speeds, wanted = (one[acts] - one[acts].mean() for one in motion)
    scales = max(np.std(places), np.finfo(float).tiny), max(np.std(speeds), np.finfo(float).tiny)
    basis = np.stack((places / scales[0], speeds / scales[1]), axis=1)
    # At last, positions and speeds are proportional: the law is then shared between them.
    law = np.linalg.lstsq(basis, wanted, rcond=1e-6)[0]
    residual = np.linalg.norm(wanted - basis @ law)
    max_residual = 0.01  # of the change of acceleration; a drive or a contact causes another
    if residual > max_residual * np.linalg.norm(wanted) or law[0] >= 0:
        return unknown
    stiffness, damping = law / scales
    return place + (damping * speed - acceleration) / stiffness


@cached
def list_accepted_limits(context: Context) -> dict[int, str]:
    """Return the limit that gives way by the largest share of its range in words, by run.

    It counts from half of its range, as for the label, and from the tolerance of its body's reach:
    a body larger than the range of its joint excuses it, but the joint was far out of its range.
    """
    limits = threshold_values(context.setup.thresholds)
    worst: dict[int, tuple[float, str]] = {}
    for violation in _find_violations(context):
        share = violation.peak / violation.width
        far = share > limits[_PEAK_THRESHOLD.name]
        for run in runs_where(far & (violation.peak > limits[TOLERANCE.name] * violation.scale)):
            off = _format_violation(violation.peak[run], violation.unit)
            note = f"{violation.name} is off by {off}, {format_percent(share[run])} of its range"
            worst[run] = max(worst.get(run, (0.0, "")), (float(share[run]), note))
    return {run: note for run, (_, note) in worst.items()}


@metric("1", "lower", 1e-9)
def constraint_violation(context: Context) -> Floats:
    """Largest violation of a limit or an equality, relative to its scale.

    For a limit, the violation beyond that at the start; its scale is its range, at least the body's
    reach or an eighth of a turn, at most a quarter turn. For an equality, at sampled states; its
    scale is the reach of the smaller body that it connects, the length of a tendon, or as for
    limits.
    """
    return worst_pair(
        context, [violation.peak / violation.scale for violation in _find_violations(context)]
    )


@metric("1", "lower", 1e-9, version=3)
def constraint_violation_rest(context: Context) -> Floats:
    """Violation of a limit or an equality at rest; see constraint_violation.

    For an equality, the median of the last quarter. A limit is less violated in a tenth of the last
    quarter; if it still swings back then, its violation where it comes to rest.
    """
    return worst_pair(
        context, [violation.rest / violation.scale for violation in _find_violations(context)]
    )


@label(
    "bad",
    rank=5,
    thresholds=(_PEAK_THRESHOLD, TOLERANCE, RATE),
    judged_on=(
        (_PEAK_THRESHOLD.name, _PEAK_THRESHOLD.name),
        ("constraint_violation_rest", TOLERANCE.name),
    ),
    letter="V",
    colour="#703efa",
    advice="a shorter time constant of limit or equality, or less load",
)
def constraint_violated(runs: MeasuredRuns) -> OnsetIterator:
    """A limit was pushed through, or a loop, weld, gear, rope or brake yields."""
    quarter = 3 * runs.context.trace.steps // 4
    at_rest = "constraint_violation_rest", TOLERANCE, " at rest", quarter
    for name, judge, when, begin in ((_PEAK_THRESHOLD.name, _PEAK_THRESHOLD, "", 0), at_rest):
        for run, _, limit in runs.over(name, judge.name):
            violations = _find_violations(runs.context)
            amounts = [
                violation.rest[run] if when else violation.peak[run] for violation in violations
            ]
            scales = [violation.scale for violation in violations]
            parts = np.divide(amounts, scales)
            worst = int(np.nanargmax(parts))
            far = (violations[place] for place in runs_where(parts > limit))
            bodies = dict.fromkeys(body for violation in far for body in violation.bodies)
            each, most = violations[worst], limit * scales[worst]
            reason = f"{each.name} is off by {_format_violation(amounts[worst], each.unit)}{when}"
            beyond = None if each.course is None else each.course[run, begin:] > most
            step = begin + (0 if beyond is None else first_step(beyond))
            reason = f"{reason} (limit {_format_violation(most, each.unit)})"
            yield run, Onset(reason, step, tuple(bodies))
    yield from _creeping_brakes(runs)
    # A limit yields in a run that is not the motion of its model.
    context, limit = runs.context, runs.limits[TOLERANCE.name]
    for run in () if context.setup.steered else unresolved_runs(context):
        for violation in _find_violations(context):
            most = violation.peak[run]
            if violation.course is not None and most > limit * violation.scale:
                off = f"{violation.name} is off by {_format_violation(most, violation.unit)}"
                step = first_step(violation.course[run] >= most)
                reason = f"{off}; {numerical_error_text(context, run)}"
                yield run, Onset(reason, step, violation.bodies)
