"""Engines: from compiled models and start states to recorded trajectories."""

from contactlab.engines.impulse import roll_out_by_impulse
from contactlab.engines.integration import SampledStates, integrate_to
from contactlab.engines.rollout import Buffers, Rollout, bytes_of_run, roll_out
from contactlab.engines.self_checks import run_checks
from contactlab.engines.step_timing import (
    SEGMENTS,
    Segments,
    Work,
    count_work,
    time_segments,
    time_steps,
)
from contactlab.engines.traces import make_trace, trajectory_hash

__all__ = [
    "SEGMENTS",
    "Buffers",
    "Rollout",
    "SampledStates",
    "Segments",
    "Work",
    "bytes_of_run",
    "count_work",
    "integrate_to",
    "make_trace",
    "roll_out",
    "roll_out_by_impulse",
    "run_checks",
    "time_segments",
    "time_steps",
    "trajectory_hash",
]
