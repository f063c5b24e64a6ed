"""A model under examination: its task, its runs, its motions and their budget, each made once."""

import math
import warnings
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from contactlab.budget import (
    ErrorBudget,
    Motion,
    Settings,
    Verdict,
    error_budget,
    judge,
    plan_budget,
)
from contactlab.budget.windows import add_simulated_steps
from contactlab.engines.closed_loop import allowed_policy
from contactlab.errors import EngineError, ModelWarning, SceneError, SweepFileError
from contactlab.judge.limits import LIMITS
from contactlab.measure import THRESHOLDS
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.printable import Replacer
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.compiled_scene import CompiledScene, PreparedModel
from contactlab.scene.model_names import geom_name_replacer
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.schema.check_report import Measure
from contactlab.schema.drive import drive_data
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.finding import Level
from contactlab.schema.task import SEEDS, Task
from contactlab.schema.task_verdict import TaskVerdict
from contactlab.store.finished_store import Store
from contactlab.store.mcap.trace_reader import StoredTrace
from contactlab.tasks.session import Session, Values, read_settings
from contactlab.tasks.task_motions import Change, as_it_is, task_motions
from contactlab.tasks.task_verdict import can_move, refuse_lengths, verdict_of

TASK_STORE = "run"
"""Name of the store of the task's runs, one for each of its seeds."""
MOST_SEEDS = 9
"""Seeds up to which a task is extended while they disagree about the tolerance."""


@dataclass(frozen=True)
class CheckedRun:
    """A run of the model, and its evidence."""

    scene: Scene
    resolved: RunSpec
    store: Store

    @cached_property
    def record(self) -> EvidenceRecord:
        """Its record."""
        return self.store.record(self.scene.run_id(self.resolved))

    @cached_property
    def trace(self) -> StoredTrace:
        """Its trace."""
        return self.store.trace(self.record)


@dataclass
class CheckedModel:
    """A model under examination, which runs it.

    Attributes:
        reference: the model as requested, and as sweeps name their scene.
        values: the settings as requested, by axis.
        duration: simulated time of its runs [s]; that of its scene if None.
        options: replacements for parts of its task.
        thresholds: of labels, which replace their own, by name.
        limits: of checks, which replace their own, by the name of the measure.
        settings: how its budget is measured.
        rows: of its budget, by name; all if None.
        threads: that measure it.
        seconds: counted time of its budget [s]: rows that judge nothing have to be within it.
    """

    reference: str
    scenes: SceneLoader
    session: Session
    values: Values
    duration: float | None = None
    options: TaskOptions = AS_INFERRED
    thresholds: Mapping[str, float] = field(default_factory=dict[str, float])
    limits: Mapping[str, float] = field(default_factory=dict[str, float])
    settings: Settings = Settings(places=False)  # noqa: RUF009 - it is frozen
    rows: Sequence[str] | None = ()
    threads: int = 1
    seconds: float = math.inf
    _store_names: set[str] = field(default_factory=set[str])

    @cached_property
    def scene(self) -> Scene:
        """The model's scene, driven as its task says."""
        return self.scenes.open(self.reference)

    @cached_property
    def task(self) -> Task:
        """Task on which the model is judged."""
        watch, within = self.options.observe, self.options.tolerance
        seeds = range(self.options.seeds) if self.options.seeds else SEEDS
        return self.scene.task(
            self.values, self.duration, watch=watch, within=within, seeds=tuple(seeds)
        )

    @cached_property
    def resolved(self) -> RunSpec:
        """Everything that determines the run of the first seed."""
        return self.scene.resolve(self.values, self.task.seeds[0], self.duration)

    @property
    def base(self) -> CompiledScene:
        """Its compiled scene, before settings are written."""
        return self.scene.base(self.resolved.structure)

    @cached_property
    def prepared(self) -> PreparedModel:
        """Its model with the settings written."""
        return self.base.prepare(self.resolved.list_edits())

    @cached_property
    def name_geoms(self) -> Replacer:
        """The replacer of unnamed geoms in a text by their bodies."""
        return geom_name_replacer(self.base.model)

    @cached_property
    def moves(self) -> bool:
        """Whether MuJoCo moves something in it."""
        return can_move(self.resolved, self.base.model)

    def motions_of(
        self,
        task: Task,
        settings: Values | None = None,
        change: Change = as_it_is,
        scene: Scene | None = None,
    ) -> list[Motion]:
        """Return the motions of a task's phases, with other settings or a changed model or scene.

        Raises:
            EngineError: another engine than MuJoCo is requested, or nothing moves.
        """
        if not self.moves:
            engine = self.resolved.engine
            what = "nothing in it moves and has mass"
            if engine != "mujoco":
                what = f"only MuJoCo's own motion is measured, not that of engine {engine}"
            raise EngineError(f"{self.reference}: {what}")
        whole = (scene or self.scene).with_effects("all")
        values = self.values if settings is None else settings
        allowed = self.session.allow_code
        return task_motions(whole, values, task, allow_code=allowed, change=change)

    @cached_property
    def motions(self) -> list[Motion]:
        """The motions of its task's phases."""
        return self.motions_of(self.task)

    @cached_property
    def budget(self) -> ErrorBudget:
        """Error budget of its observed bodies.

        Raises:
            EngineError: as of motions; or no observed body moves.
        """
        rows, settings = self._budget_plan
        return error_budget(self.motions, rows=rows, settings=settings, workers=self.threads)

    def add_seeds(self) -> None:
        """Add three seeds to the task while some are above the tolerance and others are not.

        Up to nine, unless their number was requested. Rows of the budget stay those of the first
        seeds.
        """
        while (
            self.moves
            and self.options.seeds is None
            and len(self.task.seeds) < MOST_SEEDS
            and any(phase.seeds_disagree(self.task.tolerance) for phase in self.budget.phases)
        ):
            seeds = tuple(range(len(self.task.seeds) + len(SEEDS)))
            known_phases = self.budget.phases
            self.task = self.task.model_copy(update={"seeds": seeds})
            self.motions = self.motions_of(self.task)
            settings = self._budget_plan[1]
            more = error_budget(self.motions, rows=(), settings=settings, workers=self.threads)
            self.budget = ErrorBudget(
                tuple(
                    replace(phase, rows=before.rows)
                    for phase, before in zip(more.phases, known_phases, strict=True)
                )
            )

    @cached_property
    def _budget_plan(self) -> tuple[Sequence[str], Settings]:
        # The rows that its budget has, and how it is measured.
        if self.rows is not None and math.isinf(self.seconds):
            return self.rows, self.settings
        rows, settings = plan_budget(self.motions, self.settings, self.seconds)
        return (rows if self.rows is None else self.rows), settings

    @property
    def budget_settings(self) -> Settings:
        """How its budget is measured, in the time that it may take."""
        return self._budget_plan[1]

    @property
    def unmeasured(self) -> tuple[str, ...]:
        """The rows that there was no time to measure."""
        if self.rows is not None:
            return ()
        own, _ = plan_budget(self.motions, self.settings, math.inf)
        return tuple(row for row in own if row not in self._budget_plan[0])

    @cached_property
    def budget_verdict(self) -> Verdict:
        """Verdict of its budget, with modeling choices."""
        return judge(self.budget, self.task.tolerance)

    @cached_property
    def verdict(self) -> TaskVerdict:
        """Verdict of the runs of its task."""
        budget = self.budget if self.moves else None
        return verdict_of(self.task, budget, [run.record for run in self.runs])

    @cached_property
    def runs(self) -> list[CheckedRun]:
        """The runs of its task, one for each seed, with all checks of runs and their traces."""
        self.check_timestep()
        return self.run(TASK_STORE, "The model as it is", seeds=self.task.seeds)

    @property
    def has_run(self) -> bool:
        """Whether the runs of its task are made already."""
        return "runs" in vars(self)

    @property
    def has_budget(self) -> bool:
        """Whether its budget is measured already."""
        return "budget" in vars(self)

    def check_timestep(self) -> None:
        """Raise a SweepFileError if the step is too long for a phase of the task."""
        step = self.resolved.timestep
        shortest = min(phase.end - phase.begin for phase in self.task.phases)
        fewest_steps = 5  # of a phase: its last fifth shows the bodies at rest
        if round(shortest / step, 9) < fewest_steps:
            raise SweepFileError(
                f"{self.reference}: a step of {step:g} s is too long for a phase of "
                f"{shortest:g} s; set a timestep of at most {shortest / fewest_steps:g} s"
            )

    def run(
        self, name: str, description: str, settings: Values | None = None, **keys: object
    ) -> list[CheckedRun]:
        """Run the model with more settings, once for each of its `seeds`, into a store.

        `keys` are more of a sweep file. A StoppedError says that it was interrupted.
        """
        values = {**self.values, **(settings or {})}
        drive, must = self.options.drive, self.options.require
        sweep = {
            "version": 1,
            "scene": self.reference,
            "description": description,
            "axes": {axis: [value] for axis, value in values.items()},
            "trace": "all",
            "duration": self.task.duration,
            "checks": "all",
            **({} if drive is None else {"drive": drive_data(drive)}),
            **({"must": list(must)} if must else {}),
            **({"thresholds": dict(self.thresholds)} if self.thresholds else {}),
            **keys,
        }
        seeds = keys.get("seeds", self.task.seeds[:1])
        assert isinstance(seeds, Sequence)
        sweep["seeds"] = list(seeds)
        store = self.session.run_derived(name, sweep, self.scenes)
        self._store_names.add(name)
        runs = self.scene.resolve_seeds(values, sweep["seeds"], self.duration)
        steps = sum(round(run.duration / run.timestep) for run in runs)
        # A step of a run with all checks takes about as long as five of the engine.
        add_simulated_steps(self.prepared.model, 5 * steps)
        return [CheckedRun(self.scene, run, store) for run in runs]

    def elsewhere(self, workers: int) -> "CheckedModel":
        """Return the model with runs in `workers` other processes."""
        model = copy(self)  # with its task and motions as far as they are known
        model.session = replace(self.session, workers=workers)
        return model

    def measure(
        self,
        name: str,
        value: float,
        of: str | None = None,
        *,
        limit: float | None = None,
        level: Level | None = None,
    ) -> Measure:
        """Return a value, and whether it meets its limit; NaN never does.

        A limit or level that is given replaces that of the check, but not that of the request.
        """
        return LIMITS[name].measure(value, of, self.limits.get(name, limit), level)

    def stores(self, *names: str) -> tuple[str, ...]:
        """Return which of these stores were written."""
        return tuple(name for name in names if name in self._store_names)


def open_changed_model(
    reference: str, session: Session, options: TaskOptions = AS_INFERRED
) -> CheckedModel:
    """Open the written file of a changed model, as `open_model` does, without its warnings.

    They are those of the original, which were shown when that was opened.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return open_model(reference, session, options)


def open_model(
    reference: str,
    session: Session,
    options: TaskOptions = AS_INFERRED,
    assign: Sequence[str] = (),
    *,
    rows: Sequence[str] | None = (),
    seconds: float = math.inf,
) -> CheckedModel:
    """Open a model with its task.

    Args:
        reference: a scene, its folder, a model file, or a robot.
        session: where and how it is run.
        options: replacements for parts of its task; limits are of checks or labels, by name.
        assign: settings, `NAME=VALUE` each.
        rows: of its error budget, by name; all if None. Changes are timed if it has rows.
        seconds: counted time within which its budget has rows that judge nothing [s].

    Raises:
        SceneError: there is no such model, keyframe or body, it does not compile, or its drive is
            code that may not run.
        SweepFileError: a setting or the name of a limit is wrong, or the tolerance is not a share.
    """
    refuse_lengths(options)
    limits = options.limits
    for name in limits:
        SweepFileError.unless_known(
            name, {**LIMITS, **THRESHOLDS}, f"no limit '{name}' of a check or a label"
        )
    scenes = SceneLoader(Path(), options.drive, allow_code=session.allow_code)
    assignments = [*assign, *options.settings]
    values, sweep = read_settings(scenes, reference, assignments, ("duration", "must"))
    opened = CheckedModel(
        reference=reference,
        scenes=scenes,
        # One process makes these few runs at once.
        session=replace(session, workers=0),
        threads=max(1, session.workers),
        values=values,
        duration=sweep.duration,
        options=options,
        thresholds={name: limits[name] for name in limits if name in THRESHOLDS},
        limits={name: limits[name] for name in limits if name in LIMITS},
        settings=Settings(places=False) if rows == () else Settings(measures_time=True),
        rows=rows,
        seconds=seconds,
    )
    allowed_policy(opened.scene.drive, allowed=session.allow_code)
    step = opened.resolved.timestep
    if not 0 < step < math.inf:
        raise SceneError(
            f"{opened.scene.source.model}: its timestep is {step:g} s; write one above 0 there, "
            "or `--set timestep=`"
        )
    return opened
