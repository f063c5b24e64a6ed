"""A scene ready for its runs: derives settings, model and initial state from a run's values."""

import copy
import hashlib
import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from types import MappingProxyType

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import RecordedControls
from contactlab.contact.trace_setup import RecordedMotion
from contactlab.errors import SceneError, UnheldWarning
from contactlab.scene.axis_catalogue import Engines, SceneCatalogue
from contactlab.scene.compile_model import compile_model, name_sensors, warn_once
from contactlab.scene.compiled_scene import (
    CompiledScene,
    PreparedModel,
    find_detected,
    full_structure,
    open_structure,
)
from contactlab.scene.contact_pairs import MonitoredPair
from contactlab.scene.drive.driving import Driving, is_driven
from contactlab.scene.drive.located_drive import (
    DRIVE_AXES,
    LocatedDrive,
    drive_settings,
    locate_drive,
    with_values,
)
from contactlab.scene.drive.recorded import RecordedTable, TableReader
from contactlab.scene.effects.effect import EffectRequest
from contactlab.scene.effects.effect_table import left_uncompiled, remove_from_spec
from contactlab.scene.initial_states import (
    InitialStateRule,
    InitialStates,
    initial_states,
    joint_directions,
    nudged_states,
)
from contactlab.scene.mujoco_versions import missing_flags
from contactlab.scene.recording import RecordedRuns
from contactlab.scene.requirements import check_requirements
from contactlab.scene.run_spec import (
    START_SETTINGS,
    RunSpec,
    resolve_variant,
    run_ids,
    write_axes,
)
from contactlab.scene.scene_source import SceneSource, find_scene
from contactlab.scene.task import infer_drive, infer_task
from contactlab.scene.variants import AS_WRITTEN
from contactlab.schema.drive import (
    Drive,
    FileDrive,
    PolicyDrive,
    drive_identity,
)
from contactlab.schema.setting_values import Settings, as_number
from contactlab.schema.task import QPOS0, SEEDS, Task
from contactlab.schema.vocabulary import RECORDED_RUN, VARIANT

_NO_ENGINES: Engines = MappingProxyType({})


class Scene:
    """A scene with its axes, its drive without values of its axes, and its compiled structures.

    `switched` are the effects that it switches itself, `lacking` the flags that this version of
    MuJoCo lacks. If `auto`, effects that provably change nothing are left out unless a sweep
    requests them. Its runs take `duration` [s] unless a sweep sets another.
    """

    def __init__(
        self, source: SceneSource, engines: Engines = _NO_ENGINES, tables: TableReader | None = None
    ) -> None:
        """Compile a scene as its manifest has it, for MuJoCo alone unless `engines` lists others.

        Without a reader of tables, drives that need one are refused. A SceneError says that it does
        not compile, or that its manifest does not fit the model.
        """
        self.source, self._engines, self._tables = source, engines, tables
        self._compiled: dict[tuple[tuple[object, ...], frozenset[str]], CompiledScene] = {}
        self._written: dict[tuple[tuple[object, ...], frozenset[str]], mujoco.MjModel] = {}
        self._rules: dict[str, InitialStateRule] = {}
        self._driving: dict[tuple[str, Drive], Driving] = {}
        manifest, base = source.manifest, self.base({})
        with source.named_in_errors():
            self.recorded = self._recorded_in(base)
            self._structure = full_structure(manifest, {})
            entries = manifest.initial.items() if manifest else ()
            self._initial = {name: as_number(entry.default) for name, entry in entries}
            if self.recorded:
                self._initial[RECORDED_RUN] = as_number(self.recorded.numbers[0])
            runs = self.recorded.numbers if self.recorded else ()
            self.catalogue = SceneCatalogue(base, manifest, engines, runs)
            if manifest:
                check_requirements(base, manifest)
            self.switched = self.catalogue.switched_effects(manifest)
            written_drive = locate_drive(manifest.drive if manifest else "none", source.path.parent)
        self.lacking = missing_flags()
        # A model without a manifest keeps all effects as written.
        self.auto = manifest is not None and manifest.effects.get("base", "auto") == "auto"
        self._set_drive(written_drive)
        self.initial_states([self.resolve({}, 0, None)])

    @classmethod
    def open(
        cls,
        reference: str,
        folder: Path | None = None,
        engines: Engines = _NO_ENGINES,
        tables: TableReader | None = None,
        *,
        allow_code: bool = False,
    ) -> "Scene":
        """Find and compile the scene of a reference; relative paths start in a folder.

        A SceneError says that it does not exist, does not compile, or contains code that is not
        allowed.
        """
        return cls(find_scene(reference, folder, allow_code=allow_code), engines, tables)

    @property
    def name(self) -> str:
        """The scene's name."""
        return self.source.name

    @property
    def hash(self) -> str:
        """Hash of the scene's files."""
        return self.source.content.hash

    def with_effects(self, rest: str | None) -> "Scene":
        """Return the scene with another rule for effects that are not requested by name.

        `auto` leaves out effects that provably change nothing, `all` leaves out none, and None
        keeps the scene's own rule.
        """
        scene = copy.copy(self)
        scene.auto = self.auto if rest is None else rest == "auto"
        return scene

    def with_drive(
        self, drive: Drive | None, folder: Path, *, named_by_user: bool = False
    ) -> "Scene":
        """Return the scene with another drive, if any; its relative paths start in a folder.

        A SceneError says that the drive does not fit the model, or names a missing file.
        """
        if drive is None:
            return self
        scene = copy.copy(self)
        scene._set_drive(locate_drive(drive, folder, named_by_user=named_by_user))
        return scene

    def _recorded_in(self, base: CompiledScene) -> RecordedRuns | None:
        """Return the scene's recorded runs, if any, in the coordinates of a structure."""
        entry = self.source.manifest and self.source.manifest.recording
        if entry is None:
            return None
        if self._tables is None:
            raise SceneError(f"{entry.file}: recordings cannot be read here")
        columns = self._tables(self.source.path.parent / entry.file)
        return RecordedRuns(base.model, entry, RecordedTable(entry.file, columns))

    def _default_duration(self, initial: Mapping[str, float]) -> float:
        """Return the default duration of a run with some initial values [s]."""
        if self.recorded is None:
            return self.duration
        return min(self.duration, self.recorded.duration_of(initial[RECORDED_RUN]))

    def _set_drive(self, drive: LocatedDrive) -> None:
        requested, model, manifest = drive.drive, self.base({}).model, self.source.manifest
        if isinstance(requested, PolicyDrive) and not model.nu:
            raise SceneError(
                f"{self.source.model}: the model has no actuators for a policy to control"
            )
        self.drive = LocatedDrive("none") if requested == "hold" and not model.nu else drive
        self._table = None
        if isinstance(requested, FileDrive):
            (file,) = drive.files
            if self._tables is None:
                raise SceneError(f"{file.name}: tables of controls cannot be read here")
            self._table = RecordedTable(file.name, self._tables(file))
        end = self._table and self._table.end
        inferred = infer_task(
            model, start=str(self.base({}).settings.get("keyframe", QPOS0)), drive=requested
        )
        declared = manifest.duration if manifest else end
        self.duration = declared or inferred.duration
        with self.source.named_in_errors():
            run = self.resolve({}, 0, None)
            driving = self._driving_of(run) if is_driven(run.drive) else None
        if driving and not self.source.content.copied and (unheld := driving.unheld_joints(run)):
            warn_once(self.source, f"not held: {unheld}", UnheldWarning)

    def task(
        self,
        values: Mapping[str, object],
        duration: float | None = None,
        *,
        watch: Sequence[str] = (),
        within: tuple[float, str] | None = None,
        seeds: Sequence[int] = SEEDS,
    ) -> Task:
        """Return the task of runs with some values.

        A SceneError names a body that the scene lacks.
        """
        run = self.resolve(values, 0, duration)
        with self.source.named_in_errors():
            return infer_task(
                self.base(run.structure).model,
                start=run.keyframe,
                drive=run.drive,
                duration=run.duration,
                watch=watch,
                within=within,
                seeds=seeds,
                programmed=bool(self.source.manifest and self.source.manifest.control),
            )

    def base(
        self, structure: Mapping[str, object], without: frozenset[str] = frozenset()
    ) -> CompiledScene:
        """Return the compiled scene for structure values; missing ones are the scene's defaults."""
        full = full_structure(self.source.manifest, structure)
        key = tuple(full.values()), without
        if key not in self._compiled:
            self._compiled[key] = open_structure(self.source, full, without)
        return self._compiled[key]

    def find_detected(self) -> Mapping[tuple[object, ...], tuple[MonitoredPair, ...]]:
        """Return the detected pairs of the structure without values, for `share_detected`."""
        return find_detected(self.source, full_structure(self.source.manifest, {}))

    def written_model(self, run: RunSpec) -> mujoco.MjModel:
        """Return the compiled structure of a run without the recording sensors; never edit it."""

        def edit(spec: mujoco.MjSpec) -> None:
            name_sensors(spec)
            remove_from_spec(spec, run.without)

        key = tuple(run.structure.values()), run.without
        if key not in self._written:
            self._written[key] = compile_model(self.source, run.structure, edit)
        return self._written[key]

    def base_of(self, run: RunSpec) -> CompiledScene:
        """Return the compiled scene that a run's model is based on."""
        return self.base(run.structure, run.without)

    def resolve(self, values: Mapping[str, object], seed: int, duration: float | None) -> RunSpec:
        """Return everything that decides a run, from canonical values of axes by name.

        Without a duration [s], the scene's own is used.
        """
        structure, initial = dict(self._structure), dict(self._initial)
        driving: dict[str, object] = {}
        of_model: dict[str, object] = {}
        for axis, value in {**self.switched, **values}.items():
            if axis in structure:
                number = as_number(value)
                structure[axis] = int(number) if isinstance(structure[axis], int) else number
            elif axis in initial or self.catalogue.sets_start(axis):
                initial[axis] = as_number(value)
            elif axis in DRIVE_AXES:
                driving[axis] = value
            elif axis not in self.lacking:
                # A version without a flag behaves as with its default, the only accepted value.
                of_model[axis] = value
        variant = str(of_model.pop(VARIANT, AS_WRITTEN))
        base, drive = self.base(structure), with_values(self.drive.drive, driving)
        settings, flags = Settings(base.settings), dict(base.flags)
        settings.update(drive_settings(drive))
        changed, requested = write_axes(settings, flags, of_model)
        if drive == "auto":
            drive = infer_drive(base.model, str(settings.get("keyframe", QPOS0)))
        engine = self._engines.get(str(settings["engine"]))
        if isinstance(drive, PolicyDrive):
            # A policy may read sensors that no metric reads.
            requested.setdefault("sensor", True)
        auto = self.auto and (engine is None or engine.omits_unused_effects)
        request = EffectRequest(requested, frozenset(changed), auto)
        run = RunSpec(
            structure=structure,
            settings=settings,
            changed_settings=frozenset(changed),
            flags=flags,
            initial=initial,
            seed=seed,
            duration=self._default_duration(initial) if duration is None else duration,
            effect_request=request,
            without=left_uncompiled(base.facts, request),
            drive=drive,
        )
        return run if variant == AS_WRITTEN else resolve_variant(base, run, variant)

    def resolve_seeds(
        self, values: Mapping[str, object], seeds: Sequence[int], duration: float | None
    ) -> list[RunSpec]:
        """Return the runs of canonical values of axes, one for each seed, resolved once."""
        run = self.resolve(values, seeds[0], duration)
        return [replace(run, seed=seed) for seed in seeds]

    def resolve_as_written(self, run: RunSpec, scenario: Collection[str]) -> RunSpec:
        """Return the run of the scene as written, with the scenario and start of a planned run.

        It keeps the axes of the scenario, and those that decide the bodies, the start, the drive
        and the engine.
        """
        kept_axes = {
            "engine",
            *scenario,
            *run.structure,
            *run.initial,
            *START_SETTINGS,
            *DRIVE_AXES,
        }
        values = {name: value for name, value in run.axes.items() if name in kept_axes}
        return self.resolve(values, run.seed, run.duration)

    def run_id(self, run: RunSpec) -> str:
        """Return a hash of scene content, settings, seed and duration, but not of the engine.

        Runs that resolve to the same model and initial state have the same id.
        """
        return next(run_ids(self.base(run.structure), run, self.hash, [run.seed]))

    def plan_runs(
        self,
        values: Mapping[str, object],
        seeds: Sequence[int],
        duration: float | None,
        first: int = 0,
    ) -> Iterator[RunSpec]:
        """Yield the runs of canonical values of axes, one for each seed, with their ids.

        The first has the index `first` in the plan. Equal runs of a plan have equal ids.
        """
        run, ids = self.resolve_with_ids(values, seeds, duration)
        for index, (seed, run_id) in enumerate(zip(seeds, ids, strict=True), first):
            yield run.with_seed(values, seed, run_id, index)

    def resolve_with_ids(
        self, values: Mapping[str, object], seeds: Sequence[int], duration: float | None
    ) -> tuple[RunSpec, Iterator[str]]:
        """Return the common part of the runs of `planned`, and their ids."""
        run = self.resolve(values, seeds[0], duration)
        return run, run_ids(self.base(run.structure), run, self.hash, seeds)

    def initial_states(self, runs: Sequence[RunSpec]) -> InitialStates:
        """Return the initial states of runs of one structure.

        Raises a SceneError if a drive is wrong.
        """
        groups = [list(group) for _, group in groupby(runs, lambda run: (run.keyframe, run.drive))]
        with self.source.named_in_errors():
            starts = InitialStates.concatenate([self._group_starts(group) for group in groups])
        if any(run.joint_speed for run in runs):
            model = self.base(runs[0].structure).model
            added = [run.joint_speed * joint_directions(model, run.seed) for run in runs]
            starts = starts._replace(qvel=starts.qvel + added)
        if not isinstance(self.drive.drive, PolicyDrive):
            return starts
        # The policy's controls are not known yet: these apply until the policy acts.
        return starts.with_recorded_inputs(
            [RecordedControls(np.zeros(1), row[None]) for row in starts.ctrl]
        )

    def _group_starts(self, runs: Sequence[RunSpec]) -> InitialStates:
        if is_driven(runs[0].drive):
            return self._driving_of(runs[0]).with_start_inputs(runs)
        return initial_states(self._initial_state_rule(runs[0]), [run.start for run in runs])

    def recorded_motion(self, runs: Sequence[RunSpec]) -> RecordedMotion | None:
        """Return the recorded motion of runs of one structure; None without a recording."""
        recorded = self._initial_state_rule(runs[0]).recorded
        return recorded and recorded.recorded_motion([run.initial[RECORDED_RUN] for run in runs])

    def nudged_states(self, starts: InitialStates, runs: Sequence[RunSpec]) -> InitialStates:
        """Return initial states moved by up to 1e-6 m or rad, by each run's seed."""
        return nudged_states(self._initial_state_rule(runs[0]), starts, [run.seed for run in runs])

    @property
    def is_timed(self) -> bool:
        """Whether anything in the scene depends on time: control, or a hold."""
        manifest = self.source.manifest
        return manifest is not None and bool(manifest.control or manifest.hold)

    def check_start(self, run: RunSpec) -> None:
        """Compute the time-dependent inputs of a run, so that mistakes show before it starts.

        A SceneError says that times decrease, that a hold is empty, or that a drive does not fit.
        """
        self.initial_states([run])
        if holding := self.base(run.structure).holding:
            with self.source.named_in_errors():
                holding.hold_window(run.initial)

    def _driving_of(self, run: RunSpec) -> Driving:
        key = self._start_key(run), run.drive
        if key not in self._driving:
            model = self.base(run.structure).model
            self._driving[key] = Driving(
                model, run.drive, self._initial_state_rule(run), self._table
            )
        return self._driving[key]

    def _initial_state_rule(self, run: RunSpec) -> InitialStateRule:
        acts = isinstance(run.drive, PolicyDrive)
        key = f"{self._start_key(run)}{acts}"
        if key not in self._rules:
            base, manifest = self.base(run.structure), self.source.manifest
            recorded = self.recorded if base is self.base({}) else self._recorded_in(base)
            rule = InitialStateRule.from_model(base.model, manifest, run.keyframe)
            if acts:
                rule = rule.start_off_rest(base.model)
            self._rules[key] = replace(rule, recorded=recorded)
        return self._rules[key]

    def _start_key(self, run: RunSpec) -> str:
        return json.dumps([run.structure, run.keyframe], sort_keys=True)

    def prepare(
        self, run: RunSpec, start: InitialStates, compiled: mujoco.MjModel | None = None
    ) -> PreparedModel:
        """Return a run's model for its start (n is 1), without effects that it does not need.

        It is based on the result of `written_model`, if that is passed.
        """
        base = self.base_of(run)
        base = base if compiled is None else replace(base, model=compiled)
        load = self._driving_of(run).find_load(run) if is_driven(run.drive) else None
        return base.prepare(run.list_edits(), run.effect_request, start, load)

    def model_key(self, run: RunSpec) -> str:
        """Return a hash that runs share if their models are the same for similar starts.

        Starts are similar if `is_straight` is the same for them.
        """
        drive = drive_identity(run.drive)
        held_state = run.initial if run.drive == "hold" else {}
        edits, without = run.list_edits(), sorted(run.without)
        key = json.dumps([run.structure, without, edits, drive, held_state])
        return hashlib.sha256(key.encode()).hexdigest()
