"""What is tuned, how well, and how long that may take."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from contactlab.errors import SceneError, SweepFileError, did_you_mean
from contactlab.measure import METRICS
from contactlab.run.sweep_request import SceneLoader
from contactlab.schema.drive import Drive
from contactlab.schema.tune_report import Goal
from contactlab.studies.effects.effects_request import AblationSetup

BASELINE, CONTENDERS, FRESH = range(3), range(10), range(10, 20)
"""Seeds: of the model as written, of what the search finds, and of the proof."""


@dataclass(frozen=True)
class TuneRequest:
    """Which model to tune, and what of it to keep."""

    model: str  # a model file, a scene, or whatever a sweep may name as its scene
    # The fastest model within the limits, or the most accurate at no more than its price.
    goal: Goal = "fastest"
    # Largest distance from the model as written at a much finer timestep, at any time [m]; None for
    # what the model as written has itself.
    error: float | None = None
    # Metric to largest size.
    tolerances: Mapping[str, float] = field(default_factory=dict[str, float])
    budget: float = 300.0  # wall time [s]
    free: Sequence[str] = ()  # contact parameters that may become softer
    drop_sensors: bool = False  # whether sensors may go, which no metric reads
    # What drives the runs; an exercise of a model without a manifest, if None.
    drive: Drive | None = None

    @cached_property
    def setup(self) -> AblationSetup:
        """The scene, and the seeds of its baseline.

        Raises a SceneError if there is no such scene, or nothing in it moves; a SweepFileError if a
        tolerance is of no metric.
        """
        scenes = SceneLoader(Path(), self.drive, bare="exercise")
        if not scenes.open(self.model).base({}).model.nv:
            raise SceneError(f"{self.model} has no joints: nothing moves, so nothing can be tuned")
        for name in self.tolerances:
            if name not in METRICS:
                raise SweepFileError(f"no metric '{name}'{did_you_mean(name, METRICS)}")
        return AblationSetup(scenes, self.model, tuple(BASELINE))
