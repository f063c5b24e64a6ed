"""Joins plan, scene, sim, measure and evidence: sweeps and replays."""

from contactlab.pipeline.forecast import Forecast, forecast
from contactlab.pipeline.job import Finished
from contactlab.pipeline.replay import Replay, Start, prepare, replay
from contactlab.pipeline.sweep import Ask, run_sweep
from contactlab.pipeline.vocabulary import Scenes

__all__ = [
    "Ask",
    "Finished",
    "Forecast",
    "Replay",
    "Scenes",
    "Start",
    "forecast",
    "prepare",
    "replay",
    "run_sweep",
]
