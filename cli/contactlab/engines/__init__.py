"""Engines: from compiled models and start states to recorded trajectories."""

from contactlab.engines.buffers import Buffers, bytes_of_run
from contactlab.engines.checks import run_checks
from contactlab.engines.geometry import body_names, moving_bodies, poses, shapes
from contactlab.engines.impulse import roll_out_by_impulse
from contactlab.engines.invariants import invariants
from contactlab.engines.loose import loose_bodies, loose_energy
from contactlab.engines.march import March, march
from contactlab.engines.rollout import Rollout, roll_out
from contactlab.engines.speeds import pair_speeds
from contactlab.engines.stopwatch import Course, time_course, time_steps
from contactlab.engines.traces import make_trace, trajectory_hash
from contactlab.engines.work import PLACES, Work, count_work

__all__ = [
    "PLACES",
    "Buffers",
    "Course",
    "March",
    "Rollout",
    "Work",
    "body_names",
    "bytes_of_run",
    "count_work",
    "invariants",
    "loose_bodies",
    "loose_energy",
    "make_trace",
    "march",
    "moving_bodies",
    "pair_speeds",
    "poses",
    "roll_out",
    "roll_out_by_impulse",
    "run_checks",
    "shapes",
    "time_course",
    "time_steps",
    "trajectory_hash",
]
