"""The times and the work of runs, as the table has them."""

import hashlib
import json
from collections.abc import Mapping

from contactlab.engines import SEGMENTS
from contactlab.run.jobs import Planned
from contactlab.run.notes import Note
from contactlab.run.stopwatch import LEAST, MOST, SINGLE
from contactlab.schema import Timing

_NOTHING: Note = {}
_CLOCKED = ("time_min", "time_median", "step_p50", "step_p99", "compile_time")
_COUNTED = ("steps", "iterations", "contacts", "rows")


def timings(
    planned: Planned, rounds: int, work: Mapping[str, Note], times: Mapping[str, Note]
) -> dict[str, Timing]:
    """Return the times and work of every run; nothing of those that did not go through.

    Args:
        planned: the runs.
        rounds: how often each was timed.
        work: run id to what was counted of it.
        times: run id to its times.
    """
    settings = _settings_hash(rounds)
    found: dict[str, Timing] = {}
    for run, resolved in planned:
        counted = work.get(run.run_id) or _NOTHING
        known = times.get(run.run_id) or _NOTHING
        simulated = resolved.steps * resolved.timestep
        rates = {
            f"work_{name}": counted[name] / simulated if counted else None for name in _COUNTED
        }
        clocked = {name: known.get(name) for name in _CLOCKED}
        found[run.run_id] = Timing(**clocked, **rates, timing_settings=settings)
    return found


def _settings_hash(rounds: int) -> str:
    settings = {
        "version": 1,
        "clock": "CPU time of one thread",
        "model": "as written, without sensors that record",
        "rounds": rounds,
        "seconds": [LEAST, MOST, SINGLE],
        "places": SEGMENTS,
    }
    return hashlib.sha256(json.dumps(settings).encode()).hexdigest()[:16]
