"""The energy of a run against the work of all forces in it, whatever drives the model."""

import numpy as np

from contactlab.contact.trace_arrays import ACTUATORS, CONSTRAINTS, OTHERS, Floats, fast_median
from contactlab.measure.amounts import readable_fraction
from contactlab.measure.backward_error import TOLERANCE, energy_drifts, unresolved_runs
from contactlab.measure.context import (
    Context,
    cached,
    energy,
    gravity,
    least_energy,
    peak_kinetic,
    semi_implicit,
)
from contactlab.measure.entries import MeasuredRuns, Onset, OnsetIterator, label, metric
from contactlab.rendering.amounts import format_percent


@cached
def _energy_scale(context: Context) -> Floats:
    """Return (n,) peak kinetic energy [J], at least that to lift everything by 4 % of a body.

    And at least the energy that passes through a driven model: the work of its actuators, whatever
    its sign.
    """
    # Share of a body's mean size; a gain that counts lifts everything by 1.2 % of it.
    lift_share = 0.04
    lift = context.setup.moving_mass * gravity(context) * lift_share * context.setup.size
    scale = np.maximum(peak_kinetic(context), np.maximum(lift, least_energy(context)))
    work = context.trace.work
    return scale if work is None else np.fmax(scale, np.abs(work[..., ACTUATORS]).sum(axis=1))


@cached
def _unexplained_energy(context: Context) -> Floats:
    """Return (n, N) the energy before each step that no force explains, as a share of the scale.

    Without an energy ledger, it is the change in steps without contact, if nothing may change then.
    """
    trace, change = context.trace, np.diff(energy(context), axis=1)
    if trace.work is None and not context.setup.conservative:
        change[:] = np.nan
    elif trace.steps > 1:
        # Steps move with the velocity at their end, which belongs to the middle of the step before.
        lag, (first, second) = np.diff(trace.potential, axis=1) / 2, trace.kinetic[:, :2].T
        before = lag[:, 0] * np.sqrt(first / np.maximum(second, np.finfo(float).tiny))
        lags = trace.work is not None or semi_implicit(context)[:, None]
        change -= np.diff(lag, axis=1, prepend=before[:, None]) * lags
    if trace.work is not None:
        change -= trace.work[:, :-1].sum(axis=2)
    elif context.setup.conservative:
        touching = trace.contacts > 0
        change[touching[:, :-1]] = 0
        # A contact may act in the later stages of a step that begins and ends without contact.
        change[(semi_implicit(context) == 0) & touching.any(axis=1)] = 0
    share = np.cumsum(change, axis=1) / _energy_scale(context)[:, None]
    return np.concatenate([np.zeros((len(share), 1)), share], axis=1)


@metric("1", "lower", 1e-9, version=2, kind="detail", requires="energy")
def integration_gain(context: Context) -> Floats:
    """Most energy that the integrator added, over the largest kinetic energy.

    The change of mechanical energy since the start less the work of all other forces, each with the
    mean velocity over a step. The largest kinetic energy counts as at least the energy to lift
    everything that moves by 4 % of a body's mean size, and the work of actuators. If only gravity,
    springs and contacts act, it is the change in steps without contact. Otherwise not defined with
    RK4, flexes and plug-ins.
    """
    return _unexplained_energy(context).max(axis=1)


@metric("1", "lower", 1e-9, version=4, kind="detail", requires="energy")
def integration_loss(context: Context) -> Floats:
    """Energy that the integrator removed for good, over the largest kinetic; see integration_gain.

    The median of the last quarter, because steps with swinging springs alternately add and remove
    energy.
    """
    return -fast_median(_unexplained_energy(context)[:, 3 * context.trace.steps // 4 :])


@metric("1", "lower", 1e-9, version=2, kind="detail", requires="energy")
def constraint_gain(context: Context) -> Floats:
    """Most energy that constraints gave beyond their stored energy, over the largest kinetic one.

    In the stretch of the run in which they gave most; if that stretch begins with an active
    constraint, at most the rise of energy beyond the work of actuators and other forces. The stored
    energy is at most half the spring force at rest times violation, and the whole carried force
    times violation. Not defined with RK4; if only gravity, springs and contacts act, so that
    energy_gain applies; and if moving mocap bodies, surface velocities or adhesion act through
    constraints.
    """
    trace = context.trace
    if trace.constraint_gain is None or trace.work is None:
        return context.undefined()
    runs, last = np.arange(trace.runs), context.trace.steps - 1
    stretch = np.minimum(np.nan_to_num(trace.constraint_gain[:, :2]), last)
    first, end = stretch.astype(np.intp).T
    after = np.minimum(end + 1, last)
    risen = energy(context)[runs, after] - energy(context)[runs, first]
    summed_work = np.concatenate(
        [np.zeros((trace.runs, 1, 3)), np.cumsum(trace.work, axis=1)], axis=1
    )
    work = summed_work[runs, end + 1] - summed_work[runs, first]
    others = work[:, ACTUATORS] + work[:, OTHERS]
    by_constraints = (
        np.minimum(work[:, CONSTRAINTS], risen - np.maximum(others, 0))
        - trace.constraint_gain[:, 2]
    )
    return np.where(
        trace.constraint_gain[:, 2] > 0, by_constraints, work[:, CONSTRAINTS]
    ) / _energy_scale(context)


@cached
def constraint_loss(context: Context) -> Floats:
    """Return (n,) the share of kinetic energy that constraints removed.

    Only for passive models; 0 for runs with contacts.
    """
    trace = context.trace
    if trace.work is None or not context.setup.passive:
        return context.undefined()
    loss = -trace.work[..., CONSTRAINTS].sum(axis=1) / _energy_scale(context)
    return np.where(trace.contacts.any(axis=1), 0, loss)


@label(
    "poor",
    rank=12,
    thresholds=(TOLERANCE,),
    judged_on=(("integration_loss", TOLERANCE.name),),
    letter="L",
    colour="#dfd816",
    advice="a shorter timestep, or integrator RK4 for free motion",
)
def energy_loss(runs: MeasuredRuns) -> OnsetIterator:
    """The run loses energy that no force took, or that its model keeps with finer steps."""
    drifting = dict(energy_drifts(runs, -1))
    yield from drifting.items()
    # A reference with finer steps may lose slowly, too; the balance of all work does not.
    for run, loss, limit in runs.over("integration_loss", TOLERANCE.name):
        if run not in drifting and not runs.context.setup.yielding:
            reason = f"the integrator removed {readable_fraction(loss)} the energy of the motion"
            reason = f"{reason} (limit {format_percent(limit)})"
            yield run, Onset(reason, 3 * runs.context.trace.steps // 4)


@label(
    "poor",
    rank=5,
    name="constraint_gain",
    thresholds=(TOLERANCE,),
    judged_on=(("constraint_gain", TOLERANCE.name),),
    letter="K",
    colour="#77a2fc",
    advice="timestep at most half the shortest time constant, or a longer constant",
    traits=("numerical",),
)
def generous_constraints(runs: MeasuredRuns) -> OnsetIterator:
    """Contacts, limits or equalities gave more energy than they stored, unlike in their model."""
    gain_of_runs, unresolved = runs.context.trace.constraint_gain, unresolved_runs(runs.context)
    for run, gain, limit in runs.over("constraint_gain", TOLERANCE.name):
        if run in unresolved:
            share = readable_fraction(gain)
            reason = f"constraints gave {share} the largest kinetic energy beyond their"
            step = 0 if gain_of_runs is None else int(gain_of_runs[run, 1])
            yield run, Onset(f"{reason} stored energy (limit {format_percent(limit)})", step)
