"""Joins plan, scene, sim, measure and evidence: sweeps and replays."""

from contactlab.pipeline.asking import ask_for
from contactlab.pipeline.forecast import Forecast, forecast
from contactlab.pipeline.job import Finished
from contactlab.pipeline.replay import Replay, Start, prepare, replay
from contactlab.pipeline.stability import Case, CaseResult, find_cases, missing_switches, run_case
from contactlab.pipeline.sweep import Ask, run_sweep
from contactlab.pipeline.vocabulary import Scenes

__all__ = [
    "Ask",
    "Case",
    "CaseResult",
    "Finished",
    "Forecast",
    "Replay",
    "Scenes",
    "Start",
    "ask_for",
    "find_cases",
    "forecast",
    "missing_switches",
    "prepare",
    "replay",
    "run_case",
    "run_sweep",
]
