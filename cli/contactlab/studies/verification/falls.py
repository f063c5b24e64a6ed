"""Repeats a measure over falls from slightly different starts, since one fall says little of it.

How deep a body hits, or how far a joint passes its limit, depends on the edge that hits and the
moment within a step; in a pile, so does whether a body rests. Another step, or another way to move,
has another fall by chance, so its mean over falls is compared with the original's.
"""

import math
from dataclasses import replace

import mujoco
import numpy as np

from contactlab.budget.motion import Motion
from contactlab.budget.windows import body_name, judged_bodies
from contactlab.schema.verification import VerifiedMeasure
from contactlab.studies.verification.run_measures import (
    CHANCE,
    CREEP_SIZE,
    CREEP_TOLERANCE,
    RELATIVE_TOLERANCE,
    RESTING_SPEED,
    STANDARD_ERRORS,
    measure_end_speeds,
)
from contactlab.studies.verification.runs import PairedRun, velocity_slice
from contactlab.studies.verification.state_tables import (
    EXTREME_UNITS,
    StateTable,
)

FALLS = 16
"""With a spread of 5 % of a peak, as hopper's falls have, the difference of two means over 16 falls
has a standard error of 1.8 %."""
START_NOISE = 5e-3
"""rad/s or m/s, largest change of a start's velocities: as gymnasium's resets of a hopper."""
_STATES_OF_A_FALL = 500  # as many as each of three seeds has in a run


def repeat_measure(
    run: PairedRun, measure: VerifiedMeasure, workers: int, known_tables: dict[str, StateTable]
) -> VerifiedMeasure:
    """Return a measure as its mean over falls, with their spread as part of its tolerance.

    Args:
        run: the experiment. One fall of the changed model is worse there.
        measure: a depth, a gap or an excess over a limit; or the creep of a body.
        workers: threads that simulate.
        known_tables: tables of the original's falls by the name of the run; a missing one is added.
    """
    if run.name not in known_tables:
        known_tables[run.name] = _tabulate_falls(run.original, workers, run.original.model)
    tables = known_tables[run.name], _tabulate_falls(run.changed, workers, run.original.model)
    good = ~(tables[0].failures | tables[1].failures)
    if not good.any():
        return measure
    if measure.name in EXTREME_UNITS:
        # A peak is the mean over falls; its spread is that of a difference of means.
        before, after = (table.extremes[measure.name].values[good] for table in tables)
        error = math.sqrt((np.var(before) + np.var(after)) / max(1, good.sum() - 1))
        mean, other, spread = float(before.mean()), float(after.mean()), STANDARD_ERRORS * error
        tolerance = max(spread, measure.tolerance)
        return measure.model_copy(
            update={
                "before": mean,
                "after": other,
                "spread": spread,
                "tolerance": tolerance,
                "place": tables[1].extremes[measure.name].place,
                "worse": not other <= mean + tolerance,
            }
        )
    return _average_creep(measure, tables, good, run.original.model)


def _average_creep(
    measure: VerifiedMeasure,
    tables: tuple[StateTable, StateTable],
    good: np.ndarray,
    model: mujoco.MjModel,
) -> VerifiedMeasure:
    # The creep of each body, which is at most that of a body that rests. The worst body counts, so
    # chance is shared by all.
    from scipy.special import stdtrit  # noqa: PLC0415 - it takes a while to load

    bodies, falls, scale = judged_bodies(model), int(good.sum()), float(model.stat.meansize)
    most = RESTING_SPEED * scale / CREEP_SIZE
    own, other = (np.minimum(measure_end_speeds(table)[good][:, bodies], most) for table in tables)
    befores, afters = own.mean(axis=0), other.mean(axis=0)
    floors = np.maximum(CREEP_TOLERANCE * scale / CREEP_SIZE, RELATIVE_TOLERANCE * befores)
    # Both models have the same starts, so a difference in all falls is not chance.
    deviations = np.std(other - own, axis=0) / math.sqrt(max(1, falls - 1))
    spreads = float(stdtrit(max(1, falls - 1), 1 - CHANCE / len(bodies))) * deviations
    tolerances = np.maximum(floors, spreads)
    worst = int(np.argmax(afters - befores - tolerances))
    before, after, tolerance = (float(each[worst]) for each in (befores, afters, tolerances))
    return measure.model_copy(
        update={
            "before": before,
            "after": after,
            "spread": float(spreads[worst]),
            "tolerance": tolerance,
            "place": body_name(model, int(bodies[worst])),
            "worse": not after <= before + tolerance,
        }
    )


def _tabulate_falls(motion: Motion, workers: int, demands: mujoco.MjModel) -> StateTable:
    model, falls = motion.model, max(FALLS, motion.seeds)
    rows = np.arange(falls) % motion.seeds
    starts = motion.starts[rows]
    noise = np.random.default_rng(FALLS).uniform(-START_NOISE, START_NOISE, (falls, model.nv))
    starts[:, velocity_slice(model)] += noise
    repeated = replace(motion, starts=starts, inputs=motion.inputs[rows])
    ends = np.linspace(0.0, motion.steps * float(model.opt.timestep), 6)
    states = falls * _STATES_OF_A_FALL
    return StateTable(repeated, workers, ends, contact_states=states, demands=demands)
