"""From a planned sweep to a store: jobs, workers, records, replays."""

from contactlab.run.asking import ask_for
from contactlab.run.environment import find_engine, run_on, without_option
from contactlab.run.forecast import Forecast, forecast
from contactlab.run.job import Finished
from contactlab.run.remeasuring import timing_process
from contactlab.run.replay import Replay, Start, prepare, replay
from contactlab.run.stop import Stop
from contactlab.run.sweep import Ask, run_sweep
from contactlab.run.vocabulary import Scenes

__all__ = [
    "Ask",
    "Finished",
    "Forecast",
    "Replay",
    "Scenes",
    "Start",
    "Stop",
    "ask_for",
    "find_engine",
    "forecast",
    "prepare",
    "replay",
    "run_on",
    "run_sweep",
    "timing_process",
    "without_option",
]
