"""From a planned sweep to a store: jobs, workers, records, replays."""

from contactlab.run.forecast import Forecast, forecast
from contactlab.run.mujoco_environment import exec_with, find_interpreter, without_option
from contactlab.run.ray_connection import ray_cluster
from contactlab.run.stored_runs import (
    PreparedReplay,
    ReplayResult,
    prepare_replay,
    replay,
    timing_process,
)
from contactlab.run.sweep_request import SceneLoader, SweepRequest, read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.run.tasks import Finished, Stop
from contactlab.run.worker_pool import worker_count

__all__ = [
    "Finished",
    "Forecast",
    "PreparedReplay",
    "ReplayResult",
    "SceneLoader",
    "Stop",
    "SweepRequest",
    "exec_with",
    "find_interpreter",
    "forecast",
    "prepare_replay",
    "ray_cluster",
    "read_request",
    "replay",
    "run_sweep",
    "timing_process",
    "without_option",
    "worker_count",
]
