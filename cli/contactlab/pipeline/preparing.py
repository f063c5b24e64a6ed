"""From planned runs to all that decides them; models are kept between jobs."""

import faulthandler
from collections import OrderedDict
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

from contactlab.pipeline.job import Job, Task
from contactlab.pipeline.jobs import most_models
from contactlab.pipeline.record import RunPlan
from contactlab.scene import Prepared, Resolved, Scene, Starts, quiet, stored_scene
from contactlab.schema import rest

_MOST_MODELS = 64


class Preparer:
    """Prepares the runs of one sweep.

    Attributes:
        task: what all jobs of the sweep have in common.
        scene: theirs, as the store has it.
    """

    def __init__(self, task: Task, marker: Path | None) -> None:
        quiet()
        self.task = task
        scene = Scene(stored_scene(task.scene_folder, task.scene_model, task.scene))
        self.scene = scene.with_effects(rest(task.sweep.effects))
        self._marker = marker
        self._models: OrderedDict[str, Prepared] = OrderedDict()

    def plans(self, job: Job) -> list[RunPlan]:
        """Return all that decides the runs of a job of one structure."""
        resolved = [
            self.scene.resolve(run.values, run.seed, self.task.sweep.duration) for run in job
        ]
        starts = self.scene.starts(resolved)
        picked = [starts.pick(place) for place in range(len(job))]
        return [
            RunPlan(run, each, self._prepared(each, start), start)
            for run, each, start in zip(job, resolved, picked, strict=True)
        ]

    def _prepared(self, run: Resolved, start: Starts) -> Prepared:
        key = self.scene.model_key(run, start)
        if key not in self._models:
            self._models[key] = self.scene.prepare(run, start)
            most = min(_MOST_MODELS, most_models(self.scene.base_of(run)))
            while len(self._models) > most:
                self._models.popitem(last=False)
        self._models.move_to_end(key)
        return self._models[key]

    @contextmanager
    def watchdog(self) -> Generator[Callable[[], None]]:
        """End this process when a run takes too long, even one that never gives Python a turn."""
        if self._marker is None:
            yield lambda: None
            return
        with self._marker.open("w") as file:
            try:
                yield lambda: faulthandler.dump_traceback_later(
                    self.task.sweep.timeout, exit=True, file=file
                )
            finally:
                faulthandler.cancel_dump_traceback_later()
