"""From planned runs to compiled models and initial states; models are kept between jobs."""

import faulthandler
import signal
from collections import OrderedDict
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

from contactlab.engines import ENGINES, Proceed, proceed_always
from contactlab.run.evidence_record import RunPlan
from contactlab.run.planned_runs import max_models
from contactlab.run.tasks import Job, Task
from contactlab.scene import (
    InitialStates,
    PreparedModel,
    ResolvedRun,
    Scene,
    silence_mujoco,
    stored_scene,
)
from contactlab.schema import effects_base
from contactlab.store import local_scene

_MAX_MODELS = 64


class AbandonedError(Exception):
    """A pass over runs was abandoned, since the sweep should stop."""


class Preparer:
    """Prepares the runs of one sweep.

    Attributes:
        task: what all jobs of the sweep share.
        scene: their scene, from the store's copy.
        proceed: returns, between runs, whether the next one should begin.
    """

    def __init__(self, task: Task, marker: Path | None, proceed: Proceed = proceed_always) -> None:
        silence_mujoco()
        self.task = task
        self.proceed = proceed
        folder = local_scene(task.store, task.scene_folder)
        scene = Scene(stored_scene(folder, task.scene_model, task.scene), ENGINES)
        self.scene = scene.with_effects(effects_base(task.sweep.effects))
        self._marker = marker
        self._models: OrderedDict[str, PreparedModel] = OrderedDict()

    def plans(self, job: Job) -> list[RunPlan]:
        """Return settings, model and initial state of each run of a job of one structure."""
        resolved = [
            self.scene.resolve(run.values, run.seed, self.task.sweep.duration) for run in job
        ]
        starts = self.scene.starts(resolved)
        initial = [starts.pick(place) for place in range(len(job))]
        return [
            RunPlan(run, each, self._prepared(each, start), start)
            for run, each, start in zip(job, resolved, initial, strict=True)
        ]

    def _prepared(self, run: ResolvedRun, start: InitialStates) -> PreparedModel:
        key = self.scene.model_key(run, start)
        if key not in self._models:
            self._models[key] = self.scene.prepare(run, start)
            most = min(_MAX_MODELS, max_models(self.scene.base_of(run)))
            while len(self._models) > most:
                self._models.popitem(last=False)
        self._models.move_to_end(key)
        return self._models[key]

    @contextmanager
    def watchdog(self) -> Generator[Callable[[], None]]:
        """Yield what starts the time limit of a run, which ends this process when it is exceeded.

        Even where a run never returns to Python: the process dies of SIGALRM, and its traceback is
        in the marker, which is empty otherwise.
        """
        if self._marker is None:
            yield lambda: None
            return
        with self._marker.open("w") as file:
            # A timer takes one system call; faulthandler's own starts a thread each time.
            faulthandler.register(signal.SIGALRM, file=file, all_threads=False, chain=True)
            try:
                yield self._start_clock
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0)
                faulthandler.unregister(signal.SIGALRM)

    @contextmanager
    def watchdog_or_give_up(self) -> Generator[Callable[[], None]]:
        """Do the same, and abandon the pass before the next run if the sweep should stop.

        Raises:
            AbandonedError: from what is yielded, if the sweep should stop.
        """

        def watch() -> None:
            if not self.proceed():
                raise AbandonedError
            start_clock()

        with self.watchdog() as start_clock:
            yield watch

    def _start_clock(self) -> None:
        signal.setitimer(signal.ITIMER_REAL, self.task.sweep.timeout)
