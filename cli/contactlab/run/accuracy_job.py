"""Hold the runs of one family, which share a reference, against it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from contactlab.contact import Floats
from contactlab.engines import integrate_to
from contactlab.measure import Discrepancy
from contactlab.run.job import Finished, Job
from contactlab.run.notes import Note, note
from contactlab.run.preparing import Preparer
from contactlab.run.record import RunPlan
from contactlab.run.reference import Referee, Reference, Watch

# Common times of a run and its reference, and restarts from the reference's states; fewer where
# runs of many timesteps would have the reference keep too many states.
_SAMPLES, _FEWEST = 256, 16
_RESTARTS = 32
_BYTES = 32 << 20
# A family is chaotic if what starts 1e-8 away parts by this share of the model's extent, and by
# this share of the runs' median error or so many times what the reference may be off by.
_EXTENT = 1e-3
_ERROR = 0.1
_ESTIMATE = 10.0


class _Times(NamedTuple):
    """When a run is held against its reference.

    Attributes:
        begins: (K,) when it is restarted from the reference's state [s]; empty for whole runs.
        ends: (T,) when it is compared [s].
    """

    begins: Floats
    ends: Floats


def errors_of(preparer: Preparer, job: Job) -> list[Finished]:
    """Return a note of each run of a family: every kind of error that the sweep may choose."""
    plans = preparer.plans(job)
    with preparer.watchdog_or_give_up() as watch:
        found = _found(preparer, plans, watch)
    return [note("errors", plan.run.run_id, each) for plan, each in zip(plans, found, strict=True)]


def _found(preparer: Preparer, plans: Sequence[RunPlan], watch: Watch) -> list[Note]:
    ask = preparer.task.sweep.accuracy
    assert ask is not None
    local = ask.error == "local"
    longest = max(plan.resolved.timestep for plan in plans)
    least = min(plan.resolved.timestep for plan in plans)
    samples = _samples(plans)
    spread = [_stretches(plan, longest) if local else _times(plan, samples) for plan in plans]
    needed = np.unique(np.concatenate([part for times in spread for part in times]))
    referee = Referee(preparer, plans[0], ask.refine, watch)
    reference = referee.reference(least, needed)
    if reference is None:
        return [{} for _ in plans]
    held = _locally if local else _globally
    pairs = zip(plans, spread, strict=True)
    notes = [held(reference, plan, times, watch) for plan, times in pairs]
    told: dict[str, object] = {"integrator": reference.integrator, "timestep": reference.timestep}
    if not local:
        told["chaotic"] = _is_chaotic(reference, referee.parting(reference), notes)
    return [{**note, **told} for note in notes]


def _samples(plans: Sequence[RunPlan]) -> int:
    """Return how many times of each run may be kept of its reference."""
    model = plans[0].prepared.model
    state = 8 * (1 + model.nq + model.nv + model.na)
    timesteps = len({plan.resolved.timestep for plan in plans})
    return max(_FEWEST, min(_SAMPLES, _BYTES // (state * timesteps)))


def _times(plan: RunPlan, samples: int) -> _Times:
    """Spread times over a run."""
    resolved = plan.resolved
    return _Times(np.empty(0), resolved.timestep * _spread(1, resolved.steps, samples))


def _stretches(plan: RunPlan, longest: float) -> _Times:
    """Spread restarts over a run, each of as many steps as the family's longest one takes."""
    total, timestep = plan.resolved.steps, plan.resolved.timestep
    steps = min(total, max(1, round(longest / timestep)))
    begins = _spread(0, total - steps, _RESTARTS)
    return _Times(timestep * begins, timestep * (begins + steps))


def _spread(first: int, last: int, most: int) -> Floats:
    """Return whole numbers from first to last, evenly spread if there are too many."""
    numbers = np.linspace(first, last, min(last - first + 1, most), dtype=np.float64)
    return np.unique(numbers.round())


def _globally(reference: Reference, plan: RunPlan, times: _Times, watch: Watch) -> Note:
    """Hold a whole run against its reference, in both ways that a sweep may ask for."""
    found = integrate_to(plan.prepared.model, plan.start, times.ends, watch=watch)
    if found is None:
        return {}
    rows, coarse = reference.rows(times.ends), reference.coarse.march
    return {
        "trajectory": _told(reference.apart(found, rows), reference.apart(coarse)),
        "invariants": _told(reference.drift(found, rows), reference.drift(coarse)),
        "impacts": found.impacts,
    }


def _locally(reference: Reference, plan: RunPlan, times: _Times, watch: Watch) -> Note:
    """Hold a run's model against its reference from many of the reference's states."""
    whole = integrate_to(plan.prepared.model, plan.start, times.ends[-1:], watch=watch)
    found, own = (
        reference.restarted(prepared, *times, watch)
        for prepared in (plan.prepared, reference.coarse.prepared)
    )
    if whole is None or found is None or own is None:
        return {}
    return {"local": _told(found, own), "impacts": whole.impacts}


def _told(error: Discrepancy, own: Discrepancy) -> dict[str, float]:
    told = {**error._asdict(), "estimate": own.peak}
    return {**told, "final_estimate": own.final, "mean_estimate": own.mean}


def _is_chaotic(reference: Reference, parting: float | None, notes: Sequence[Note]) -> bool | None:
    paths = [note["trajectory"] for note in notes if note]
    if parting is None or not paths:
        return None
    lost = parting >= _ERROR * float(np.median([path["peak"] for path in paths]))
    smooth = parting >= _ESTIMATE * paths[0]["estimate"]
    far = parting >= _EXTENT * float(reference.fine.prepared.model.stat.extent)
    return far and (lost or smooth)
