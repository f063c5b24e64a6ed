"""Requests to tune: the model, its limits, the time that it may take, and what must hold."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from contactlab.errors import ExpectationError, SceneError, SweepFileError
from contactlab.judge.limits import utilization
from contactlab.measure import METRICS
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.schema.study_reports import Goal, MetricChange
from contactlab.schema.tradeoff_report import REALITY
from contactlab.schema.vocabulary import RECORDED_RUN
from contactlab.studies.configuration_runs import ConfigurationRows
from contactlab.studies.effects.effect_toggles import difference
from contactlab.studies.effects.effects_request import AblationSetup, EffectsRequest

SAVERS = ("torsional_friction", "rolling_friction", "elliptic", "noslip", "impratio", "multiccd")
"""Effects that cost time and may not be needed; their absence is tried where runs exercise them."""
FREE = ("solref", *SAVERS)
BASELINE, CONTENDERS, FRESH = range(3), range(10), range(10, 20)
"""Seeds: of the model as written, of what the search finds, and of the proof."""


@dataclass(frozen=True)
class TuneRequest:
    """Which model to tune, and what of it to keep."""

    # A model file, a scene, or whatever a sweep may name as its scene; or a sweep file, whose
    # knobs of one value count as written.
    model: str
    # The fastest model within the limits, or the most accurate at no more than its price.
    goal: Goal = "fastest"
    # Largest distance from the model as written at a much finer timestep, at any time [m]; None for
    # what the model as written has itself; or `reality`, for its mean distance from a recording.
    error: float | Literal["reality"] | None = None
    budget: float = 300.0  # wall time [s]
    # Effects that may go although no run exercised them; `solref`, which may become softer.
    free: Sequence[str] = ()
    drop_sensors: bool = False  # whether sensors may go, which no metric reads
    task: TaskOptions = AS_INFERRED  # what replaces parts of the model's task

    @property
    def tolerances(self) -> Mapping[str, float]:
        """Metric to largest size."""
        return self.task.limits

    @cached_property
    def setup(self) -> AblationSetup:
        """The scene, or that of a sweep with its scenarios, and the seeds of the baseline.

        Raises a SceneError if there is no such scene, or nothing in it moves; a SweepFileError if a
        tolerance is of no metric, or the sweep has mistakes.
        """
        setup = EffectsRequest(self.model, task=replace(self.task, limits={})).setup
        if self.error == REALITY and len(recorded_runs(setup)) < _LEAST_RECORDED:
            raise SceneError(
                f"{self.model}: error {REALITY} needs a `recording` of {_LEAST_RECORDED} runs or "
                "more, since it is proven by others than the search saw"
            )
        for name in self.free:
            rest = f"; write one of {', '.join(FREE)}"
            SweepFileError.unless_known(name, FREE, f"--free: no '{name}'", rest=rest)
        for name in self.tolerances:
            SweepFileError.unless_known(name, METRICS, f"no metric '{name}'")
        return replace(setup, seeds=tuple(BASELINE))


_LEAST_RECORDED, _MOST_RECORDED = 30, 12  # recorded runs, and how many a seed stands for


def recorded_runs(setup: AblationSetup) -> Sequence[float]:
    """Return the numbers of the recorded runs of a setup's scene."""
    recorded = setup.scene.recorded
    return recorded.numbers if recorded else ()


def by_seeds(setup: AblationSetup, seeds: Sequence[int], error: object) -> AblationSetup:
    """Return a setup with seeds; compared with reality, each stands for recorded runs of its own.

    So what a proof sees, from fresh seeds, was recorded apart from what the search saw.
    """
    if error != REALITY:
        return replace(setup, seeds=tuple(seeds))
    numbers = np.random.default_rng(0).permutation(recorded_runs(setup)).tolist()
    size = min(_MOST_RECORDED, len(numbers) // _LEAST_RECORDED)
    drawn = [number for seed in seeds for number in numbers[size * seed : size * (seed + 1)]]
    every = [{**scenario, RECORDED_RUN: number} for scenario in setup.scenarios for number in drawn]
    return replace(setup, seeds=(0,), scenarios=tuple(every))


_LEAST_ERROR, _LEAST_FINAL = 1e-5, 5e-6  # errors up to these count as none [m]
_LATE = 1.5  # ratio of errors in the final state up to which both are as good
_EQUAL = 1.05  # ratio of errors up to which both are as good
_CHAOTIC = 2.0
"""Allowed divergence, as a multiple of a nudged start's, where that exceeds the tolerance."""


@dataclass(frozen=True)
class Feasibility:
    """Limits that every run of a feasible configuration keeps."""

    sizes: Mapping[str, float]  # error or metric to its largest size
    # Those that runs may have: `stable`, and what runs of the model as written have.
    labels: frozenset[str]
    divergence: float = 0.0  # how far a start 1e-8 away parts from the model as written [m]
    # Whether divergence is more than the error that is asked for, so that metrics decide too.
    chaotic: bool = False

    def excess(self, rows: ConfigurationRows) -> float:
        """Return the largest size over its limit; infinite if a run fails or was not measured."""
        if self.failed(rows):
            return math.inf
        return max(
            utilization(None if size is None else abs(size), limit)
            for _, size, limit, _ in self._sizes(rows)
        )

    def _sizes(self, rows: ConfigurationRows) -> Iterator[tuple[str, float | None, float, str]]:
        """Yield name, size, limit and run of what is limited; the mean counts of reality."""
        for name, limit in self.sizes.items():
            if name == REALITY:
                yield name, mean_of(rows, name), limit, f"over {len(rows.flat)} runs"
            else:
                for row in rows.flat:
                    yield name, row[name], limit, f"with seed {row['seed']}"

    def broken(self, rows: ConfigurationRows, now: ConfigurationRows) -> str:
        """Say why runs are not as good as those of the model as written; empty if they are."""
        if why := self.failed(rows):
            return why
        for name, size, limit, where in self._sizes(rows):
            if size is None or abs(size) > limit:
                said = "unknown" if size is None else f"{abs(size):.3g}"
                return f"{name} {said} {where}, limit {limit:.3g}"
        change = difference({}, now, rows)
        worse = replace(change, changes=tuple(filter(_is_worse, change.changes)), labels={})
        return worse.reason if self.chaotic and worse.matters else ""

    def failed(self, rows: ConfigurationRows) -> str:
        """Say which run fails as none of the model as written does; empty if none does."""
        for row in rows.flat:
            if row["label"] not in self.labels:
                return f"seed {row['seed']} is {row['label']}: {row['label_reason']}"
        return ""


def limits_of(request: TuneRequest, now: ConfigurationRows) -> Feasibility:
    """Return what configurations must keep, from what runs of the model as written do."""
    labels = frozenset({"stable", *(row["label"] for row in now.flat)})
    if request.error == REALITY:
        if (mean := mean_of(now, REALITY)) is None:
            raise ExpectationError(f"{request.model}: not every run has a distance from reality")
        return Feasibility({REALITY: _EQUAL * mean, **request.tolerances}, labels)
    for row in now.flat:
        if row["error_peak"] is None:
            raise ExpectationError(
                f"{request.model} as written ends as {row['label']} ({row['label_reason']}), so "
                f"there is nothing to compare with; contactlab check {request.model} says more"
            )

    def largest(name: str, uncertainty: str) -> float:
        # No error is known better than its reference.
        return max(max(row[name], row.get(uncertainty) or 0.0) for row in now.flat)

    own = max(_LEAST_ERROR, _EQUAL * largest("error_peak", "error_estimate"))
    error = own if request.error is None else request.error
    divergence = max(row["divergence"] or 0.0 for row in now.flat)
    chaotic = divergence > error
    sizes = {"error_peak": _CHAOTIC * divergence if chaotic else error}
    if request.error is None and not chaotic:
        late = _LATE * largest("error_final", "error_final_estimate")
        sizes["error_final"] = max(_LEAST_FINAL, late)
    return Feasibility(
        sizes={**sizes, **request.tolerances},
        labels=labels,
        divergence=divergence,
        chaotic=chaotic,
    )


def mean_of(rows: ConfigurationRows, name: str) -> float | None:
    """Return the mean of a metric over all runs; None unless every run has one."""
    values = [math.nan if row.get(name) is None else row[name] for row in rows.flat]
    mean = sum(values) / len(values)
    return None if math.isnan(mean) else mean


def _is_worse(change: MetricChange) -> bool:
    """Return whether a metric changes other than for the better."""
    better = METRICS[change.metric].better if change.metric in METRICS else ""
    sign = {"lower": -1, "higher": 1}.get(better, 0)
    return not (change.change or 0.0) * sign > 0
