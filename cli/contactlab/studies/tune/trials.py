"""Runs of configurations, what they cost, and whether they are as good as the model as written."""

import json
import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from statistics import median

import mujoco

from contactlab.engines import engine_of
from contactlab.engines.engine import SEGMENTS, Segments, TimesSteps
from contactlab.engines.single_run import time_segments
from contactlab.errors import StoppedError
from contactlab.schema.study_reports import Candidate, Ratio, Standing
from contactlab.schema.tradeoff_report import REALITY
from contactlab.store.table_layout import as_written
from contactlab.studies.configuration_runs import ConfigurationRows, Measure, run_configurations
from contactlab.studies.effects.effects_request import AblationSetup
from contactlab.studies.session import Session, Values
from contactlab.studies.tune.profile import costs_without
from contactlab.studies.tune.tune_request import BASELINE, Feasibility, by_seeds, mean_of

PRUNING, PROVING = 2, 4
"""By how much references refine the timestep: by RK4 twice, as much work as 16 times as many steps.
"""
_TIMES = "times.json"
_ROUNDS, _MOST_ROUNDS, _TURN = 9, 99, 0.4
"""How often all that is timed takes turns, more often where turns are shorter than they may be, and
the CPU time of the model as written in one [s]."""
SHORT_TURN = 0.02  # where it is only to be found out what helps
_PROBE = 0.02  # simulated time of each part that is gone through first, to see how long it takes
_ERRORS = ("error_final", "error_mean", "error_peak", "error_velocity", "error_energy")
_NOTHING: Measure = lambda _store, _run, _model: {}  # noqa: E731


class OutOfTimeError(StoppedError):
    """The next step would take longer than the budget."""


@dataclass
class Trials:
    """Runs the configurations of one study; those of the search as long as its budget lasts."""

    setup: AblationSetup
    session: Session
    deadline: float  # by `time.monotonic` [s]
    limits: Feasibility = field(default_factory=lambda: Feasibility({}, frozenset()))
    runs: int = 0  # how many runs the stores have
    stores: list[str] = field(default_factory=list[str])
    error: object = None  # the request's
    pace: float | None = None  # of the model as written [CPU s per simulated s], once it is timed
    _longest: float = 0.0

    def run(
        self,
        name: str,
        configurations: Sequence[Values],
        seeds: Sequence[int],
        *,
        setup: AblationSetup | None = None,
        refine: int = 0,
        measure: Measure = _NOTHING,
        **asked: object,
    ) -> list[ConfigurationRows]:
        """Run configurations, of a written model if its setup is given, into a store.

        Where references refine the timestep, errors against the model as written are measured.
        """
        setup = by_seeds(setup or self.setup, seeds, self.error)
        asked = {"trace": "none", **asked}
        if refine and self.error != REALITY:
            asked["accuracy"] = self.accuracy(refine)
        found = run_configurations(self.session, setup, name, configurations, asked, measure)
        self.stores.append(name)
        self.runs += sum(len(configuration.flat) for configuration in found)
        return found

    def accuracy(self, refine: int) -> dict[str, object]:
        """Return what a sweep says of errors against the model as written."""
        scenario = self.setup.scenario
        return {"error": "trajectory", "against": "written", "refine": refine, "scenario": scenario}

    def judge(self, configurations: Sequence[Values]) -> list[float]:
        """Return the excess of configurations; an OutOfTimeError without time.

        From one seed, but from all if compared with reality, whose mean takes many runs.
        """
        begin = time.monotonic()
        if begin + self._longest > self.deadline:
            raise OutOfTimeError("the budget is spent")
        name = f"search-{len(self.stores):02}"
        seeds = BASELINE if self.error == REALITY else BASELINE[:1]
        rows = self.run(name, configurations, seeds, refine=PRUNING)
        self._longest = max(self._longest, time.monotonic() - begin)
        return [self.limits.excess(row) for row in rows]

    def costs(
        self,
        configurations: Sequence[tuple[AblationSetup, Values]],
        seeds: Sequence[int] = BASELINE,
        turn: float = _TURN,
    ) -> list[Ratio]:
        """Return the time of configurations over that of the model as written, taken in turns.

        Each of a setup, through its own runs or, where these do not fit into a turn [s], parts of
        them that begin at eight times of each; of those that fail, it is infinite.
        """
        every: list[tuple[AblationSetup, Values]] = [(self.setup, {}), *configurations]
        what = [[setup.scene.hash, changed] for setup, changed in every], list(seeds), turn
        taken = self.once(what, lambda: self._turns(every, seeds, turn))
        self.pace = median(times[0] for times in taken)
        ratios = zip(
            *([seconds / first for seconds in rest] for first, *rest in taken), strict=True
        )
        return [Ratio.of(ratio) for ratio in ratios]

    def once(self, what: object, measure: Callable[[], list[list[float]]]) -> list[list[float]]:
        """Return times that are measured once, so that a study which is resumed goes the same way.

        They are in a file of the session, by what is timed, of which model, run how.
        """
        setup = self.setup
        run = setup.scene.hash, setup.scenes.drive, setup.duration, setup.base, setup.scenarios
        key = json.dumps([mujoco.__version__, *run, what], default=str)
        known = self.session.read(_TIMES, dict[str, list[list[float]]])
        if key not in known:
            known[key] = measure()
            self.session.write({_TIMES: json.dumps(known, indent=1) + "\n"})
        return known[key]

    def _turns(
        self, every: Sequence[tuple[AblationSetup, Values]], seeds: Sequence[int], turn: float
    ) -> list[list[float]]:
        """Return the CPU time by simulated time of each configuration, in each round."""
        runs = [_segments(setup, changed, seeds) for setup, changed in every]
        fits = turn / max(_pace(runs[0], _PROBE), 1e-9) / len(runs[0])
        longest = max(run.work.steps * run.model.opt.timestep for run in runs[0])
        # Where a part begins takes a few microseconds of its own.
        if whole := fits >= longest:
            runs = [list(map(_from_start, run)) for run in runs]
        span = fits if whole else fits / SEGMENTS
        rounds = min(max(_ROUNDS, round(_ROUNDS * fits / longest)), _MOST_ROUNDS)
        return [[_pace(run, span) for run in runs] for _ in range(rounds)]

    def profile(self) -> dict[str, Ratio]:
        """Return the time of a step of the model as written without one part each."""
        return costs_without(_segments(self.setup, {}, BASELINE), time_segments)


def _segments(setup: AblationSetup, changed: Values, seeds: Sequence[int]) -> list[Segments]:
    """Return parts of a configuration's runs to time; none if one fails."""
    found: list[Segments] = []
    scene = setup.scene
    for scenario in setup.scenarios:
        values = {**setup.base, **scenario, **changed}
        runs = [scene.resolve(values, seed, setup.duration) for seed in seeds]
        compiled = scene.compile_without_sensors(runs[0])
        for run in runs:
            start, engine = scene.starts([run]), engine_of(run)
            assert isinstance(engine, TimesSteps)
            model = scene.prepare(run, start, compiled).model
            if (work := engine.count_work(model, start, run.steps)) is None:
                return []
            found.append(Segments(model, start, work))
    return found


def _from_start(run: Segments) -> Segments:
    """Return a run in one part."""
    work = run.work
    return replace(run, work=work._replace(places=work.places[:1], states=work.states[:1]))


def _pace(runs: Sequence[Segments], span: float) -> float:
    """Return the CPU time of what follows each part's begin for a span [s], by simulated time."""
    seconds = simulated = 0.0
    for run in runs:
        step = run.model.opt.timestep
        taken, steps = time_segments(run, max(1, round(span / step)), 1)
        seconds, simulated = seconds + taken, simulated + steps * step
    return seconds / simulated if runs else math.inf


@dataclass(frozen=True)
class Contender:
    """A configuration, by what it changes in the model as written, its runs, and what it costs."""

    changed: Values
    rows: ConfigurationRows
    cost: Ratio | None = None

    def reported(self, standing: Standing, trials: Trials) -> Candidate:
        """Return what a report says of it."""
        excess = trials.limits.excess(self.rows)
        return Candidate(
            standing=standing,
            settings={name: as_written(value) for name, value in self.changed.items()},
            **{name: _largest(self.rows, name) for name in _ERRORS},
            reality=mean_of(self.rows, REALITY),
            labels=dict(Counter(row["label"] for row in self.rows.flat)),
            time=trials.pace and trials.pace * (self.cost.ratio if self.cost else 1.0),
            cost=self.cost,
            excess=excess if math.isfinite(excess) else None,
        )


def _largest(rows: ConfigurationRows, name: str) -> float | None:
    sizes = [math.nan if row.get(name) is None else abs(row[name]) for row in rows.flat]
    return None if math.isnan(sum(sizes)) else max(sizes)
