"""Joins plan, scene, sim, measure and evidence: sweeps and replays."""

from contactlab.pipeline.asking import ask_for
from contactlab.pipeline.cluster import ray_cluster
from contactlab.pipeline.environment import find_engine, run_on, without_option
from contactlab.pipeline.forecast import Forecast, forecast
from contactlab.pipeline.job import Finished
from contactlab.pipeline.rendering import Look, render
from contactlab.pipeline.replay import Replay, Start, prepare, replay
from contactlab.pipeline.stability import Case, CaseResult, find_cases, run_case
from contactlab.pipeline.stop import Stop
from contactlab.pipeline.sweep import Ask, run_sweep
from contactlab.pipeline.vocabulary import Scenes

__all__ = [
    "Ask",
    "Case",
    "CaseResult",
    "Finished",
    "Forecast",
    "Look",
    "Replay",
    "Scenes",
    "Start",
    "Stop",
    "ask_for",
    "find_cases",
    "find_engine",
    "forecast",
    "prepare",
    "ray_cluster",
    "render",
    "replay",
    "run_case",
    "run_on",
    "run_sweep",
    "without_option",
]
