"""From models to traces, natively: rollouts, their memory and their hashes."""

from contactlab.scene import quiet
from contactlab.sim.buffers import Buffers, bytes_of_run
from contactlab.sim.checks import run_checks
from contactlab.sim.impulse import roll_out_by_impulse
from contactlab.sim.rollout import Rollout, roll_out
from contactlab.sim.traces import make_trace, trajectory_hash
from contactlab.sim.viewer import view

__all__ = [
    "Buffers",
    "Rollout",
    "bytes_of_run",
    "make_trace",
    "quiet",
    "roll_out",
    "roll_out_by_impulse",
    "run_checks",
    "trajectory_hash",
    "view",
]
