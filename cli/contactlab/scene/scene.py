"""A scene ready for its runs: from a run's values to settings, model and initial state."""

import copy
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from types import MappingProxyType

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import RecordedControls
from contactlab.errors import SceneError, UnheldWarning
from contactlab.scene.axis_catalogue import Engines, SceneCatalogue
from contactlab.scene.compile_model import compile_model, warn_once
from contactlab.scene.compiled_scene import (
    CompiledScene,
    PreparedModel,
    compile_scene,
    full_structure,
)
from contactlab.scene.drive.driving import Driving, is_driven
from contactlab.scene.drive.hold import Servos
from contactlab.scene.drive.located_drive import LocatedDrive, locate
from contactlab.scene.drive.recorded import DriveTable, TableReader
from contactlab.scene.drive.signals import exercise_duration
from contactlab.scene.effects.effect_choice import is_straight, remove
from contactlab.scene.initial_states import (
    InitialStateRule,
    InitialStates,
    initial_states,
    joint_directions,
    nudged_states,
)
from contactlab.scene.mujoco_versions import missing_flags
from contactlab.scene.resolution import (
    BARE_DURATION,
    ResolvedRun,
    RunIdentity,
    RunResolver,
    switched_by,
)
from contactlab.scene.row_resolution import RowResolver
from contactlab.scene.scene_source import SceneSource, find_scene
from contactlab.schema.drive import Drive, FileDrive, PolicyDrive, drive_identity

_NO_ENGINES: Engines = MappingProxyType({})


class Scene:
    """A scene with its axes, what drives it but for their values, and what was compiled so far."""

    def __init__(
        self, source: SceneSource, engines: Engines = _NO_ENGINES, tables: TableReader | None = None
    ) -> None:
        """Compile a scene as its manifest has it, for MuJoCo alone unless engines are given.

        Without a reader of tables, drives that need one are refused.

        Raises:
            SceneError: it does not compile, or its manifest does not fit the model.
        """
        self.source = source
        self._tables = tables
        self._compiled: dict[tuple[str, frozenset[str]], CompiledScene] = {}
        manifest, base = source.manifest, self.base({})
        with source.named_in_errors():
            self.catalogue = SceneCatalogue(base, manifest, engines)
            switched = switched_by(manifest, self.catalogue)
            written = locate(manifest.drive if manifest else "none", source.path.parent)
        # A bare model is taken as it is written.
        auto = manifest is not None and manifest.effects.get("base", "auto") == "auto"
        self.resolver = RunResolver(manifest, self.base, switched, missing_flags(), engines, auto)
        self._drive_by(written)
        self.starts([self.resolve({}, 0, None)])

    @classmethod
    def open(
        cls,
        reference: str,
        folder: Path | None = None,
        engines: Engines = _NO_ENGINES,
        tables: TableReader | None = None,
    ) -> "Scene":
        """Find and compile the scene that a sweep names, relative paths starting in a folder.

        Raises:
            SceneError: there is no such scene, or it does not compile.
        """
        return cls(find_scene(reference, folder), engines, tables)

    @property
    def name(self) -> str:
        """The scene's name."""
        return self.source.name

    @property
    def hash(self) -> str:
        """Hash of the scene's files."""
        return self.source.content.hash

    @property
    def duration(self) -> float:
        """The scene's own duration [s]."""
        return self.resolver.duration

    def with_effects(self, rest: str | None) -> "Scene":
        """Return the scene with another rule for effects that are not requested by name.

        Args:
            rest: `auto` leaves out what provably changes nothing, `all` nothing; None for the
                scene's own rule.
        """
        if rest is None or (rest == "auto") == self.resolver.auto:
            return self
        scene = copy.copy(self)
        scene.resolver = replace(self.resolver, auto=rest == "auto")
        return scene

    def with_drive(self, drive: Drive | None, folder: Path) -> "Scene":
        """Return the scene with another drive, if any, whose relative paths start in a folder.

        Raises:
            SceneError: a file of the drive is missing, or the drive does not fit the model.
        """
        if drive is None:
            return self
        scene = copy.copy(self)
        scene._drive_by(locate(drive, folder))
        return scene

    def _drive_by(self, drive: LocatedDrive) -> None:
        if isinstance(drive.drive, PolicyDrive) and not self.base({}).model.nu:
            raise SceneError(
                f"{self.source.model}: the model has no actuators for a policy to control"
            )
        asked = drive.drive
        if asked == "hold" and not self.base({}).model.nu:
            drive = LocatedDrive("none")
        table = None
        if isinstance(drive.drive, FileDrive):
            if self._tables is None:
                raise SceneError(f"{drive.drive.file}: tables of controls cannot be read here")
            table = DriveTable(drive.files[0].name, self._tables(drive.files[0]))
        duration = table.end if table and table.end else BARE_DURATION
        if drive.drive == "exercise":
            duration = exercise_duration(self.base({}).model)
        self.drive = drive
        self.resolver = replace(self.resolver, drive=drive.drive, bare_duration=duration)
        self.initial = InitialStateMaker(self, table)
        with self.source.named_in_errors():
            unheld = self.initial.unheld(replace(self.resolve({}, 0, None), drive=asked))
        if unheld:
            warn_once(self.source, f"not held: {unheld}", UnheldWarning)

    def base(
        self, structure: Mapping[str, object], without: frozenset[str] = frozenset()
    ) -> CompiledScene:
        """Return the compiled scene of the given structure values, over the scene's defaults."""
        full = full_structure(self.source.manifest, structure)
        key = json.dumps(full, sort_keys=True), without
        if key not in self._compiled:
            self._compiled[key] = compile_scene(self.source, full, without)
        return self._compiled[key]

    def base_of(self, run: ResolvedRun) -> CompiledScene:
        """Return the compiled scene that a run's model is made from."""
        return self.base(run.structure, run.without)

    def resolve(
        self, values: Mapping[str, object], seed: int, duration: float | None
    ) -> ResolvedRun:
        """Return everything that decides a run; see `RunResolver.resolve`."""
        return self.resolver.resolve(values, seed, duration)

    def rows(self, duration: float | None) -> RowResolver:
        """Return a resolver of rows of a duration [s], or the scene's; faster than `resolve`."""
        return RowResolver(self.resolver, self.hash, duration)

    def run_id(self, run: ResolvedRun) -> str:
        """Return a hash of scene content, settings, seed and duration, but not of the engine.

        Runs that are resolved to the same model and initial state have the same one.
        """
        identity = RunIdentity(self.base(run.structure), run, self.hash)
        return identity.digests([], [run.seed]).hex()

    def starts(self, runs: Sequence[ResolvedRun]) -> InitialStates:
        """Return the initial states of runs of one structure."""
        starts = self.initial.states(runs)
        if not isinstance(self.drive.drive, PolicyDrive):
            return starts
        # Driven, but nobody knows how: these are the controls until the policy acts.
        return starts.acted_on([RecordedControls(np.zeros(1), row[None]) for row in starts.ctrl])

    def prepare(self, run: ResolvedRun, start: InitialStates) -> PreparedModel:
        """Return a run's model, given its start (n = 1), without effects that it does not need."""
        servos = self.initial.servos(run)
        return self.base_of(run).prepare(run.edits(), run.effect_request, start, servos)

    def model_key(self, run: ResolvedRun, start: InitialStates) -> str:
        """Return a key that runs share if their models are the same."""
        straight = is_straight(self.base_of(run).model, start)
        drive = drive_identity(run.drive)
        return json.dumps([run.structure, sorted(run.without), run.edits(), straight, drive])


def stored_drive(scene: Scene, drive: Drive | None, folder: Path) -> Scene:
    """Return a stored scene with the drive of its sweep, if any, from the folder of the scenes."""
    place = LocatedDrive("none" if drive is None else drive).hash or ""
    return scene.with_drive(drive, folder / place)


class InitialStateMaker:
    """Makes the initial states of a scene's runs."""

    def __init__(self, scene: Scene, table: DriveTable | None) -> None:
        self._source = scene.source
        self._base = scene.base
        self._table = table
        self._rules: dict[str, InitialStateRule] = {}
        self._driving: dict[tuple[str, Drive], Driving] = {}

    def states(self, runs: Sequence[ResolvedRun]) -> InitialStates:
        """Return the initial states of runs of one structure.

        Raises:
            SceneError: a run does not suit its drive.
        """
        groups = [list(each) for _, each in groupby(runs, lambda run: (run.keyframe, run.drive))]
        with self._source.named_in_errors():
            starts = InitialStates.joined([self._states(group) for group in groups])
        if not any(run.joint_speed for run in runs):
            return starts
        model = self._base(runs[0].structure).model
        added = [run.joint_speed * joint_directions(model, run.seed) for run in runs]
        return starts._replace(qvel=starts.qvel + added)

    def _states(self, runs: Sequence[ResolvedRun]) -> InitialStates:
        if is_driven(runs[0].drive):
            return self._driving_of(runs[0]).starts(runs)
        return initial_states(self._rule(runs[0]), [(run.initial, run.seed) for run in runs])

    def servos(self, run: ResolvedRun) -> Servos | None:
        """Return the springs that a run's drive adds to actuators, if any."""
        return self._driving_of(run).servos if is_driven(run.drive) else None

    def unheld(self, run: ResolvedRun) -> str:
        """Return what a run's drive should hold and does not; empty where it holds all."""
        return self._driving_of(run).unheld(run) if is_driven(run.drive) else ""

    def _driving_of(self, run: ResolvedRun) -> Driving:
        key = json.dumps([run.structure, run.keyframe], sort_keys=True), run.drive
        if key not in self._driving:
            model = self._base(run.structure).model
            self._driving[key] = Driving.of(model, run.drive, self._rule(run), self._table)
        return self._driving[key]

    def nudged(self, starts: InitialStates, runs: Sequence[ResolvedRun]) -> InitialStates:
        """Return initial states moved by up to 1e-6 m or rad, by each run's seed."""
        return nudged_states(self._rule(runs[0]), starts, [run.seed for run in runs])

    @property
    def is_timed(self) -> bool:
        """Whether the scene has anything that depends on time: control, or a hold."""
        manifest = self._source.manifest
        return manifest is not None and bool(manifest.control or manifest.hold)

    def check(self, run: ResolvedRun) -> None:
        """Compute what depends on time in a run, so that mistakes show before it starts.

        Raises:
            SceneError: times of its control decrease, the window of its hold is empty, or the run
                does not suit its drive.
        """
        self.states([run])
        holding = self._base(run.structure).holding
        with self._source.named_in_errors():
            if holding is not None:
                holding.window(run.initial)

    def _rule(self, run: ResolvedRun) -> InitialStateRule:
        key = json.dumps([run.structure, run.keyframe], sort_keys=True)
        if key not in self._rules:
            model = self._base(run.structure).model
            self._rules[key] = InitialStateRule.of(model, self._source.manifest, run.keyframe)
        return self._rules[key]


def compile_without_sensors(scene: Scene, run: ResolvedRun) -> mujoco.MjModel:
    """Compile the structure of a run without the sensors that record."""
    return compile_model(scene.source, run.structure, lambda spec: remove(spec, run.without))


def prepare_without_sensors(
    scene: Scene, run: ResolvedRun, start: InitialStates, compiled: mujoco.MjModel
) -> mujoco.MjModel:
    """Return a run's model, made of what `compile_without_sensors` returned."""
    base = replace(scene.base_of(run), model=compiled)
    servos = scene.initial.servos(run)
    return base.prepare(run.edits(), run.effect_request, start, servos).model
