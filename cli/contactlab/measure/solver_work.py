"""The solver's work, whether it got done, and whether a second pass finds it consistent."""

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.measure.amounts import part_of
from contactlab.measure.backward_error import TOLERANCE, resolved_runs
from contactlab.measure.context import Context, cached, count, first_step, runs_where, share
from contactlab.measure.entries import Found, MeasuredRuns, Onset, Threshold, label, metric
from contactlab.schema.comparison import MetricRule

_DISTANCE = Threshold(
    "distance_error",
    None,
    "m",
    "On overlap_missed and distance_phantom. Unless set, a hundred times ccd_tolerance, to which "
    "the model's collisions are exact.",
)
_EXACT = 100  # How many times coarser than collisions are what is wrong of them is
_SUSTAINED = 0.99  # Quantile of the residual in contact: a single hard step is no failure


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
    """Share of the steps in which an island used all its iterations, which alone is no failure."""
    return share(saturated(context))


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
    """Steps in which a monitored pair had more contacts than slots; the rest went unrecorded."""
    return count(np.logical_or.reduce(_cut(context))).astype(np.float64)


@metric("1", kind="work")
def ungraded_contacts(context: Context) -> Floats:
    """Steps in which the model had contacts outside the monitored pairs."""
    monitored = context.net.found.sum(axis=0, dtype=np.int32)
    return count(context.trace.contacts > monitored).astype(np.float64)


@label(
    "bad",
    rank=9,
    thresholds=(TOLERANCE,),
    letter="N",
    colour="#2701df",
    advice="solver Newton, more iterations; or softer contacts (solref)",
)
def solver_nonconvergence(runs: MeasuredRuns) -> Found:
    """The solver used all its iterations, and forces and accelerations still differ."""
    context, allowed = runs.context, runs.context.setup.iterations
    # A hit alone is no failure: an easy problem is solved by the one iteration it is given.
    hit = saturated(context)
    residual = sustained_residual(context, hit)
    for run in runs_where(residual > runs.limits[TOLERANCE.name]):
        used = f"the solver used all its {allowed[run]} iterations in {hit[run].mean():.0%} of the"
        left = f"still differ by {residual[run]:.2g} of the largest force"
        reason = f"{used} steps, and forces and accelerations {left}"
        yield run, Onset(reason, first_step(hit[run]))


@label(
    "noted",
    rank=1,
    name="contacts_cut",
    letter="6",
    colour="#622c63",
    advice="more `slots` of the pair in the scene",
)
def unrecorded_contacts(runs: MeasuredRuns) -> Found:
    """A pair had more contacts than slots; what is measured is of the recorded ones alone."""
    context = runs.context
    for row, run in np.argwhere(_cut(context).any(axis=2)).tolist():
        place, cut = context.pairs.places[row], _cut(context)[row, run]
        name, slots = context.pairs.names[place], context.setup.slots[place]
        most = int(context.net.found[row, run].max())
        had = f"{name} had up to {most} contacts, of which {slots} were recorded"
        reason = f"{had}, in {cut.sum()} steps; give the pair more `slots`"
        yield run, Onset(reason, first_step(cut))


@cached
def saturated(context: Context) -> NDArray[np.bool_]:
    """Return (n, N) whether the solver used all the iterations that it may."""
    return context.trace.iterations_most >= context.setup.iterations[:, None]


@cached
def _constrained(context: Context) -> NDArray[np.bool_]:
    """Return (n, N) where there are contacts, or constraints that the solver had work with."""
    return (context.trace.contacts > 0) | (context.trace.iterations > 0)


def stuck_share(context: Context) -> Floats:
    """Return (n,) the share of the steps with constraints in which all iterations were used."""
    constrained = _constrained(context)
    return count(saturated(context) & constrained) / count(constrained)


def sustained_residual(context: Context, where: NDArray[np.bool_]) -> Floats:
    """Return (n,) what is sustained in all steps with constraints of the residual in some; else 0.

    Of few steps by themselves, it would be that of a single one.
    """
    if context.checks is None:
        return context.undefined()
    chosen, constrained = np.where(where, context.checks.residual, 0.0), _constrained(context)
    return np.array(
        [
            np.quantile(residual[mask], _SUSTAINED) if mask.any() else 0.0
            for residual, mask in zip(chosen, constrained, strict=True)
        ]
    )


@cached
def _cut(context: Context) -> NDArray[np.bool_]:
    """Return (R, n, N) where pairs had more contacts than slots."""
    return context.net.found > context.setup.slots[context.pairs.places, None, None]


@metric("1", "lower", 1e-12, kind="check", version=4)
def solver_residual(context: Context) -> Floats:
    """Difference between forward and inverse dynamics over the run's largest constraint force.

    By the flag fwdinv, in constraint space; 99th percentile of the steps with constraints. Not
    defined with noslip, which changes forces after the solver. The largest force counts as at least
    what accelerates the model by a thousandth of gravity.
    """
    return sustained_residual(context, np.ones(context.trace.contacts.shape, dtype=np.bool_))


@metric("1", "lower", 1e-12, kind="check")
def jacobian_difference(context: Context) -> Floats:
    """Largest relative difference of accelerations from dense and sparse Jacobians, as sampled."""
    return context.undefined() if context.checks is None else context.checks.jacobian.max(axis=1)


@metric("m", "lower", 1e-9, kind="check")
def overlap_missed(context: Context) -> Floats:
    """Deepest overlap of a monitored pair without contact at sampled states (mj_geomDistance)."""
    return context.undefined() if context.checks is None else context.checks.overlap.max(axis=1)


@metric("m", "lower", 1e-9, kind="check")
def distance_phantom(context: Context) -> Floats:
    """Largest distance beyond what a contact reports at sampled states (mj_geomDistance).

    Not defined for speculative contacts.
    """
    return context.undefined() if context.checks is None else context.checks.apart.max(axis=1)


@metric("1", "higher", kind="check")
def repeats(context: Context) -> Floats:
    """1 if a second rollout gives every state again, bit for bit, else 0."""
    checks = context.checks
    return context.undefined() if checks is None else checks.repeats.astype(np.float64)


@label(
    "bad",
    rank=10,
    thresholds=(TOLERANCE,),
    letter="I",
    colour="#c3be22",
    advice="jacobian dense, solver Newton, and a smaller tolerance",
)
def solver_inconsistent(runs: MeasuredRuns) -> Found:
    """The solver stopped early and wrong or left the cone, or a sparse Jacobian or run differs.

    That it stopped early counts in runs alone that are not known to be the motion of their model.
    """
    context, checks = runs.context, runs.context.checks
    for run, excess, limit in runs.over("cone_violation", TOLERANCE.name):
        yield run, Onset(f"a force exceeds its cone by {part_of(excess)} it (limit {limit:g})", 0)
    if checks is None:
        return
    early = ~saturated(context)
    residual, limit = sustained_residual(context, early), runs.limits[TOLERANCE.name]
    resolved = resolved_runs(context)
    # Of a solver that was content, a few wrong forces may be worth nothing to the motion.
    known = np.zeros(len(residual), dtype=np.bool_) if resolved is None else resolved
    for run in runs_where((residual > limit) & ~known):
        differ = f"forces and accelerations differ by {residual[run]:.2g} of the largest force"
        reason = f"the solver stopped early, but {differ} (limit {limit:g})"
        yield run, Onset(reason, first_step(early[run] & (checks.residual[run] > limit)))
    for run, difference, limit in runs.over("jacobian_difference", TOLERANCE.name):
        differ = f"a dense and a sparse Jacobian give accelerations that differ by {difference:.2g}"
        step = checks.jacobian_steps[first_step(checks.jacobian[run] > limit)]
        yield run, Onset(f"{differ} (limit {limit:g})", int(step))
    for run in runs_where(~checks.repeats):
        yield run, Onset("a second rollout gave another trajectory", 0)


@label(
    "bad",
    rank=6,
    thresholds=(_DISTANCE,),
    letter="M",
    colour="#4210a9",
    advice="contype, conaffinity and exclude: let the pair collide; multiccd for meshes",
    traits=("no impact",),
)
def missed_contact(runs: MeasuredRuns) -> Found:
    """A monitored pair overlaps without a contact."""
    if checks := runs.context.checks:
        yield from _misjudged(runs, checks.overlap, "a pair overlaps without any contact")


@label(
    "bad",
    rank=4,
    thresholds=(_DISTANCE,),
    letter="H",
    colour="#867efa",
    advice="margin 0, or a convex shape that is nearer to what is seen",
)
def phantom_contact(runs: MeasuredRuns) -> Found:
    """A contact is reported between separated bodies."""
    if checks := runs.context.checks:
        yield from _misjudged(runs, checks.apart, "a contact is deeper than its bodies")


def _misjudged(runs: MeasuredRuns, amounts: Floats, what: str) -> Found:
    limit = runs.limits.get(_DISTANCE.name, _EXACT * runs.context.setup.exact)
    checks = runs.context.checks
    for run in runs_where(amounts.max(axis=1) > limit):
        first = first_step(amounts[run] > limit)
        reason = f"{what}, by {amounts[run].max():.3g} m (limit {limit:g} m)"
        yield run, Onset(reason, int(checks.geometry_steps[first]) if checks else 0)
