"""The options `--set` of a check: one value an axis, read as a sweep's options are."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from contactlab.engines import bytes_of_run
from contactlab.errors import SceneError, SweepFileError
from contactlab.plan import Overrides, read_sweep
from contactlab.run.planned_runs import RUN_BYTES
from contactlab.run.sweep_request import SceneLoader
from contactlab.run.sweep_runner import SweepRequest, run_sweep
from contactlab.run.tasks import IMPULSE, BeginCallback, ProgressCallback, Stop
from contactlab.scene import (
    PARAMETERS,
    QPOS0,
    CompiledScene,
    InitialStates,
    PreparedModel,
    ResolvedRun,
    Scene,
    make_setup,
)
from contactlab.schema import EvidenceRecord, Sweep
from contactlab.store import Store
from contactlab.store.mcap import StoredTrace

_KEYS = {"version", "scene", "axes", "duration"}


def read_options(
    scenes: SceneLoader, reference: str, assign: Sequence[str]
) -> tuple[Mapping[str, object], float | None]:
    """Return the values of axes and the duration [s], None if it is not set.

    Raises:
        SweepFileError: an option is wrong, or gives more than one value.
    """
    text = json.dumps({"version": 1, "scene": reference})
    read = read_sweep(text, scenes.vocabulary, Overrides(assign))
    asked = read.sweep.model_dump(exclude_defaults=True)
    if foreign := sorted(set(asked) & set(Sweep.model_fields) - _KEYS):
        raise SweepFileError(f"--set {foreign[0]}: a check takes axes of the model, and duration")
    for axis in read.plan.axes:
        if axis.count > 1:
            raise SweepFileError(
                f"--set {axis.name}: a check takes one value, not {axis.count}; "
                "to compare several, write a sweep"
            )
    values = next(read.plan.runs()).values
    if values.get("engine") == IMPULSE:
        raise SweepFileError("--set engine: a check is of a model in MuJoCo")
    return values, read.sweep.duration


def whole_settings(scene: Scene, values: Mapping[str, object]) -> dict[str, object]:
    """Put the settings that values change in their place, so that a check may change them too."""
    settings = scene.resolve(values, 0, None).settings
    whole: dict[str, object] = {}
    for name, value in values.items():
        changed = PARAMETERS[name].sets if name in PARAMETERS else name
        whole[changed] = settings[changed] if name in PARAMETERS else value
    return {name: axis_value(name, value) for name, value in whole.items()}


def axis_value(name: str, value: object) -> object:
    """Return a resolved setting as the axis of its name takes it."""
    if name != "friction":
        return value
    assert isinstance(value, tuple)
    return value[0], value[2], value[3]


@dataclass(frozen=True)
class CheckedModel:
    """A model under check.

    Attributes:
        reference: the model as it was asked for, and as sweeps name their scene.
        scenes: the scenes opened so far.
        given: the options `--set`, as typed.
        values: what they set, by axis.
        duration: simulated time of its own run [s].
    """

    reference: str
    scenes: SceneLoader
    given: tuple[str, ...]
    values: Mapping[str, object]
    duration: float

    @property
    def scene(self) -> Scene:
        """The model's scene."""
        return self.scenes.open(self.reference)

    @cached_property
    def resolved(self) -> ResolvedRun:
        """Everything that decides its own run."""
        return self.scene.resolve(self.values, 0, self.duration)

    @property
    def base(self) -> CompiledScene:
        """Its compiled structure."""
        return self.scene.base(self.resolved.structure)

    @cached_property
    def prepared(self) -> PreparedModel:
        """Its model with the options set."""
        return self.base.prepare(self.resolved.edits())

    @property
    def start(self) -> InitialStates:
        """Where its own run starts."""
        return self.scene.starts([self.resolved])

    @cached_property
    def free_masses(self) -> list[float]:
        """Masses of the bodies on free joints, each with all that hangs on it [kg]."""
        setup = make_setup(self.base, None, [self.resolved], [self.prepared.model], {})
        return [float(body.mass[0]) for body in setup.free_bodies]

    @property
    def subject_mass(self) -> float:
        """Mass of the scene's subject [kg], else of its heaviest free body, else 1 kg."""
        subject = self.base.targets.subject
        if subject is not None:
            return float(self.prepared.model.body_mass[subject])
        return max(self.free_masses, default=1.0)

    @property
    def hold_window(self) -> tuple[float, float] | None:
        """From when to when [s] the scene says that something is held, if it does."""
        holding = self.base.holding
        return None if holding is None else holding.window(self.resolved.initial)

    def fits(self, timestep: float, seconds: float) -> bool:
        """Say whether a run of so many seconds [s] at a timestep [s] can be held in memory."""
        return bytes_of_run(self.base.model, round(seconds / timestep)) <= RUN_BYTES

    @property
    def keyframe(self) -> str | None:
        """The keyframe that it starts from; None for its own start."""
        start = self.resolved.keyframe
        return None if start == QPOS0 else start

    def setting(self, name: str) -> Any:  # noqa: ANN401 - settings are of many kinds
        """Return one resolved setting."""
        return self.resolved.settings[name]


def open_model(reference: str, assign: Sequence[str]) -> CheckedModel:
    """Open a model for its checks.

    Args:
        reference: a shipped scene, a folder, a model file or a robot.
        assign: `NAME=VALUE` for axes of the scene, each one value, and for `duration`.

    Raises:
        SceneError: there is no such scene, or it does not compile.
        SweepFileError: an option is wrong; all that are, are named.
    """
    scenes = SceneLoader(Path())
    scene = scenes.open(reference)
    values, duration = read_options(scenes, reference, assign)
    _check_timestep(scene, values)
    return CheckedModel(
        reference=reference,
        scenes=scenes,
        given=tuple(assign),
        values=whole_settings(scene, values),
        duration=scene.duration if duration is None else duration,
    )


def _check_timestep(scene: Scene, values: Mapping[str, object]) -> None:
    """Raise SceneError unless the timestep is one that time can go on by."""
    timestep = scene.resolve(values, 0, None).timestep
    if not 0 < timestep < math.inf:
        raise SceneError(
            f"{scene.source.model}: its timestep is {timestep:g} s; write one above 0 there, "
            "or `--set timestep=`"
        )


Values = Mapping[str, object]
NOMINAL = "run"
"""The store of the model's own run."""


@dataclass(frozen=True)
class CheckRun:
    """A run of the model and its evidence.

    Attributes:
        row: what it was run with, over what is under check.
        values: everything that it was run with.
        store: where its evidence lies.
        record: its record.
    """

    row: Values
    values: Values
    store: Store
    record: EvidenceRecord

    @cached_property
    def trace(self) -> StoredTrace:
        """Its trace."""
        return self.store.trace(self.record)

    @property
    def kept(self) -> bool:
        """Whether it left a trace, however short."""
        return self.record.trace is not None

    @property
    def whole(self) -> bool:
        """Whether it was simulated to its end, without an engine warning."""
        return self.record.status == "ok" and not self.record.warnings


@dataclass
class CheckRunner:
    """Runs a model, and scenes in its stead, for checks.

    Attributes:
        target: the model.
        folder: where the stores go.
        workers: processes.
        begin: told how many runs a store has, and how many of them are done already.
        progress: told of runs as they finish.
        stop: set when runs should end soon; None if they never should.
    """

    target: CheckedModel
    folder: Path
    workers: int
    begin: BeginCallback
    progress: ProgressCallback
    stop: Stop | None = None
    _stores: dict[str, None] = field(default_factory=dict[str, None])

    @cached_property
    def own(self) -> CheckRun:
        """The model's own run, checked twice."""
        return self.run(NOMINAL, "The model as it is", [{}], checks="all")[0]

    @property
    def has_own(self) -> bool:
        """Whether the model's own run was asked for."""
        return NOMINAL in self._stores

    def run(
        self,
        name: str,
        description: str,
        rows: Sequence[Values],
        *,
        duration: float | None = None,
        **keys: Any,  # noqa: ANN401 - keys of a sweep file
    ) -> list[CheckRun]:
        """Run the model with further settings.

        Args:
            name: of the store.
            description: what the runs are for.
            rows: settings of each run, over those under check.
            duration: simulated time [s]; as under check if None.
            keys: further keys of the sweep file.
        """
        target = self.target
        seconds = target.duration if duration is None else duration
        whole = [{**target.values, **row} for row in rows]
        found = self.run_scene(name, description, target.reference, whole, seconds, **keys)
        return [replace(each, row=row) for row, each in zip(rows, found, strict=True)]

    def run_scene(
        self,
        name: str,
        description: str,
        reference: str,
        rows: Sequence[Values],
        duration: float,
        *,
        workers: int | None = None,
        **keys: Any,  # noqa: ANN401 - keys of a sweep file
    ) -> list[CheckRun]:
        """Run any scene; see `run`."""
        text = _sweep(reference, description, rows, {"duration": duration, **keys})
        scenes = self.target.scenes
        read = read_sweep(text, scenes.vocabulary)
        scene = scenes.open(reference)
        ask = SweepRequest(
            plan=read.plan,
            scene=scene,
            name=name,
            source=text,
            overrides=(),
            store=self.folder / name,
            workers=self.workers if workers is None else workers,
            fresh=True,
        )
        run_sweep(ask, self.begin, self.progress, self.stop)
        self._stores[name] = None
        store = Store.open(self.folder / name)
        ids = [scene.run_id(scene.resolve(row, 0, duration)) for row in rows]
        return [
            CheckRun(row, row, store, store.record(run)) for row, run in zip(rows, ids, strict=True)
        ]

    def stores(self, *names: str) -> tuple[str, ...]:
        """Return which of these stores were written."""
        return tuple(name for name in names if name in self._stores)


def _sweep(
    reference: str, description: str, rows: Sequence[Values], keys: Mapping[str, Any]
) -> str:
    """Return a sweep file; JSON is YAML."""
    first, *rest = rows
    sweep = {
        "version": 1,
        "scene": reference,
        "description": description,
        "axes": {name: [value] for name, value in first.items()},
        "include": rest,
        "trace": "all",
        **keys,
    }
    return json.dumps(sweep, indent=1)
