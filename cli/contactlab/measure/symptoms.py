"""Rules on contact that goes wrong in a run that is otherwise a simulation."""

from collections.abc import Iterator

import numpy as np

from contactlab.contact import Floats
from contactlab.measure.conservation import energy_scale, speed_bound
from contactlab.measure.context import Context, contact_depths, energy, speed_squared
from contactlab.measure.crossing import first_crossings
from contactlab.measure.label import Case, Finding, Findings, first, rows
from contactlab.measure.penetration import steady_by_pair


def tunneling(case: Case) -> Findings:
    """Find runs in which a body passes what should stop it."""
    found: Findings = {}
    for run, finding in (*_crossings(case.context), *_pierced(case)):
        if run not in found or finding.step < found[run].step:
            found[run] = finding
    return found


def energy_injection(case: Case) -> Findings:
    """Find runs in which a passive scene gains energy, or ejects a body."""
    ratio, limit = case.metrics["speed_ratio"], case.limits["speed_ratio"]
    found = {
        run: Finding(
            f"a body moved {ratio[run]:.3g} times as fast as the energy at the start allows "
            f"(limit {limit:g})",
            _fast_from(case.context, run, limit),
        )
        for run in rows(ratio > limit)
    }
    gain, limit = case.metrics["energy_gain"], case.limits["energy_gain"]
    for run in rows(gain > limit):
        values = energy(case.context)[run]
        risen = values - values[0] > limit * energy_scale(case.context)[run]
        reason = f"energy rose by {gain[run]:.3%} of that at the start (limit {limit:.3g})"
        found[run] = Finding(reason, first(risen))
    return found


def penetration_growth(case: Case) -> Findings:
    """Find runs in which a resting pair keeps sinking."""
    rate, limit = case.metrics["penetration_growth"], case.limits["penetration_growth"]
    sunk = rate * case.context.seconds / 2
    return {
        run: Finding(
            f"a resting pair sinks by {rate[run]:.3g} m/s, {sunk[run]:.3g} m in half the run "
            f"(limit {limit:g} m)",
            case.context.trace.steps // 2,
        )
        for run in rows(sunk > limit)
    }


def deep_penetration(case: Case) -> Findings:
    """Find runs in which a pair rests too deep in each other."""
    context, limit = case.context, case.limits["penetration_steady"]
    found: Findings = {}
    if context.trace.steps == 0:
        return found
    for index, steady in enumerate(steady_by_pair(context)):
        accepted = limit
        if "penetration_steady" not in context.setup.thresholds and context.series:
            accepted = min(limit, context.setup.thickness[index] / 2)
        for run in rows(steady > accepted):
            name = context.series[index].name if context.series else "the model"
            reason = f"{name} rests {steady[run]:.3g} m deep (limit {accepted:.3g} m)"
            depth = contact_depths(context)[index][1][run, context.tail]
            found[run] = Finding(reason, context.tail.start + first(depth > accepted))
    return found


def _crossings(context: Context) -> Iterator[tuple[int, Finding]]:
    for barrier in context.setup.barriers:
        pair = context.trace.pairs[barrier.pair].name
        for run, step in first_crossings(context, barrier).items():
            yield run, Finding(f"{barrier.body.name} passed the mid-plane of {pair}", step)


def _pierced(case: Case) -> Iterator[tuple[int, Finding]]:
    """Find pairs without a barrier that are deeper in each other than the thinner is thick."""
    context, asked = case.context, case.limits.get("pierced")
    guarded = {barrier.pair for barrier in context.setup.barriers}
    for index, series in enumerate(context.series):
        if index in guarded:
            continue
        depth = contact_depths(context)[index][1]
        limit = asked or float(context.setup.thickness[index])
        where = f"{limit:.3g} m" if asked else f"its middle, {limit:.3g} m from the surface"
        for run in rows(np.asarray((depth > limit).any(axis=1))):
            reason = f"{series.name} is deeper than {where}"
            yield run, Finding(reason, first(depth[run] > limit))


def _fast_from(context: Context, run: int, limit: float) -> int:
    """Return the first step after which some free body is faster than it may be."""
    steps: list[int] = []
    for body in context.setup.free_bodies:
        bound: Floats = speed_bound(context, body.mass)
        fast = speed_squared(context, body)[run] > (limit * bound[run]) ** 2
        if fast.any():
            steps.append(max(first(fast) - 1, 0))
    return min(steps, default=0)
