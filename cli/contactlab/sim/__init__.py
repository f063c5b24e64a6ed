"""From models to traces, natively: rollouts, their memory and their hashes."""

from contactlab.scene import quiet
from contactlab.sim.buffers import Buffers, bytes_of_run
from contactlab.sim.checks import run_checks
from contactlab.sim.geometry import body_names, moving_bodies, poses, shapes
from contactlab.sim.impulse import roll_out_by_impulse
from contactlab.sim.invariants import invariants
from contactlab.sim.loose import loose_bodies, loose_energy
from contactlab.sim.march import March, march
from contactlab.sim.pictures import Picture, pictures
from contactlab.sim.rollout import Rollout, roll_out
from contactlab.sim.speeds import pair_speeds
from contactlab.sim.stopwatch import Course, time_course, time_steps
from contactlab.sim.traces import make_trace, trajectory_hash
from contactlab.sim.viewer import view
from contactlab.sim.work import PLACES, Work, count_work

__all__ = [
    "PLACES",
    "Buffers",
    "Course",
    "March",
    "Picture",
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
    "pictures",
    "poses",
    "quiet",
    "roll_out",
    "roll_out_by_impulse",
    "run_checks",
    "shapes",
    "time_course",
    "time_steps",
    "trajectory_hash",
    "view",
]
