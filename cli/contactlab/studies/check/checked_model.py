"""The model under check, with its settings and initial state, and its runs."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import mujoco

from contactlab.engines.engine import bytes_of_run
from contactlab.errors import SweepFileError
from contactlab.judge.limits import LIMITS
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.run.planned_runs import RUN_BYTES
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.compiled_scene import CompiledScene, PreparedModel
from contactlab.scene.run_setup import make_setup
from contactlab.scene.run_spec import RunSpec, steps_of
from contactlab.scene.scene import Scene
from contactlab.schema.check_report import Measure, TaskKind
from contactlab.schema.drive import Drive, drive_data
from contactlab.schema.finding import Level
from contactlab.schema.setting_values import as_number
from contactlab.schema.task import SEEDS, Task
from contactlab.schema.task_verdict import TaskVerdict
from contactlab.studies.check.check_runs import CheckRun, Holding, holding_of
from contactlab.studies.session import Session, Values
from contactlab.studies.task_verdict import task_verdict

NOMINAL_STORE = "run"
"""Name of the store of the nominal runs, those of the model as it is."""

_MOST_STEPS, _MOST_REMEDY_STEPS = 300_000, 600_000
"""Steps that a run of a check takes at most, and all remedies together."""
_SMALL = 10  # degrees of freedom up to which a model may take so many steps; larger ones take fewer


def most_steps(model: mujoco.MjModel, of_small: int | None = None) -> int:
    """Return how many steps a run of a model takes at most, given how many that of a small one."""
    return (of_small or _MOST_STEPS) * _SMALL // max(_SMALL, model.nv)


class TooLongError(SweepFileError):
    """A run that a check would make takes too long, or too much memory."""


def axis_value(name: str, value: object) -> object:
    """Return a resolved setting in the form that its axis takes."""
    if name != "friction":
        return value
    assert isinstance(value, tuple)
    return value[0], value[2], value[3]


@dataclass
class CheckedModel:
    """A model under check, which runs it, or other scenes with its parameters."""

    reference: str  # the model as requested, and as sweeps name their scene
    scenes: SceneLoader
    session: Session
    values: Mapping[str, object]  # the settings as requested, by axis
    duration: float  # simulated time of its nominal run [s]
    drive: Drive | None  # what drives it; the scene's own if None
    # Limits that replace those of the checks, by the name of the measure.
    limits: Mapping[str, float]
    kind: TaskKind
    kind_reason: str  # why it is for that kind of task, in words
    options: TaskOptions = AS_INFERRED  # what replaces parts of its task
    notes: tuple[str, ...] = ()  # what is to be said of how it is run
    seeds: tuple[int, ...] = SEEDS  # of its nominal runs
    brief: bool = False  # whether only the runs are made that measures with limits need
    _written: set[str] = field(default_factory=set[str])
    _steps: Counter[str] = field(default_factory=Counter[str])

    def trying(self, settings: Values, folder: str) -> "CheckedModel":
        """Return the model with more settings, its brief runs in a folder below this one's.

        They have the seed of the nominal run.
        """
        session = replace(self.session, folder=self.session.folder / folder)
        values = {**self.values, **settings}
        new = replace(self, session=session, values=values, brief=True, _written=set())
        return replace(new, seeds=(self.nominal.resolved.seed,))

    @cached_property
    def scene(self) -> Scene:
        """The model's scene, driven."""
        return self.scenes.driven(self.reference, self.drive)

    @cached_property
    def resolved(self) -> RunSpec:
        """Everything that determines the nominal run."""
        return self.scene.resolve(self.values, 0, self.duration)

    @cached_property
    def task(self) -> Task:
        """Task on which the model is judged."""
        watch, within = self.options.watch, self.options.within
        return self.scene.task(
            self.values, self.duration, watch=watch, within=within, seeds=self.seeds
        )

    @cached_property
    def verdict(self) -> TaskVerdict:
        """What the runs of its task come to."""
        records = [run.record for run in self.nominals]
        return task_verdict(self.task, self.scene, self.values, records, self.session)

    @property
    def base(self) -> CompiledScene:
        """Its compiled scene, before settings are written."""
        return self.scene.base(self.resolved.structure)

    @cached_property
    def prepared(self) -> PreparedModel:
        """Its model with the settings written."""
        return self.base.prepare(self.resolved.edits())

    @cached_property
    def subject_mass(self) -> float:
        """Mass of the scene's subject [kg], else of its heaviest free body, else 1 kg."""
        subject, model = self.base.targets.subject, self.prepared.model
        if subject is not None:
            return float(model.body_mass[subject])
        free = make_setup(self.base, None, [self.resolved], [model], {}).free_bodies
        return max((float(body.mass[0]) for body in free), default=1.0)

    @cached_property
    def nominal(self) -> CheckRun:
        """The run of the model as it is, with every check of its trace.

        Of all seeds of its task, the first one that is not stable, if any is not.
        """
        return next(
            (run for run in self.nominals if run.record.label != "stable"), self.nominals[0]
        )

    @cached_property
    def nominals(self) -> list[CheckRun]:
        """The runs of the model as it is, one for each of its seeds."""
        checks, text = "none" if self.brief else "all", "The model as it is"
        (first,) = self.run(NOMINAL_STORE, text, [{}], checks=checks, seeds=list(self.seeds))
        return [replace(first, resolved=replace(first.resolved, seed=seed)) for seed in self.seeds]

    @cached_property
    def holding(self) -> Holding:
        """Bodies that the nominal run holds, and those that stand in it."""
        return holding_of(self.nominal)

    def fits(self, timestep: float, seconds: float, scene: str | None = None) -> bool:
        """Say whether a run of a duration [s] at a timestep [s] is short enough to be made."""
        steps = steps_of(seconds, timestep)
        model = self.scenes.open(scene or self.reference).base({}).model
        return steps <= most_steps(self.base.model) and bytes_of_run(model, steps) <= RUN_BYTES

    def run(
        self,
        name: str,
        description: str,
        rows: Sequence[Values],
        *,
        scene: str | None = None,
        duration: float | None = None,
        drive: Drive | None = None,
        **keys: object,
    ) -> list[CheckRun]:
        """Run the model with more settings, a run each row, or another scene with just these.

        Duration [s] and drive are the model's unless given; `keys` are more of a sweep file. A
        TooLongError says that a run takes too many steps, or too much memory.
        """
        seconds = self.duration if duration is None else duration
        drive = drive or (self.drive if scene is None else None)
        whole = [dict(row) if scene else {**self.values, **row} for row in rows]
        timesteps = [as_number(row.get("timestep", self.resolved.timestep)) for row in whole]
        for step in timesteps:
            bounded = self.brief or name != NOMINAL_STORE
            if bounded and not self.fits(step, seconds, scene):
                steps = steps_of(seconds, step)
                raise TooLongError(f"a run of {seconds:g} s would take {steps:,} steps")
        if self.brief:
            total = self._steps["remedies"] + sum(steps_of(seconds, step) for step in timesteps)
            if total > (most := most_steps(self.base.model, _MOST_REMEDY_STEPS)):
                raise TooLongError(
                    f"remedies would take {total:,} steps; {most:,} are made at most"
                )
            self._steps["remedies"] = total
        # What has to hold is said of the model itself, over its own time.
        must = self.options.must if scene is None and seconds == self.duration else ()
        sweep = {
            "version": 1,
            "scene": scene or self.reference,
            "description": description,
            "axes": {axis: [value] for axis, value in whole[0].items()},
            "include": whole[1:],
            "trace": "all",
            "duration": seconds,
            **({} if drive is None else {"drive": drive_data(drive)}),
            **({"must": list(must)} if must else {}),
            **keys,
        }
        store = self.session.run_derived(name, sweep, self.scenes)
        self._written.add(name)
        driven = self.scenes.driven(scene or self.reference, drive)
        return [CheckRun(driven, driven.resolve(row, 0, seconds), store) for row in whole]

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
        return tuple(name for name in names if name in self._written)
