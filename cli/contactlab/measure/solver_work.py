"""The solver's work, its convergence, and its consistency in a second pass."""

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.measure.amounts import readable_fraction
from contactlab.measure.backward_error import TOLERANCE, resolved_runs
from contactlab.measure.context import Context, cached, count, first_step, runs_where, share
from contactlab.measure.entries import MeasuredRuns, Onset, OnsetIterator, Threshold, label, metric
from contactlab.rendering.amounts import format_amount, format_percent
from contactlab.schema.comparison import MetricRule

_DISTANCE_THRESHOLD = Threshold(
    "distance_error",
    None,
    "m",
    "On overlap_missed and distance_phantom. By default a hundred times ccd_tolerance, the "
    "accuracy of the model's collisions.",
)


@metric("1", "lower", kind="work", rule=MetricRule(rel=0.05, abs=0.05))
def solver_iterations_mean(context: Context) -> Floats:
    """Solver iterations per step, summed over contact islands, averaged over the run."""
    return context.trace.iterations.mean(axis=1)


@metric("1", "lower", kind="work", rule=MetricRule(rel=0.05, abs=1.0))
def solver_iterations_max(context: Context) -> Floats:
    """Most solver iterations that one contact island took in one step."""
    return context.trace.iterations_most.max(axis=1).astype(np.float64)


@metric("1", "lower", kind="work", rule=MetricRule(statistic="mean", budget=0.0))
def solver_iterations(context: Context) -> Floats:
    """Solver iterations of the whole run, over all contact islands."""
    return context.trace.iterations.sum(axis=1).astype(np.float64)


@metric("1", "lower", kind="work")
def saturated_share(context: Context) -> Floats:
    """Share of the steps in which an island used all its iterations; alone not a failure."""
    return share(is_saturated(context))


@metric("1", kind="work")
def contacts_mean(context: Context) -> Floats:
    """Contacts in the whole model, averaged over the run."""
    return context.trace.contacts.mean(axis=1)


@metric("1", kind="work")
def contacts_max(context: Context) -> Floats:
    """Most contacts in the whole model at any step."""
    return context.trace.contacts.max(axis=1).astype(np.float64)


@metric("1", "lower", kind="work")
def contacts_cut(context: Context) -> Floats:
    """Steps in which a monitored pair had more contacts than slots; the rest is not recorded."""
    return count(np.logical_or.reduce(_has_cut_contacts(context))).astype(np.float64)


@metric("1", kind="work")
def ungraded_contacts(context: Context) -> Floats:
    """Steps in which the model had contacts outside the monitored pairs."""
    monitored = context.net.found.sum(axis=0, dtype=np.int32)
    return count(context.trace.contacts > monitored).astype(np.float64)


@label(
    "bad",
    rank=9,
    thresholds=(TOLERANCE,),
    judged_on=(("solver_residual", TOLERANCE.name),),
    letter="N",
    colour="#2701df",
    advice="solver Newton, more iterations; or softer contacts (solref)",
)
def solver_nonconvergence(runs: MeasuredRuns) -> OnsetIterator:
    """The solver used all its iterations, and forces and accelerations still differ."""
    context, allowed = runs.context, runs.context.setup.iterations
    # A hit alone is not a failure: one allowed iteration solves an easy problem.
    hit = is_saturated(context)
    residual = sustained_residual(context, hit)
    for run in runs_where(residual > runs.limits[TOLERANCE.name]):
        share = format_percent(float(hit[run].mean()))
        iterations_used = f"the solver used all its {allowed[run]} iterations in {share} of the"
        difference = f"still differ by {residual[run]:.2g} of the largest force"
        reason = f"{iterations_used} steps, and forces and accelerations {difference}"
        yield run, Onset(reason, first_step(hit[run]))


@label(
    "noted",
    rank=1,
    name="contacts_cut",
    judged_on=(("contacts_cut", ""),),
    letter="6",
    colour="#622c63",
    advice="more `slots` of the pair in the scene",
    traits=("note",),
)
def unrecorded_contacts(runs: MeasuredRuns) -> OnsetIterator:
    """A pair had more contacts than slots; measurements use the recorded ones only."""
    context = runs.context
    for row, run in np.argwhere(_has_cut_contacts(context).any(axis=2)).tolist():
        place, cut = context.pairs.places[row], _has_cut_contacts(context)[row, run]
        name, slots = context.pairs.names[place], context.setup.slots[place]
        most = int(context.net.found[row, run].max())
        had = f"{name} had up to {most} contacts, but only {slots} were recorded"
        reason = f"{had}, in {cut.sum()} steps; give the pair more `slots`"
        yield run, Onset(reason, first_step(cut))


@cached
def is_saturated(context: Context) -> NDArray[np.bool_]:
    """Return (n, N) whether the solver used all allowed iterations."""
    return context.trace.iterations_most >= context.setup.iterations[:, None]


@cached
def _has_constraints(context: Context) -> NDArray[np.bool_]:
    """Return (n, N) whether there are contacts, or other constraints that the solver worked on."""
    return (context.trace.contacts > 0) | (context.trace.iterations > 0)


def stuck_share(context: Context) -> Floats:
    """Return (n,) the share of steps with all iterations used, among those with constraints."""
    constrained = _has_constraints(context)
    return count(is_saturated(context) & constrained) / count(constrained)


def sustained_residual(context: Context, where: NDArray[np.bool_]) -> Floats:
    """Return (n,) the sustained residual over all constrained steps; it is 0 outside of `where`.

    A quantile over few chosen steps alone would be the residual of a single step.
    """
    if context.checks is None:
        return context.undefined()
    chosen, constrained = np.where(where, context.checks.residual, 0.0), _has_constraints(context)
    # Quantile of the residual in contact: a single hard step is not a failure.
    sustained_quantile = 0.99
    return np.array(
        [
            np.quantile(residual[mask], sustained_quantile) if mask.any() else 0.0
            for residual, mask in zip(chosen, constrained, strict=True)
        ]
    )


@cached
def _has_cut_contacts(context: Context) -> NDArray[np.bool_]:
    """Return (R, n, N) whether pairs had more contacts than slots."""
    return context.net.found > context.setup.slots[context.pairs.places, None, None]


@metric("1", "lower", 1e-12, kind="check", version=4)
def solver_residual(context: Context) -> Floats:
    """Difference between forward and inverse dynamics over the run's largest constraint force.

    By the flag fwdinv, in constraint space; 99th percentile of the steps with constraints. Not
    defined with noslip, which changes forces after the solver. The largest force counts as at least
    the force that accelerates the model by a thousandth of gravity.
    """
    return sustained_residual(context, np.ones(context.trace.contacts.shape, dtype=np.bool_))


@metric("1", "lower", 1e-12, kind="check", version=2)
def jacobian_difference(context: Context) -> Floats:
    """Largest share of a step's constraint forces that the run's form of Jacobian leaves wrong.

    At the four steps that are solved worst, if the other form, dense or sparse, solves the equation
    of motion to 1e-6; 0 if the run's form does so, and not defined if neither does.
    """
    checks = context.checks
    return context.undefined() if checks is None else np.fmax.reduce(checks.jacobian, axis=1)


@metric("m", "lower", 1e-9, kind="check")
def overlap_missed(context: Context) -> Floats:
    """Deepest overlap of a monitored pair without contact at sampled states (mj_geomDistance)."""
    return context.undefined() if context.checks is None else context.checks.overlap.max(axis=1)


@metric("m", "lower", 1e-9, kind="check")
def distance_phantom(context: Context) -> Floats:
    """Largest distance beyond that reported by a contact at sampled states (mj_geomDistance).

    Not defined for speculative contacts.
    """
    return context.undefined() if context.checks is None else context.checks.apart.max(axis=1)


@metric("1", "higher", kind="check")
def repeats(context: Context) -> Floats:
    """1 if a second rollout reproduces every state bit for bit, otherwise 0."""
    checks = context.checks
    return context.undefined() if checks is None else checks.repeats.astype(np.float64)


@label(
    "bad",
    rank=10,
    thresholds=(TOLERANCE,),
    judged_on=tuple(
        (name, TOLERANCE.name)
        for name in ("cone_violation", "solver_residual", "jacobian_difference")
    ),
    letter="I",
    colour="#c3be22",
    advice="jacobian dense, solver Newton, and a smaller tolerance",
)
def solver_inconsistent(runs: MeasuredRuns) -> OnsetIterator:
    """The solver stopped early and wrong or left the cone, or its Jacobian or a second run differs.

    An early stop counts only in runs that are not known to be the motion of their model.
    """
    context, checks = runs.context, runs.context.checks
    for run, excess, limit in runs.over("cone_violation", TOLERANCE.name):
        reason = f"a force exceeds its cone by {readable_fraction(excess)} it"
        yield run, Onset(f"{reason} (limit {format_percent(limit)})", 0)
    if checks is None:
        return
    early = ~is_saturated(context)
    residual, limit = sustained_residual(context, early), runs.limits[TOLERANCE.name]
    resolved = resolved_runs(context)
    # If the solver converged, a few wrong forces may not matter for the motion.
    is_resolved = np.zeros(len(residual), dtype=np.bool_) if resolved is None else resolved
    for run in runs_where((residual > limit) & ~is_resolved):
        differ = f"forces and accelerations differ by {residual[run]:.2g} of the largest force"
        reason = f"the solver stopped early, but {differ} (limit {limit:g})"
        yield run, Onset(reason, first_step(early[run] & (checks.residual[run] > limit)))
    for run, difference, limit in runs.over("jacobian_difference", TOLERANCE.name):
        wrong = f"forces are wrong by {difference:.2g} of the constraint forces (limit {limit:g})"
        reason = (
            f"{wrong} with the run's form of Jacobian, dense or sparse, and right with the other"
        )
        step = checks.jacobian_steps[run][checks.jacobian[run] > limit].min()
        yield run, Onset(reason, int(step))
    for run in runs_where(~checks.repeats):
        yield run, Onset("a second rollout gave another trajectory", 0)


@label(
    "bad",
    rank=6,
    thresholds=(_DISTANCE_THRESHOLD,),
    judged_on=(("overlap_missed", _DISTANCE_THRESHOLD.name),),
    letter="M",
    colour="#4210a9",
    advice="contype, conaffinity and exclude: let the pair collide; multiccd for meshes",
    traits=("no impact",),
)
def missed_contact(runs: MeasuredRuns) -> OnsetIterator:
    """A monitored pair overlaps without a contact."""
    if checks := runs.context.checks:
        yield from _find_distance_errors(
            runs, checks.overlap, "a pair overlaps without any contact"
        )


@label(
    "bad",
    rank=4,
    thresholds=(_DISTANCE_THRESHOLD,),
    judged_on=(("distance_phantom", _DISTANCE_THRESHOLD.name),),
    letter="H",
    colour="#867efa",
    advice="margin 0, or a convex shape that is closer to the visible shape",
)
def phantom_contact(runs: MeasuredRuns) -> OnsetIterator:
    """A contact is reported between separated bodies."""
    if checks := runs.context.checks:
        yield from _find_distance_errors(runs, checks.apart, "a contact is deeper than its bodies")


def _find_distance_errors(runs: MeasuredRuns, amounts: Floats, fault: str) -> OnsetIterator:
    # Ratio of the smallest reported distance error to the accuracy of collisions.
    distance_error_factor = 100
    limit = runs.limits.get(
        _DISTANCE_THRESHOLD.name, distance_error_factor * runs.context.setup.exact
    )
    checks = runs.context.checks
    for run in runs_where(amounts.max(axis=1) > limit):
        first = first_step(amounts[run] > limit)
        largest, most = format_amount(amounts[run].max(), "mm"), format_amount(limit, "mm")
        reason = f"{fault}, by {largest} (limit {most})"
        yield run, Onset(reason, int(checks.geometry_steps[first]) if checks else 0)
