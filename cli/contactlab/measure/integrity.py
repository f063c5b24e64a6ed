"""Rules on whether a run is a simulation at all: clock, numbers, solver."""

from collections.abc import Iterator

import numpy as np

from contactlab.contact import Floats
from contactlab.measure.checks import unconverged
from contactlab.measure.context import Context, energy
from contactlab.measure.label import Case, Finding, Findings, first, rows
from contactlab.measure.solver import cut_by_pair, saturated

_FEWEST_ITERATIONS = 2


def invalid(case: Case) -> Findings:
    """Find runs that ask for nothing that can be simulated, or recorded nothing."""
    trace, setup = case.context.trace, case.context.setup
    found: Findings = {}
    for run in range(trace.runs):
        if not trace.timestep[run] > 0:
            found[run] = Finding(f"timestep {trace.timestep[run]:g} s is not positive", 0)
        elif not setup.duration[run] > 0:
            found[run] = Finding(f"duration {setup.duration[run]:g} s is not positive", 0)
        elif trace.steps == 0:
            found[run] = Finding("no step was recorded", 0)
    return found


def diverged(case: Case) -> Findings:
    """Find runs whose numbers, clock or length show that the engine lost them."""
    signs: dict[int, list[Finding]] = {}
    for check in (_warnings, _cut_short, _not_finite, _clock, _quaternions):
        for run, finding in check(case):
            signs.setdefault(run, []).append(finding)
    return {
        run: Finding("; ".join(sign.reason for sign in found), min(sign.step for sign in found))
        for run, found in sorted(signs.items())
    }


def solver_nonconvergence(case: Case) -> Findings:
    """Find runs whose solver used all its iterations in most steps with contact."""
    context, limit = case.context, case.limits["saturated_share"]
    if context.trace.steps == 0:
        return {}
    if context.checks is not None:
        # A hit alone is no failure: an easy problem is solved by the one iteration it is given.
        return unconverged(case)
    hit = saturated(context) & (context.trace.contacts > 0)
    share = hit.sum(axis=1) / (context.trace.contacts > 0).sum(axis=1)
    allowed = context.setup.iterations
    return {
        run: Finding(
            f"the solver used all its {allowed[run]} iterations in {share[run]:.0%} of the steps "
            f"with contact (limit {limit:.0%})",
            first(hit[run]),
        )
        for run in rows((share >= limit) & (allowed >= _FEWEST_ITERATIONS))
    }


def contacts_cut(case: Case) -> Findings:
    """Find runs of which some contacts are missing in the evidence."""
    context, found = case.context, Findings()
    for index, cut in enumerate(cut_by_pair(context)):
        name, slots = context.series[index].name, context.setup.slots[index]
        for run in rows(cut.sum(axis=1) > 0):
            most = int(context.folded[index].found[run].max())
            reason = (
                f"{name} had up to {most} contacts, of which {slots} were recorded, in "
                f"{cut[run].sum()} steps; give the pair more `slots`"
            )
            found.setdefault(run, Finding(reason, first(cut[run])))
    return found


def _warnings(case: Case) -> Iterator[tuple[int, Finding]]:
    trace = case.context.trace
    for run, counts in enumerate(trace.warnings):
        raised = [f"{name} x{count}" for name, count in counts.items() if count > 0]
        if raised:
            yield run, Finding(f"engine warnings: {', '.join(raised)}", _last(case.context))


def _cut_short(case: Case) -> Iterator[tuple[int, Finding]]:
    trace = case.context.trace
    if trace.steps < trace.steps_asked:
        reason = f"stopped after {trace.steps} of {trace.steps_asked} steps"
        for run in range(trace.runs):
            yield run, Finding(reason, _last(case.context))


def _not_finite(case: Case) -> Iterator[tuple[int, Finding]]:
    trace = case.context.trace
    watched = {"qpos": trace.qpos, "qvel": trace.qvel}
    if trace.has_energy:
        watched["energy"] = energy(case.context)[:, :, None]
    for name, values in watched.items():
        # A sum is finite only if every number in it is; the step is looked up where it is not.
        for run in rows(~np.isfinite(values.sum(axis=(1, 2)))):
            bad = ~np.isfinite(values[run]).all(axis=1)
            state = first(bad) if name == "energy" else max(first(bad) - 1, 0)
            yield run, Finding(f"{name} is not finite", state)


def _clock(case: Case) -> Iterator[tuple[int, Finding]]:
    trace, limit = case.context.trace, case.limits["clock_error"]
    if trace.steps == 0:
        return
    ticks = np.diff(trace.time, axis=1)
    rounding = 4 * np.finfo(np.float64).eps * np.abs(trace.time).max(axis=1)
    slack = limit * trace.timestep + rounding
    low, high = trace.timestep - slack, trace.timestep + slack
    regular = (ticks.min(axis=1) >= low) & (ticks.max(axis=1) <= high)
    for run in rows(~regular):
        step = first(~((ticks[run] >= low[run]) & (ticks[run] <= high[run])))
        reason = f"the clock moved by {ticks[run, step]:.3g} s in a step of "
        yield run, Finding(f"{reason}{trace.timestep[run]:.3g} s", step)


def _quaternions(case: Case) -> Iterator[tuple[int, Finding]]:
    limit = case.limits["quaternion_error"]
    low, high = (1 - limit) ** 2, (1 + limit) ** 2
    for start in case.context.setup.quaternions:
        square = _square(case.context.trace.qpos[:, :, start : start + 4])
        unit = (square.min(axis=1) >= low) & (square.max(axis=1) <= high)
        for run in rows(~unit & np.isfinite(square).all(axis=1)):
            state = first((square[run] < low) | (square[run] > high))
            norm = np.sqrt(square[run, state])
            yield (
                run,
                Finding(f"the quaternion at qpos {start} has norm {norm:.4g}", max(state - 1, 0)),
            )


def _square(quaternion: Floats) -> Floats:
    w, x, y, z = (quaternion[:, :, part] for part in range(4))
    return w * w + x * x + y * y + z * z


def _last(context: Context) -> int:
    return max(context.trace.steps - 1, 0)
