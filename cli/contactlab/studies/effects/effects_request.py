"""The request of an ablation: a base configuration, scenarios, seeds and tolerances."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from contactlab.errors import SceneError
from contactlab.plan.sweep_file import read_sweep
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.scene import Scene
from contactlab.schema.tradeoff_report import REALITY
from contactlab.schema.vocabulary import RECORDED_RUN
from contactlab.tasks.session import Values, read_settings

SWEEP_SUFFIXES = {".yaml", ".yml"}


@dataclass(frozen=True)
class EffectsRequest:
    """The model to take apart.

    Attributes:
        source: a model, a scene, or a sweep file.
        assign: settings, `NAME=VALUE` each.
        task: options that replace parts of the task; of its limits, only the tolerance.
        max_cpu: limit of CPU time [s].
        keep: names of features and parts that stay.
        far_distance: collisions of bodies that stayed this far apart may go [m]; None to offer it.
        write: file of the smaller model; by default it is in the session's folder.
    """

    source: str
    assign: Sequence[str] = ()
    task: TaskOptions = AS_INFERRED
    max_cpu: float = 120.0
    keep: Sequence[str] = ()
    far_distance: float | None = None
    write: Path | None = None


@dataclass(frozen=True)
class SweepSetup:
    """A scene, with the settings and the scenarios of a sweep."""

    scenes: SceneLoader  # opens the scene
    reference: str  # the value of `scene:` in a sweep file
    seeds: tuple[int, ...]  # seeds of each scenario
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

    def compared_with_recordings(self) -> "SweepSetup":
        """Return the setup with recorded runs as scenarios, and others for verification."""
        if (recorded := self.scene.recorded) is None:
            raise SceneError(f"{self.reference}: error {REALITY} needs a scene with a `recording`")
        shuffled = np.random.default_rng(0).permutation(recorded.numbers).tolist()
        scenarios = self.scenarios
        if not all(RECORDED_RUN in scenario for scenario in scenarios):
            most_drawn = 24
            some = shuffled[:most_drawn]
            scenarios = [{**scenario, RECORDED_RUN: run} for scenario in scenarios for run in some]
        used_runs = {scenario[RECORDED_RUN] for scenario in scenarios}
        others = [run for run in shuffled if run not in used_runs]
        pairs = zip(scenarios, others, strict=False)
        fresh = [{**scenario, RECORDED_RUN: run} for scenario, run in pairs] or scenarios
        tolerances = {REALITY: self.tolerances.get(REALITY, 0.0)}
        runs = {"scenarios": tuple(scenarios), "fresh_scenarios": tuple(fresh)}
        return replace(self, **runs, seeds=(0,), tolerances=tolerances)

    def for_written_model(self, reference: str, settings: Values) -> "SweepSetup":
        """Return the setup of a written model, with the same drive."""
        scene, stated_drive = self.scene, self.scenes.drive
        drive = stated_drive or scene.drive.drive
        folder = self.scenes.drive_folder if stated_drive else scene.source.path.parent
        scenes = SceneLoader(self.scenes.folder, drive, folder)
        effects = [EFFECTS[name] for name in settings if name in EFFECTS]
        about = {*settings, *(setting for effect in effects for setting in effect.switch.settings)}
        base = {name: value for name, value in self.base.items() if name not in about}
        return replace(self, scenes=scenes, reference=reference, base=base)


def _half_way(first: Values, second: Values) -> dict[str, object]:
    middle = dict(first)
    for name, value in first.items():
        other = second.get(name)
        if name != RECORDED_RUN and isinstance(value, float) and isinstance(other, float):
            # Whole numbers count or select, and have no values between them.
            whole = value.is_integer() and other.is_integer() and abs(value - other) <= 1
            middle[name] = value if whole else (value + other) / 2
    return middle


def read_setup(request: EffectsRequest, *, recordings: bool = False) -> SweepSetup:
    """Return the scene, base configuration and scenarios of a sweep, read once.

    Axes of the role scenario are used, and knobs with one value; other knobs stay as in the scene,
    unless `assign` sets them. With recordings, scenarios are recorded runs.

    Raises:
        SceneError: there is no such scene, or it has no recording.
        SweepFileError: the sweep or a setting is wrong.
    """
    path = Path(request.source)
    is_sweep = path.suffix in SWEEP_SUFFIXES
    folder = path.parent if is_sweep else Path()
    scenes = SceneLoader(folder, request.task.drive)
    sweep_of_scene = {"version": 1, "scene": request.source}
    if not is_sweep:
        # A mistake in a model is not a mistake in a sweep.
        scenes.open(request.source)
    sweep_file = read_sweep(path if is_sweep else sweep_of_scene, scenes.vocabulary)
    reference, sweep = sweep_file.sweep.scene, sweep_file.sweep
    if request.task.drive is None and sweep.drive is not None:
        scenes = replace(scenes, drive=sweep.drive, drive_folder=folder)
    assignments = [*request.assign, *request.task.settings]
    assigned, assigned_sweep = read_settings(scenes, reference, assignments, ("duration", "must"))
    axes = sweep_file.plan.axes
    names = [axis.name for axis in axes if axis.role == "scenario"]
    scenario_values: dict[str, Values] = {}
    for run in sweep_file.plan.iterate_runs():
        scenario = {name: run.values[name] for name in names if name in run.values}
        scenario_values.setdefault(json.dumps(scenario, default=str), scenario)
    scenarios = tuple(scenario_values.values())
    # The verification uses scenarios half way between neighbors, or the same ones.
    middles = [_half_way(first, second) for first, second in pairwise(scenarios)]
    between = tuple(middle for middle in middles if middle not in scenarios)

    # Values that the sweep gives to every run, including effects.
    varied = {axis.name for axis in axes if axis.count > 1 or axis.role == "scenario"}
    first = next(sweep_file.plan.iterate_runs()).values
    fixed = {name: value for name, value in first.items() if name not in varied}
    setup = SweepSetup(
        scenes=scenes,
        reference=reference,
        base={**fixed, **assigned},
        scenarios=scenarios,
        fresh_scenarios=between or scenarios,
        seeds=(0,),
        duration=assigned_sweep.duration or sweep.duration,
        tolerances=sweep.tolerances,
        options=request.task,
        thresholds=sweep.thresholds,
        must=assigned_sweep.must or sweep.must,
    )
    return setup.compared_with_recordings() if recordings else setup
