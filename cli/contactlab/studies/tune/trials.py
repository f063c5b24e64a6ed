"""Runs of configurations, what they cost, and whether they are as good as the model as written."""

import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import median

from contactlab.engines import engine_of
from contactlab.engines.engine import Segments, TimesSteps
from contactlab.engines.single_run import time_segments
from contactlab.errors import StoppedError
from contactlab.run.evidence_record import as_written
from contactlab.scene.model_writer import WrittenModel
from contactlab.scene.scene import Scene
from contactlab.schema.study_reports import Candidate, Ratio, Standing
from contactlab.studies.configuration_runs import ConfigurationRows, Measure, run_configurations
from contactlab.studies.effects.effects_request import AblationSetup
from contactlab.studies.session import Session, Values
from contactlab.studies.tune.profile import costs_without
from contactlab.studies.tune.tune_request import BASELINE, Limits

ACCURACY: Mapping[str, object] = {"error": "trajectory", "against": "written", "refine": 4}
"""By RK4 at an eighth and a quarter of the model's timestep: as much work as 64 of its steps."""
PRUNING = {**ACCURACY, "refine": 2}
_STEPS, _ROUNDS = 32, 9
"""Steps that are timed at each of eight places of a run, and how often all take turns."""
_LEAST_SECONDS, _MOST_REPEATS = 5e-3, 50
"""CPU time of a turn at least [s], for which its steps are repeated."""
_ERRORS = ("error_final", "error_mean", "error_peak", "error_velocity", "error_energy")
_NOTHING: Measure = lambda _store, _run, _model: {}  # noqa: E731


class OutOfTimeError(StoppedError):
    """What comes next would take longer than the budget."""


@dataclass
class Trials:
    """Runs the configurations of one study; those of the search as long as its budget lasts."""

    setup: AblationSetup
    session: Session
    deadline: float  # by `time.monotonic` [s]
    limits: Limits = field(default_factory=lambda: Limits({}, frozenset()))
    runs: int = 0  # how many runs the stores have
    stores: list[str] = field(default_factory=list[str])
    pace: float = math.nan  # of the model as written [CPU s per simulated s]
    _longest: float = 0.0

    def run(
        self,
        name: str,
        configurations: Sequence[Values],
        seeds: Sequence[int],
        *,
        measure: Measure = _NOTHING,
        **asked: object,
    ) -> list[ConfigurationRows]:
        """Run configurations from some seeds into a store."""
        setup, asked = replace(self.setup, seeds=tuple(seeds)), {"trace": "none", **asked}
        found = run_configurations(self.session, setup, name, configurations, asked, measure)
        self.stores.append(name)
        self.runs += sum(len(each.flat) for each in found)
        return found

    def run_file(self, name: str, model: WrittenModel, seeds: Sequence[int]) -> ConfigurationRows:
        """Run a written model as it is into a store, and return its rows."""
        written = replace(self, setup=self.setup.written(model.reference, self.setup.base))
        (found,) = written.run(name, [{}], seeds)
        self.runs = written.runs
        return found

    def scene_of(self, model: WrittenModel) -> Scene:
        """Return the scene of a written model, driven as the others."""
        return self.setup.written(model.reference, self.setup.base).scene

    def judge(self, configurations: Sequence[Values]) -> list[float]:
        """Return the excess of configurations, from one seed; an OutOfTimeError without time."""
        begin = time.monotonic()
        if begin + self._longest > self.deadline:
            raise OutOfTimeError("the budget is spent")
        name = f"search-{len(self.stores):02}"
        rows = self.run(name, configurations, BASELINE[:1], accuracy=PRUNING)
        self._longest = max(self._longest, time.monotonic() - begin)
        return [self.limits.excess(each) for each in rows]

    def costs(
        self, configurations: Sequence[tuple[Scene, Values]], seeds: Sequence[int] = BASELINE
    ) -> list[Ratio]:
        """Return the time of configurations over that of the model as written, taken in turns.

        Each of a scene, from states along its own runs; of those that fail, it is infinite.
        """
        every: list[tuple[Scene, Values]] = [(self.setup.scene, {}), *configurations]
        runs = [_segments(scene, changed, seeds) for scene, changed in every]
        steps = sum(sum(each.lengths(_STEPS)) for each in runs[0])
        once = max(_seconds(runs[0], 1) * steps * runs[0][0].model.opt.timestep, 1e-7)
        repeats = min(_MOST_REPEATS, math.ceil(_LEAST_SECONDS / once))
        taken = [[_seconds(each, repeats) for each in runs] for _ in range(_ROUNDS)]
        self.pace = median(each[0] for each in taken)
        ratios = zip(*([each / first for each in rest] for first, *rest in taken), strict=True)
        return [Ratio.of(each) for each in ratios]

    def profile(self) -> dict[str, Ratio]:
        """Return the time of a step of the model as written without one part each."""
        return costs_without(_segments(self.setup.scene, {}, BASELINE), time_segments, {})


def _segments(scene: Scene, changed: Values, seeds: Sequence[int]) -> list[Segments]:
    """Return parts of a configuration's runs to time; none if one fails."""
    found: list[Segments] = []
    compiled = scene.compile_without_sensors(scene.resolve(changed, 0, None))
    for seed in seeds:
        run = scene.resolve(changed, seed, None)
        start, engine = scene.starts([run]), engine_of(run)
        assert isinstance(engine, TimesSteps)
        model = scene.prepare(run, start, compiled).model
        if (work := engine.count_work(model, start, run.steps)) is None:
            return []
        found.append(Segments(model, start, work))
    return found


def _seconds(runs: Sequence[Segments], repeats: int) -> float:
    """Return the CPU time of some steps of each part over the time that they simulate."""
    times = [(*time_segments(each, _STEPS, repeats), each.model.opt.timestep) for each in runs]
    simulated = sum(steps * step for _, steps, step in times)
    return sum(seconds for seconds, _, _ in times) / simulated if times else math.inf


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
            labels=dict(Counter(row["label"] for row in self.rows.flat)),
            time=trials.pace * (self.cost.ratio if self.cost else 1.0),
            cost=self.cost,
            excess=excess if math.isfinite(excess) else None,
        )


def _largest(rows: ConfigurationRows, name: str) -> float | None:
    sizes = [math.nan if row.get(name) is None else abs(row[name]) for row in rows.flat]
    return None if math.isnan(sum(sizes)) else max(sizes)
