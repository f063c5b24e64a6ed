"""Runs of configurations, and whether they are as good as the model as written."""

import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import fmean

from contactlab.errors import StoppedError
from contactlab.run.evidence_record import as_written
from contactlab.scene.scene_source import SceneSource
from contactlab.schema.effects_report import Ratio
from contactlab.schema.tune_report import Candidate, Standing
from contactlab.studies.configuration_runs import ConfigurationRows, run_configurations
from contactlab.studies.effects.effects_request import AblationSetup
from contactlab.studies.effects.metric_changes import cost_ratio
from contactlab.studies.session import Session, Values

ACCURACY: Mapping[str, object] = {"error": "trajectory", "against": "written", "refine": 4}
"""By RK4 at an eighth and a quarter of the model's timestep: as much work as 64 of its steps."""
_PRUNING = {**ACCURACY, "refine": 2}
_TIMING = {"rounds": 3}
_NO_ROWS = ConfigurationRows((), ())
_ERRORS = ("error_final", "error_mean", "error_peak", "error_velocity", "error_energy")


class OutOfTimeError(StoppedError):
    """What comes next would take longer than the budget."""


@dataclass(frozen=True)
class Limits:
    """What every run of a feasible configuration keeps.

    Attributes:
        sizes: error or metric to its largest size.
        labels: those that runs may have: `stable`, and what runs of the model as written have.
        divergence: how far a start 1e-8 away parts from the model as written [m].
        chaotic: whether that is more than the error that is asked for, so that metrics decide too.
    """

    sizes: Mapping[str, float]
    labels: frozenset[str]
    divergence: float = 0.0
    chaotic: bool = False

    def excess(self, rows: ConfigurationRows) -> float:
        """Return the largest size over its limit; infinite if a run fails or was not measured."""
        if self.failed(rows):
            return math.inf
        sizes = [(row[name], limit) for row in rows.flat for name, limit in self.sizes.items()]
        return max(
            math.inf if size is None else abs(size) / limit if limit else math.inf * bool(size)
            for size, limit in sizes
        )

    def broken(self, rows: ConfigurationRows) -> str:
        """Say what a configuration exceeds most; empty if it is feasible."""
        if why := self.failed(rows):
            return why
        for row in rows.flat:
            for name, limit in self.sizes.items():
                if row[name] is None or abs(row[name]) > limit:
                    size = "unknown" if row[name] is None else f"{abs(row[name]):.3g}"
                    return f"{name} is {size} with seed {row['seed']} (limit {limit:.3g})"
        return ""

    def failed(self, rows: ConfigurationRows) -> str:
        """Say which run fails as none of the model as written does; empty if none does."""
        for row in rows.flat:
            if row["label"] not in self.labels:
                return f"seed {row['seed']} is {row['label']}: {row['label_reason']}"
        return ""


@dataclass
class Trials:
    """Runs the configurations of one study; those of the search as long as its budget lasts.

    Attributes:
        deadline: by `time.monotonic` [s].
        judged: how many configurations were judged.
        runs: how many runs the stores have.
    """

    setup: AblationSetup
    session: Session
    deadline: float
    limits: Limits = field(default_factory=lambda: Limits({}, frozenset()))
    judged: int = 0
    runs: int = 0
    stores: list[str] = field(default_factory=list[str])
    _longest: float = 0.0

    def run(
        self, name: str, configurations: Sequence[Values], seeds: Sequence[int], **asked: object
    ) -> list[ConfigurationRows]:
        """Run configurations from some seeds into a store."""
        setup = replace(self.setup, seeds=tuple(seeds))
        content = {"trace": "none", **asked}
        found = run_configurations(self.session, setup, name, configurations, content)
        self.stores.append(name)
        self.runs += sum(len(each.flat) for each in found)
        return found

    def compared(
        self, name: str, configurations: Sequence[Values], seeds: Sequence[int]
    ) -> list[ConfigurationRows]:
        """Run configurations, and compare them with the model as written."""
        return self.run(name, configurations, seeds, accuracy=dict(ACCURACY))

    def timed(
        self, name: str, configurations: Sequence[Values], seeds: Sequence[int]
    ) -> list[ConfigurationRows]:
        """Run configurations, and time them in turns."""
        return self.run(name, configurations, seeds, timing=_TIMING)

    def run_file(self, name: str, source: SceneSource, seeds: Sequence[int]) -> ConfigurationRows:
        """Run a written model as it is into a store, and return its rows."""
        reference = f"{source.path.parent}/" if source.manifest else str(source.path)
        written = replace(self, setup=replace(self.setup, reference=reference, base={}))
        (found,) = written.run(name, [{}], seeds)
        self.runs = written.runs
        return found

    def judge(self, configurations: Sequence[Values]) -> list[float]:
        """Return the excess of configurations, from one seed.

        Raises:
            OutOfTimeError: there is no time for it.
        """
        self.judged += len(configurations)
        name = f"search-{len(self.stores):02}"
        rows = self._in_time(name, configurations, accuracy=_PRUNING)
        return [self.limits.excess(each) for each in rows]

    def clock(self, configurations: Sequence[Values]) -> list[float]:
        """Return the time of configurations [CPU s per simulated s], from one seed."""
        name = f"times-{len(self.stores):02}"
        rows = self._in_time(name, configurations, timing=_TIMING)
        return [fmean(times_of(each)) for each in rows]

    def _in_time(
        self, name: str, configurations: Sequence[Values], **asked: object
    ) -> list[ConfigurationRows]:
        begin = time.monotonic()
        if begin + self._longest > self.deadline:
            raise OutOfTimeError("the budget is spent")
        rows = self.run(name, configurations, self.setup.seeds[:1], **asked)
        self._longest = max(self._longest, time.monotonic() - begin)
        return rows


@dataclass(frozen=True)
class Contender:
    """A configuration, by what it changes in the model as written, and its runs.

    Attributes:
        rows: runs that were compared with the model as written.
        timed: runs that were timed in turns with it; empty if there are none.
    """

    changed: Values
    rows: ConfigurationRows
    timed: ConfigurationRows = _NO_ROWS

    def cost(self, now: "Contender") -> Ratio | None:
        """Return the time over that of the model as written."""
        return cost_ratio(now.timed, self.timed)

    def reported(self, standing: Standing, now: "Contender", limits: Limits) -> Candidate:
        """Return what a report says of it, beside the model as written."""
        times, excess = times_of(self.timed), limits.excess(self.rows)
        return Candidate(
            standing=standing,
            settings={name: as_written(value) for name, value in self.changed.items()},
            **{name: _largest(self.rows, name) for name in _ERRORS},
            labels=dict(Counter(row["label"] for row in self.rows.flat)),
            time=fmean(times) if times else None,
            cost=self.cost(now),
            excess=excess if math.isfinite(excess) else None,
        )


def _largest(rows: ConfigurationRows, name: str) -> float | None:
    sizes = [math.nan if row.get(name) is None else abs(row[name]) for row in rows.flat]
    return None if math.isnan(sum(sizes)) else max(sizes)


def times_of(rows: ConfigurationRows) -> list[float]:
    """Return the times of those that were timed [CPU s per simulated s]."""
    return [row["time_min"] for row in rows.flat if row.get("time_min") is not None]
