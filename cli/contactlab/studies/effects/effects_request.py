"""What an ablation is asked: a scene, a base configuration, scenarios, seeds and tolerances."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from contactlab.errors import SweepFileError
from contactlab.plan import Overrides, Plan, read_sweep
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene import Scene

Values = Mapping[str, object]
_SWEEPS = {".yaml", ".yml"}


@dataclass(frozen=True)
class EffectsRequest:
    """What is asked.

    Attributes:
        source: as it was asked for.
        scenes: opens the scene.
        reference: what a sweep file says after `scene:`.
        base: canonical values of the base configuration.
        scenarios: values that the world chooses; one empty one if it chooses none.
        fresh: other such values, to verify with.
        seeds: to ablate with.
        duration: simulated time [s], or None for the scene's own.
        tolerances: metric to largest change; empty if neither sweep nor scene has any.
        thresholds: of labels, over the scene's.
    """

    source: str
    scenes: SceneLoader
    reference: str
    base: Values
    scenarios: tuple[Values, ...]
    fresh: tuple[Values, ...]
    seeds: tuple[int, ...]
    duration: float | None
    tolerances: Mapping[str, float]
    thresholds: Mapping[str, float]

    @property
    def scene(self) -> Scene:
        """The scene, with all that its model has."""
        return self.scenes.open(self.reference).with_effects("all")


def ask(source: str, assign: Sequence[str], seeds: int, folder: Path) -> EffectsRequest:
    """Return what is asked of a scene, a sweep file or a model.

    Of a sweep, axes of the role scenario are kept, and knobs of one value; other knobs stay as
    the scene has them, unless an option sets them.

    Args:
        source: a sweep file; else whatever a sweep may name as its scene.
        assign: `NAME=VALUE`, one value each.
        seeds: how many.
        folder: where relative paths of scenes start.

    Raises:
        SweepFileError: the sweep or the options hold mistakes.
        SceneError: there is no such scene.
    """
    path = Path(source)
    is_sweep = path.suffix in _SWEEPS
    scenes = SceneLoader(path.parent if is_sweep else folder)
    text = json.dumps({"version": 1, "scene": source})
    read = read_sweep(path if is_sweep else text, scenes.vocabulary)
    reference, sweep = read.sweep.scene, read.sweep
    chosen = _options(scenes, reference, assign)
    scenarios = _scenarios(read.plan)
    manifest = scenes.open(reference).source.manifest
    return EffectsRequest(
        source=source,
        scenes=scenes,
        reference=reference,
        base={**_fixed(read.plan), **chosen},
        scenarios=scenarios,
        fresh=_between(scenarios),
        seeds=tuple(range(seeds)),
        duration=sweep.duration,
        tolerances={**(manifest.tolerances if manifest else {}), **sweep.tolerances},
        thresholds=sweep.thresholds,
    )


def _options(scenes: SceneLoader, reference: str, assign: Sequence[str]) -> Values:
    text = json.dumps({"version": 1, "scene": reference})
    plan = read_sweep(text, scenes.vocabulary, Overrides(assign)).plan
    given = plan.sweep.model_dump(exclude_defaults=True).keys() - {"version", "scene", "axes"}
    if given:
        raise SweepFileError(f"--set {min(given)}: effects takes axes of the scene only")
    for axis in plan.axes:
        if axis.count > 1:
            raise SweepFileError(
                f"--set {axis.name}: the base configuration has one value, not {axis.count}"
            )
    return next(plan.runs()).values


def _fixed(plan: Plan) -> dict[str, object]:
    """Return the values that a sweep gives to every run, its effects among them."""
    varied = {axis.name for axis in plan.axes if axis.count > 1 or axis.role == "scenario"}
    return {name: value for name, value in next(plan.runs()).values.items() if name not in varied}


def _scenarios(plan: Plan) -> tuple[Values, ...]:
    names = [axis.name for axis in plan.axes if axis.role == "scenario"]
    found: dict[str, Values] = {}
    for run in plan.runs():
        scenario = {name: run.values[name] for name in names if name in run.values}
        found.setdefault(json.dumps(scenario, default=str), scenario)
    return tuple(found.values())


def _between(scenarios: Sequence[Values]) -> tuple[Values, ...]:
    """Return scenarios half way between neighbours; the given ones where nothing is between."""
    found = [_half_way(first, second) for first, second in pairwise(scenarios)]
    fresh = tuple(each for each in found if each not in scenarios)
    return fresh or tuple(scenarios)


def _half_way(first: Values, second: Values) -> dict[str, object]:
    middle = dict(first)
    for name, value in first.items():
        other = second.get(name)
        # Whole numbers count or choose, and have nothing between.
        if isinstance(value, float) and isinstance(other, float) and not _are_whole(value, other):
            middle[name] = (value + other) / 2
    return middle


def _are_whole(*values: float) -> bool:
    return all(value == int(value) for value in values) and max(values) - min(values) <= 1
