"""Computes every metric, label and series of a trace."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import (
    Floats,
    PairSeries,
    SelfChecks,
    Trace,
    fast_median,
    read_only,
    squared_lengths,
)
from contactlab.contact.trace_setup import Setup
from contactlab.errors import ContactlabError, error_text
from contactlab.foreign_code import ends_command, kept_folder
from contactlab.measure.backward_error import (
    TOLERANCE,
    is_resolved,
    numerical_error_text,
    resolved_runs,
)
from contactlab.measure.constraint_violation import constraint_violation, list_accepted_limits
from contactlab.measure.context import Context, StackedPairs, context_of, squared_speeds
from contactlab.measure.coverage import run_coverages
from contactlab.measure.energy_balance import (
    constraint_gain,
    constraint_loss,
    integration_gain,
    integration_loss,
)
from contactlab.measure.entries import (
    LABELS,
    METRICS,
    MeasuredRuns,
    Metric,
    labels_with,
    threshold_values,
)
from contactlab.measure.motion import list_final_falls
from contactlab.measure.penetration import PRESSED, accepted_overlaps, weights_borne
from contactlab.measure.run_integrity import STABLE, invalid, stable_reason
from contactlab.measure.solver_work import stuck_share
from contactlab.schema.coverage import Coverage

Failures = dict[int, list[str]]  # error messages of metrics and labels, by run

_RunResult = TypeVar("_RunResult")
# Whether degrees of freedom are translations, by kind of joint.
_IS_TRANSLATION = {
    "free": [True] * 3 + [False] * 3,
    "ball": [False] * 3,
    "slide": [True],
    "hinge": [False],
}

NUMERICAL_CAUSE, MODEL_CAUSE = "cause: the numerics", "cause: the model"
"""Words in the reason of a label that a numerical error causes, and in that of another."""


class AppliedLabel(NamedTuple):
    """A label that applies to a run: the reason, its first step, and its bodies.

    A label of the whole run has no bodies.
    """

    label: str
    reason: str
    step: int
    bodies: tuple[str, ...] = ()


@dataclass(frozen=True)
class Assessment:
    """Measurements of n runs."""

    metrics: dict[str, Floats]  # every metric by name, (n,) each; NaN if it does not apply
    # For each run the labels that apply, worst first; `stable` if none does.
    labels: tuple[tuple[AppliedLabel, ...], ...]
    pairs: StackedPairs  # the contacts of the monitored pairs
    # (n,) whether a second pass is due: because of a label, or of a sign that no label covers.
    suspect: NDArray[np.bool_]
    # For each run the body with its backward error; None if none was measured.
    backward_error_body: tuple[str, ...] | None = None
    # The coverage of each run; None if the setup does not request it.
    coverage: tuple[Coverage, ...] | None = None

    @property
    def series(self) -> tuple[PairSeries, ...]:
        """The net quantities of each monitored pair over time."""
        return self.pairs.series


def assess_runs(trace: Trace, setup: Setup, checks: SelfChecks | None = None) -> Assessment:
    """Measure and label the runs of a trace, with the results of a second pass if there was one.

    Raises a SceneError if the setup names an oracle or a threshold that does not exist.
    """
    context = context_of(trace, setup, checks)
    failures: Failures = {}
    with np.errstate(all="ignore"):
        metrics = {
            name: _measure_metric(metric, context, failures) for name, metric in METRICS.items()
        }
        runs = MeasuredRuns(context, metrics)
        applied: list[list[AppliedLabel]] = [[] for _ in range(runs.context.trace.runs)]
        for name, label in LABELS.items():
            onsets = _measure_or_fail(f"label '{name}'", label.of, runs, failures, None)
            for own, onset in zip(applied, onsets, strict=True):
                if onset:
                    own.append(AppliedLabel(name, *onset))
        applied = [[*_add_causes(runs.context, *indexed)] for indexed in enumerate(applied)]
        for run, reasons in failures.items():
            others = [verdict for verdict in applied[run] if verdict.label != invalid.__name__]
            applied[run] = [AppliedLabel(invalid.__name__, "; ".join(reasons), 0), *others]
        labels = tuple(map(tuple, _fill_stable(context, applied)))
        suspect = np.array([own[0].label != STABLE.name for own in labels])
        if checks is None and trace.steps:
            suspect |= needs_second_pass(context)
        covered = run_coverages(context)
    bodies = tuple(error.body for error in checks.backward) if checks else ()
    return Assessment(metrics, labels, context.pairs, suspect, bodies or None, covered)


def _fill_stable(
    context: Context, labels: Sequence[Sequence[AppliedLabel]]
) -> Iterator[Sequence[AppliedLabel]]:
    # A run without a label is stable; its reason has accepted overlaps and notes.
    overlaps = accepted_overlaps(context)
    notes = list_accepted_limits(context), list_final_falls(context)
    for run, own in enumerate(labels):
        noted = [note[run] for note in notes if run in note]
        reason = stable_reason(overlaps.get(run), noted)
        yield own or (AppliedLabel(STABLE.name, reason, 0),)


def _measure_metric(metric: Metric, context: Context, failures: Failures) -> Floats:
    def measure_runs(runs: MeasuredRuns) -> Sequence[float]:
        return metric.of(runs.context).tolist()

    runs = MeasuredRuns(context, {})
    name = f"metric '{metric.name}'"
    return read_only(np.array(_measure_or_fail(name, measure_runs, runs, failures, np.nan)))


def _add_causes(context: Context, run: int, labels: list[AppliedLabel]) -> Iterator[AppliedLabel]:
    """Yield labels of a run; those that may be numerical get their cause in the reason.

    It is judged by the numerical error of the label's bodies and those that touched them: a wrong
    force on one is a wrong force on the other, but the error of a body elsewhere says nothing.
    """
    traced = labels_with("numerical")
    for label in labels:
        if resolved_runs(context) is None or label.label not in traced:
            yield label
        else:
            bodies = {*label.bodies, *_find_touched(context, run, label.bodies)}
            is_of_model = is_resolved(context, run, bodies)
            cause = MODEL_CAUSE if is_of_model else NUMERICAL_CAUSE
            error = numerical_error_text(context, run, bodies)
            yield label._replace(reason=f"{label.reason}; {cause} ({error})")


def blame_model(reason: str, error: str) -> str:
    """Return the reason of a label with the model as its cause, if it names the numerics.

    Arguments:
        reason: of a label, with the numerical error of the whole run.
        error: numerical error of the phase of the label, in words.
    """
    before, numerics, _ = reason.partition(f"; {NUMERICAL_CAUSE} (")
    return f"{before}; {MODEL_CAUSE} ({error})" if numerics else reason


def _find_touched(context: Context, run: int, bodies: Sequence[str]) -> Iterator[str]:
    rows = context.pairs.rows.tolist()
    for sides, row in zip(context.setup.sides, rows, strict=False):
        if not {*sides}.isdisjoint(bodies) and context.net.found[row, run].any():
            yield from sides


def _measure_or_fail(
    name: str,
    measure: Callable[[MeasuredRuns], Sequence[_RunResult]],
    runs: MeasuredRuns,
    failures: Failures,
    missing: _RunResult,
) -> Sequence[_RunResult]:
    """Return the measurements of each run; for a failed run, `missing` and the error message."""
    count = runs.context.trace.runs
    try:
        with kept_folder():
            return measure(runs)
    except BaseException as error:  # a plug-in may raise anything
        if isinstance(error, ContactlabError) or ends_command(error):
            raise
        if count == 1:
            reason = f"{name} failed: {error_text(error)}"
            failures.setdefault(0, []).append(reason)
            return [missing]
    # Measure runs one by one, so that a run's result does not depend on the other runs.
    results: list[_RunResult] = []
    for run in range(count):
        alone: Failures = {}
        results += _measure_or_fail(name, measure, runs.only(run), alone, missing)
        if alone:
            failures.setdefault(run, []).extend(alone[0])
    return results


def _find_oscillations(context: Context, late: Floats) -> NDArray[np.bool_]:
    """Return (n,) whether speeds oscillate from step to step, by a share of gravity.

    Free joints count only without contact, because bodies hop as they slide.
    """
    mechanism = context.setup.mechanism
    size, joints = context.setup.size, mechanism.joints if mechanism else ()
    hinged = [joint.kind != "free" for joint in joints for _ in _IS_TRANSLATION[joint.kind]] or [
        True
    ]
    aloft = context.trace.contacts.max(axis=1, initial=0)[:, None] == 0
    min_speeds = 3  # fewest speeds that can show an oscillation
    if late.shape[1] < min_speeds:
        return np.zeros(len(late), bool)
    swing = fast_median(np.swapaxes(np.abs(np.diff(late, n=2, axis=1)) / 4, 1, 2))
    min_oscillation = 0.15  # smallest amplitude of a step-to-step oscillation, over the speed
    swing *= (swing >= min_oscillation * np.sqrt((late**2).mean(axis=1))) & (
        np.array(hinged) | aloft
    )
    acceleration = 2 * size * swing.max(axis=1, initial=0) / context.trace.timestep
    return (
        acceleration
        > threshold_values(context.setup.thresholds)[TOLERANCE.name] * context.setup.pull
    )


def needs_second_pass(context: Context) -> NDArray[np.bool_]:
    """Return (n,) which runs need a second pass although no label applies.

    Such a run oscillates in its steps, is pressed hard at rest or against a limit, has a solver
    that uses all its iterations, gains or loses energy in constraints or by its steps, does not
    come to rest under constant controls, or has a body that moved far from its rest position or
    rattled.
    """
    trace, ranges = context.trace, context.trace.control_ranges
    most = threshold_values(context.setup.thresholds)
    # Speeds of the last quarter [rad/s, or mean body sizes a second].
    late, mechanism = trace.qvel[:, 3 * trace.steps // 4 :], context.setup.mechanism
    if mechanism is not None:
        along = [moves for joint in mechanism.joints for moves in _IS_TRANSLATION[joint.kind]]
        late = late / np.where(along, context.setup.size, 1.0)
    is_needed = _find_oscillations(context, late)
    is_needed |= weights_borne(context) > most[PRESSED.name]
    min_saturated_share = 0.5  # share of steps with all iterations used
    is_needed |= stuck_share(context) >= min_saturated_share
    within = most[TOLERANCE.name]
    is_needed |= (constraint_loss(context) > within) & (stuck_share(context) == 0)
    is_needed |= constraint_gain(context) > within
    is_needed |= (integration_gain(context) > within) | (integration_loss(context) > within)
    is_needed |= constraint_violation(context) > within
    if ranges is not None and ranges.shape[1]:
        constant = (ranges[..., 0] == ranges[..., 1]).all(axis=1)
        # Smallest speed of a moving body [rad/s, or mean body sizes a second].
        min_moving_speed = 0.1
        is_needed |= constant & (np.sqrt((late**2).mean(axis=(1, 2))) > min_moving_speed)
    changes = (np.diff(trace.contacts[:, : trace.steps // 2]) != 0).sum(axis=1)
    # Share of the first half's steps with a change of the number of contacts.
    min_rattle_share = 0.1
    rattles = changes > min_rattle_share * trace.steps / 2
    squares = squared_speeds(context)
    early = squares[..., : 1 + trace.steps // 10]
    first, fastest = (np.sqrt(speeds.max(axis=2)) for speeds in (early, squares))
    for body, rested in zip(context.setup.free_bodies, first < 0.01 * fastest, strict=True):
        # A body that falls or rolls from the start was not at rest.
        far = np.sqrt(squared_lengths(context.displacement(body))) > context.setup.size
        is_needed |= (rested | rattles) & far & (trace.contacts[:, :1] > 0).any(axis=1)
    return is_needed
