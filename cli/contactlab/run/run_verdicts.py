"""Verdicts on a run's results: expectations, tolerances, and effects that it needed."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from operator import itemgetter
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import (
    ANGULAR_VELOCITY,
    FORCE,
    LINEAR_VELOCITY,
    Trace,
    squared_lengths,
)
from contactlab.contact.trace_setup import pull_of
from contactlab.measure.coverage import TURNING
from contactlab.measure.entries import labels_with
from contactlab.measure.stick_slip import ENTER_SLIP
from contactlab.plan.grid import Plan
from contactlab.scene.model_names import name_of
from contactlab.schema.evidence import ParameterBudget
from contactlab.schema.sweep_schema import Bounds, Expectation

if TYPE_CHECKING:
    from contactlab.store.run_columns import RunColumns  # loads Arrow, which workers do without


def judge_expectations(
    expectations: Sequence[Expectation], labels: Sequence[str], metrics: Mapping[str, float | None]
) -> tuple[tuple[str, ...] | None, bool | None, str | None]:
    """Return the expected labels (any may occur), whether a run meets them, and why not.

    The result is empty without expectations. A run's labels are worst first; a run without labels
    is stable.
    """
    unmet = [
        reason
        for expectation in expectations
        for reason in _unmet_expectations(expectation, labels, metrics)
    ]
    expected = [label for expectation in expectations for label in expectation.label or ()]
    is_met = not unmet if expectations else None
    return tuple(dict.fromkeys(expected)) or None, is_met, "; ".join(unmet) or None


def within_tolerances(
    tolerances: Mapping[str, float], metrics: Mapping[str, float | None]
) -> bool | None:
    """Return whether every metric with a tolerance is within it; None if none of them is present.

    A metric that could not be measured is not within. Errors against a reference are judged
    separately, because a later pass computes them.
    """
    judged_values = {name: metrics[name] for name in tolerances if name in metrics}
    if not judged_values:
        return None
    return all(
        value is not None and abs(value) <= tolerances[name]
        for name, value in judged_values.items()
    )


def _unmet_expectations(
    expectation: Expectation, labels: Sequence[str], metrics: Mapping[str, float | None]
) -> Iterator[str]:
    allowed = expectation.label
    if allowed is not None and not set(allowed) & set(labels or ["stable"]):
        yield f"expected {' or '.join(allowed)}, found {', '.join(labels) or 'stable'}"
    broken = labels_with("required").intersection(labels) if expectation.must else ()
    if broken and not broken & set(allowed or ()):
        yield f"expected {', '.join(expectation.must)}, found {', '.join(sorted(broken))}"
    for name, bounds in expectation.metrics.items():
        yield from _outside_bounds(name, metrics[name], bounds)


def _outside_bounds(name: str, value: float | None, bounds: Bounds) -> Iterator[str]:
    if value is None:
        yield f"expected {name}, which could not be measured"
    elif bounds.min is not None and value < bounds.min:
        yield f"expected {name} of at least {bounds.min:g}, found {value:g}"
    elif bounds.max is not None and value > bounds.max:
        yield f"expected {name} of at most {bounds.max:g}, found {value:g}"


def conclude_runs(
    plan: Plan | None,
    budgets: Sequence[ParameterBudget],
    advisories: Sequence[str],
    unrepeatable: Sequence[str],
    table: "RunColumns",
) -> dict[str, object]:
    """Return the manifest entries about all runs of a plan's store together."""
    return {
        "unmet_means": tuple(unmet_means(plan, table)),
        "parameter_budgets": tuple(budgets),
        "advisories": tuple(advisories),
        "unrepeatable": tuple(unrepeatable),
    }


def unmet_means(plan: Plan | None, table: "RunColumns") -> Iterator[str]:
    """Yield the means over runs that violate a plan; empty without a plan, such as for a shard."""
    names = sorted({name for _, each in plan.expected for name in each.mean} if plan else ())
    if plan is None or not names:
        return
    columns = table.to_pydict(["index", *names])
    places = {index: row for row, index in enumerate(columns["index"])}
    stored_runs = [
        (run.values, places[run.index]) for run in plan.iterate_runs() if run.index in places
    ]
    for match, expectation in plan.expected:
        rows = [row for values, row in stored_runs if expectation.mean and match.is_met(values)]
        for name, bounds in expectation.mean.items():
            values = [columns[name][row] for row in rows]
            mean = None if None in values or not rows else sum(values) / len(rows)
            yield from _outside_bounds(f"a mean {name}", mean, bounds)


def missing_effects(
    trace: Trace, run: int, effects: Collection[str], model: mujoco.MjModel
) -> dict[str, str]:
    """Return the effects that the run needed although they were off, each with the evidence.

    Only some effects are considered, if the model has them and they were turned off: friction that
    would oppose motion in contacts, and limits that joints exceed. The trace is that of a group.
    """
    pull = float(pull_of(model.opt.gravity[None], float(model.stat.meansize))[0])
    effect_texts = {
        name: _first_opposed_motion(trace, run, name, pull) for name in _MOTIONS if name in effects
    }
    if "limit" in effects:
        beyond: list[tuple[int, str]] = []
        slide_joint = 2  # the engine's number of this kind of joint, of free, ball, slide, hinge
        for joint in np.flatnonzero(np.asarray(model.jnt_limited)).tolist():
            low, high = model.jnt_range[joint]
            # Only joints with one coordinate: a ball joint's limit is on its angle.
            if model.jnt_type[joint] >= slide_joint:
                place = trace.qpos[run, :, int(model.jnt_qposadr[joint])]
                steps = np.flatnonzero((place < low) | (place > high))
                beyond += [(step, name_of(model, "joint", joint)) for step in steps[:1].tolist()]
        if not beyond:
            effect_texts["limit"] = None
        else:
            step, name = min(beyond, key=itemgetter(0))
            effect_texts["limit"] = f"{name} passes its limit from step {step}"
    return {name: text for name, text in effect_texts.items() if text is not None}


def _first_opposed_motion(trace: Trace, run: int, name: str, pull: float) -> str | None:
    """Return the first motion in a contact that a friction effect would oppose.

    `pull` is gravity [m/s^2].
    """
    word, unit, least, *_ = _MOTIONS[name]
    least *= pull if unit == "m/s" else 1
    motions: list[tuple[int, str, float]] = []
    for pair in (monitored for monitored in trace.pairs if monitored.touched[run]):
        # The fastest motion that the effect would oppose, in contacts that carry force.
        slots = pair.slots[run]
        *_, velocity, parts = _MOTIONS[name]
        speeds = np.sqrt(squared_lengths(slots[..., velocity][..., parts]))
        speed = np.where(slots[..., FORCE.start] > 0, speeds, 0.0).max(axis=-1, initial=0.0)
        steps = np.flatnonzero(speed > least)
        motions += [(step, pair.name, float(speed.max())) for step in steps[:1].tolist()]
    if not motions:
        return None
    step, pair_name, fastest = min(motions, key=itemgetter(0))
    return f"{pair_name} {word} from step {step}, at up to {fastest:.3g} {unit}"


# By effect: the verb, the unit, the smallest speed [rad/s, or s of a fall], and the velocities with
# their components.
_MOTIONS = {
    "tangential_friction": ("slides", "m/s", ENTER_SLIP, LINEAR_VELOCITY, slice(1, 3)),
    "torsional_friction": ("spins", "rad/s", TURNING, ANGULAR_VELOCITY, slice(0, 1)),
    "rolling_friction": ("rolls", "rad/s", TURNING, ANGULAR_VELOCITY, slice(1, 3)),
}
