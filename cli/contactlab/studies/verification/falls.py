"""Repeats a peak over falls from slightly different starts, since one fall says little of it.

How deep a body hits, or how far a joint passes its limit, depends on the edge that hits and the
moment within a step. Another step, or another way to move, has another fall by chance, so its mean
over falls is compared with the original's.
"""

import math
from dataclasses import replace

import mujoco
import numpy as np

from contactlab.budget.motion import Motion
from contactlab.schema.verification import VerifiedMeasure
from contactlab.studies.verification.run_measures import STANDARD_ERRORS
from contactlab.studies.verification.runs import PairedRun, velocity_slice
from contactlab.studies.verification.state_tables import StateTable, tabulate_states

FALLS = 16
"""With a spread of 5 % of a peak, as hopper's falls have, the difference of two means over 16 falls
has a standard error of 1.8 %."""
START_NOISE = 5e-3
"""rad/s or m/s, largest change of a start's velocities: as gymnasium's resets of a hopper."""
_STATES_OF_A_FALL = 500  # as many as each of three seeds has in a run


def repeat_peak(
    run: PairedRun, peak: VerifiedMeasure, workers: int, known: dict[str, StateTable]
) -> VerifiedMeasure:
    """Return a peak as its mean over falls, with their spread as part of its tolerance.

    Args:
        run: the experiment. One fall of the changed model has a larger peak there.
        peak: its measure: a depth, a gap or an excess over a limit.
        workers: threads that simulate.
        known: tables of the original's falls by the name of the run; a missing one is added.
    """
    if run.name not in known:
        known[run.name] = _tabulate_falls(run.original, workers, run.original.model)
    tables = known[run.name], _tabulate_falls(run.changed, workers, run.original.model)
    good = ~(tables[0].failed | tables[1].failed)
    if not good.any():
        return peak
    before, after = (table.extremes[peak.name].values[good] for table in tables)
    error = math.sqrt((np.var(before) + np.var(after)) / max(1, good.sum() - 1))
    mean, other, spread = float(before.mean()), float(after.mean()), STANDARD_ERRORS * error
    tolerance = max(spread, peak.tolerance)
    return peak.model_copy(
        update={
            "before": mean,
            "after": other,
            "spread": spread,
            "tolerance": tolerance,
            "place": tables[1].extremes[peak.name].place,
            "worse": not other <= mean + tolerance,
        }
    )


def _tabulate_falls(motion: Motion, workers: int, demands: mujoco.MjModel) -> StateTable:
    model, falls = motion.model, max(FALLS, motion.seeds)
    rows = np.arange(falls) % motion.seeds
    starts = motion.starts[rows]
    noise = np.random.default_rng(FALLS).uniform(-START_NOISE, START_NOISE, (falls, model.nv))
    starts[:, velocity_slice(model)] += noise
    repeated = replace(motion, starts=starts, inputs=motion.inputs[rows])
    ends = np.array([motion.steps * float(model.opt.timestep)])
    states = falls * _STATES_OF_A_FALL
    return tabulate_states(repeated, workers, ends, contact_states=states, demands=demands)
