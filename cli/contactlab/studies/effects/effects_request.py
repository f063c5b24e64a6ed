"""The request of an ablation: a base configuration, scenarios, seeds and tolerances."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from contactlab.errors import SceneError
from contactlab.mjcf import OPTIONS
from contactlab.plan.grid import Plan
from contactlab.plan.sweep_file import read_sweep
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.scene import Scene
from contactlab.schema.task import Task
from contactlab.schema.tradeoff_report import REALITY
from contactlab.schema.vocabulary import RECORDED_RUN
from contactlab.tasks.session import Values, read_settings

_SWEEPS = {".yaml", ".yml"}


@dataclass(frozen=True)
class EffectsRequest:
    """The scene whose effects are changed, and the base configuration."""

    # a sweep file, or a scene, a model file or any other scene of a sweep
    source: str
    assign: Sequence[str] = ()  # settings of the base configuration, `NAME=VALUE` each
    seeds: int = 6  # seeds per effect
    rounds: int | None = 3  # rounds of the timing pass; None for no timing
    # options that replace parts of the task; its limits are tolerances, by metric
    task: TaskOptions = AS_INFERRED
    # `reality`: find the effects that bring runs closer to recorded runs; each of these counts as a
    # seed
    metric: Literal["reality"] | None = None

    @cached_property
    def setup(self) -> "AblationSetup":
        """The scene and its base configuration, read once.

        From a sweep, axes of the role scenario are used, and knobs with one value; other knobs stay
        as in the scene, unless `assign` sets them. Raises a SweepFileError if the sweep or a
        setting is wrong (all are named); a SceneError if there is no such scene.
        """
        path = Path(self.source)
        is_sweep = path.suffix in _SWEEPS
        folder = path.parent if is_sweep else Path()
        scenes = SceneLoader(folder, self.task.drive)
        sweep_of_scene = {"version": 1, "scene": self.source}
        if not is_sweep:
            # a mistake in a model is not a mistake in a sweep
            scenes.open(self.source)
        read = read_sweep(path if is_sweep else sweep_of_scene, scenes.vocabulary)
        reference, sweep = read.sweep.scene, read.sweep
        if self.task.drive is None and sweep.drive is not None:
            scenes = replace(scenes, drive=sweep.drive, drive_folder=folder)
        asked = [*self.assign, *self.task.settings]
        assigned, given = read_settings(scenes, reference, asked, ("duration", "must"))
        scenarios, axes = _scenarios(read.plan), read.plan.axes
        # values that the sweep gives to every run, including effects
        varied = {axis.name for axis in axes if axis.count > 1 or axis.role == "scenario"}
        first = next(read.plan.iterate_runs()).values
        fixed = {name: value for name, value in first.items() if name not in varied}
        manifest = scenes.open(reference).source.manifest
        own = manifest.tolerances if manifest else {}
        setup = AblationSetup(
            scenes=scenes,
            reference=reference,
            base={**fixed, **assigned},
            scenarios=scenarios,
            fresh_scenarios=_between(scenarios),
            seeds=tuple(range(self.seeds)),
            duration=given.duration or sweep.duration,
            tolerances={**own, **sweep.tolerances, **self.task.limits},
            options=self.task,
            thresholds=sweep.thresholds,
            must=given.must or sweep.must,
        )
        return setup.compared_with_recordings() if self.metric else setup


_MOST_RECORDED = 24  # number of drawn recorded runs


@dataclass(frozen=True)
class AblationSetup:
    """A scene, and the configuration around which its effects are changed."""

    scenes: SceneLoader  # opens the scene
    reference: str  # the value of `scene:` in a sweep file
    seeds: tuple[int, ...]  # seeds per effect
    # canonical values of the base configuration
    base: Values = field(default_factory=dict[str, object])
    scenarios: tuple[Values, ...] = ({},)  # values of the axes of role scenario
    fresh_scenarios: tuple[Values, ...] = ({},)  # other such values, for verification
    duration: float | None = None  # simulated time [s], or None for the scene's own
    # metric to largest change; empty if neither sweep nor scene has any
    tolerances: Mapping[str, float] = field(default_factory=dict[str, float])
    options: TaskOptions = AS_INFERRED  # options that replace parts of the task
    # of labels, over the scene's
    thresholds: Mapping[str, float] = field(default_factory=dict[str, float])
    must: tuple[str, ...] = ()  # requirements on every run

    @property
    def scene(self) -> Scene:
        """The scene, with every effect that its model has."""
        return self.scenes.open(self.reference).with_effects("all")

    @property
    def task(self) -> Task:
        """Task of the first scenario, by which it is judged."""
        return self.scene.task(
            {**self.base, **self.scenarios[0]},
            self.duration,
            watch=self.options.observe,
            within=self.options.tolerance,
            seeds=self.seeds,
        )

    @property
    def scenario(self) -> list[str]:
        """Settings that the scene shares with every configuration, except numerical ones."""
        fixed = [name for name in self.base if name not in OPTIONS and name not in EFFECTS]
        return [*fixed, *self.scenarios[0]]

    def compared_with_recordings(self) -> "AblationSetup":
        """Return the setup with recorded runs as scenarios, and others for verification."""
        if (recorded := self.scene.recorded) is None:
            raise SceneError(f"{self.reference}: error {REALITY} needs a scene with a `recording`")
        drawn = np.random.default_rng(0).permutation(recorded.numbers).tolist()
        scenarios = self.scenarios
        if not all(RECORDED_RUN in scenario for scenario in scenarios):
            some = drawn[:_MOST_RECORDED]
            scenarios = [{**scenario, RECORDED_RUN: run} for scenario in scenarios for run in some]
        used = {scenario[RECORDED_RUN] for scenario in scenarios}
        others = [run for run in drawn if run not in used]
        pairs = zip(scenarios, others, strict=False)
        fresh = [{**scenario, RECORDED_RUN: run} for scenario, run in pairs] or scenarios
        tolerances = {REALITY: self.tolerances.get(REALITY, 0.0)}
        runs = {"scenarios": tuple(scenarios), "fresh_scenarios": tuple(fresh)}
        return replace(self, **runs, seeds=(0,), tolerances=tolerances)

    def written(self, reference: str, settings: Values) -> "AblationSetup":
        """Return the setup of a written model, with the same drive."""
        scene, given = self.scene, self.scenes.drive
        drive = given or scene.drive.drive
        folder = self.scenes.drive_folder if given else scene.source.path.parent
        scenes = SceneLoader(self.scenes.folder, drive, folder)
        effects = [EFFECTS[name] for name in settings if name in EFFECTS]
        about = {*settings, *(setting for effect in effects for setting in effect.switch.settings)}
        base = {name: value for name, value in self.base.items() if name not in about}
        return replace(self, scenes=scenes, reference=reference, base=base)


def _scenarios(plan: Plan) -> tuple[Values, ...]:
    names = [axis.name for axis in plan.axes if axis.role == "scenario"]
    scenarios: dict[str, Values] = {}
    for run in plan.iterate_runs():
        scenario = {name: run.values[name] for name in names if name in run.values}
        scenarios.setdefault(json.dumps(scenario, default=str), scenario)
    return tuple(scenarios.values())


def _between(scenarios: Sequence[Values]) -> tuple[Values, ...]:
    """Return scenarios half way between neighbors, or the given ones if there are none."""
    middles = [_half_way(first, second) for first, second in pairwise(scenarios)]
    return tuple(middle for middle in middles if middle not in scenarios) or tuple(scenarios)


def _half_way(first: Values, second: Values) -> dict[str, object]:
    middle = dict(first)
    for name, value in first.items():
        other = second.get(name)
        if name != RECORDED_RUN and isinstance(value, float) and isinstance(other, float):
            # Whole numbers count or select, and have no values between them.
            whole = value.is_integer() and other.is_integer() and abs(value - other) <= 1
            middle[name] = value if whole else (value + other) / 2
    return middle


def read_setup(source: str, assign: Sequence[str], options: TaskOptions) -> AblationSetup:
    """Return the scene, base configuration and scenarios of a sweep file.

    Raises:
        SceneError: there is no such scene.
        SweepFileError: the sweep or a setting is wrong.
    """
    return EffectsRequest(source, assign, task=options).setup
