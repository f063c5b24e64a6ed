"""Reads a sweep file into a request: its plan, its scene, and the allowed names."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import starmap
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from contactlab.engines import ENGINES
from contactlab.errors import SceneError
from contactlab.measure import LABELS, METRICS, ORACLES, THRESHOLDS, threshold_values
from contactlab.plan.grid import Plan
from contactlab.plan.overrides import Overrides
from contactlab.plan.starter import starter_text
from contactlab.plan.sweep_file import SweepFile, read_sweep
from contactlab.run.chosen_runs import ChosenRuns
from contactlab.run.tasks import Executor
from contactlab.scene.mujoco_versions import incomplete_axes, why_unsupported
from contactlab.scene.requirements import mistake_in_requirement
from contactlab.scene.scene import Scene
from contactlab.scene.task import check_motion
from contactlab.schema.drive import Drive, drive_text
from contactlab.schema.sweep_schema import effects_base
from contactlab.schema.vocabulary import AxisSpec, Vocabulary
from contactlab.store.control_tables import read_control_table
from contactlab.store.store_files import Address
from contactlab.store.table_layout import RESERVED_COLUMNS

Chooser = Callable[[Plan, NDArray[np.uint64]], ChosenRuns]
"""Makes the chooser of a plan's runs from the plan and the ids (runs) of its runs in order."""
_ORACLE_METRICS = ("oracle_error", "oracle_expected", "oracle_measured")
_NO_ORACLE = "the scene has no oracle"


@dataclass(frozen=True)
class SweepRequest:
    """A sweep to run, from the text of its file and the options that changed it."""

    plan: Plan
    scene: Scene
    name: str
    source: str
    overrides: tuple[str, ...]
    store: Address
    workers: int  # worker processes; 0 to run everything in this process
    fresh: bool = False  # whether to replace an existing store
    # Why runs that only newer engines support are left out of the plan.
    left_out: tuple[str, ...] = ()
    cluster: Executor | None = None  # executor of the jobs, if not this machine's workers
    retry_failed: bool = False
    repair: bool = False
    shard: tuple[int, int] | None = None  # number and count of the shard to run; all if None
    allow_code: bool = False  # whether code of a policy may run; that of environments already has
    choose: Chooser | None = (
        None  # how a study chooses runs by earlier results; by the plan if None
    )


def read_request(  # noqa: PLR0913 - one argument an option
    source: Path | str | Mapping[str, object],
    name: str,
    store: Address,
    *,
    folder: Path,
    workers: int,
    overrides: Overrides | None = None,
    drive: Drive | None = None,
    partly: bool = False,
    allow_code: bool = False,
) -> SweepRequest:
    """Read a sweep: a file by its path or its text, or its content as data.

    Relative paths of scenes start in the folder. `drive` and `allow_code` are as in `SceneLoader`.
    With `partly`, runs that only newer engines support are omitted instead of refused. Raises a
    SweepFileError that lists all mistakes of the file or the overrides.
    """
    options = overrides or Overrides()
    written_here = isinstance(source, Mapping)
    scenes = SceneLoader(folder, drive, allow_code=allow_code, written_here=written_here)
    sweep_file = read_sweep(source, partial(scenes.vocabulary, lenient=partly), options)
    scene, plan = scenes.for_sweep(sweep_file)
    plan, reasons = supported_plan(plan)
    options_text = [f"--set {assignment}" for assignment in options.assign]
    options_text += [f"--where {condition}" for condition in options.where]
    options_text += [] if options.limit is None else [f"--limit {options.limit}"]
    options_text += [] if drive is None else [f"--drive {drive_text(drive)}"]
    return SweepRequest(
        plan=plan,
        scene=scene,
        name=name,
        source=sweep_file.text,
        overrides=tuple(options_text),
        store=store,
        workers=workers,
        left_out=reasons,
    )


def supported_plan(plan: Plan) -> tuple[Plan, tuple[str, ...]]:
    """Return a plan without rows that this engine does not support, and the distinct reasons."""
    concerned = incomplete_axes().intersection(plan.grid.names)
    axis_settings = ((name, value) for name in concerned for value in plan.grid.axis_values(name))
    if not any(starmap(why_unsupported, axis_settings)):
        return plan, ()
    rows = list(plan.grid.iterate_rows())
    reasons = [next(filter(None, starmap(why_unsupported, row.items())), None) for row in rows]
    supported_rows = tuple(row for row, reason in zip(rows, reasons, strict=True) if reason is None)
    grid = replace(
        plan.grid, base={}, blocks=None, excludes=(), included_rows=supported_rows, baseline_rows=()
    )
    count = min(plan.count, len(supported_rows) * len(plan.sweep.seed_values))
    distinct = dict.fromkeys(filter(None, reasons))
    return replace(plan, grid=grid, count=count), tuple(distinct)


@dataclass
class SceneLoader:
    """Opens the scene of a sweep once."""

    # Base of relative paths of scenes and of files of drives: the folder of the sweep.
    folder: Path | None
    drive: Drive | None = None  # drive of an option, which overrides sweep and scene
    drive_folder: Path = Path()  # base of relative paths in `drive`
    allow_code: bool = False  # whether the code of environments may run
    written_here: bool = False  # whether the caller wrote the sweep, and no file names its drive
    _scenes: dict[str, Scene] = field(default_factory=dict[str, Scene])
    _driven: dict[str, Scene] = field(default_factory=dict[str, Scene])

    def open(self, reference: str) -> Scene:
        """Return the scene with the drive of the option, or otherwise with its own."""
        if reference not in self._driven:
            scene = self._open_undriven(reference)
            # A model without a manifest decides its own drive.
            bare = "auto" if scene.source.manifest is None else None
            self._driven[reference] = scene.with_drive(
                self.drive or bare, self.drive_folder, named_by_user=True
            )
        return self._driven[reference]

    def _open_undriven(self, reference: str) -> Scene:
        if reference not in self._scenes:
            tables, allowed = read_control_table, self.allow_code
            scene = Scene.open(reference, self.folder, ENGINES, tables, allow_code=allowed)
            # A scene's own names differ from those of columns; it names known metrics and oracles.
            clashes = set(scene.catalogue.names) & (RESERVED_COLUMNS | set(METRICS))
            if clashes:
                raise SceneError(
                    f"scene '{scene.name}' offers axes named {', '.join(sorted(clashes))}, "
                    "which are already columns of the table; rename them in its manifest"
                )
            manifest = scene.source.manifest
            if manifest is not None:
                threshold_values(manifest.thresholds)
                for name in manifest.tolerances:
                    SceneError.unless_known(name, METRICS, f"no metric '{name}'")
                if oracle := manifest.oracle:
                    SceneError.unless_known(oracle.name, ORACLES, f"no oracle '{oracle.name}'")
            with scene.source.named_in_errors():
                check_motion(scene.base({}).model)
            self._scenes[reference] = scene
        return self._scenes[reference]

    def _open_driven(self, reference: str, drive: Drive) -> Scene:
        key = f"{reference} {drive!r}"
        if key not in self._driven:
            self._driven[key] = self._open_undriven(reference).with_drive(
                drive, self.folder or Path(), named_by_user=self.written_here
            )
        return self._driven[key]

    def for_sweep(self, sweep_file: SweepFile) -> tuple[Scene, Plan]:
        """Return the scene of a sweep, and the sweep's plan with the hash of its drive."""
        sweep = sweep_file.sweep
        if sweep.drive is not None and self.drive is None:
            scene = self._open_driven(sweep.scene, sweep.drive)
        else:
            scene = self.open(sweep.scene)
        # The manifest's drive is already in the scene's own copy.
        own = self._open_undriven(sweep.scene).drive
        drive = None if scene.drive == own else scene.drive.drive
        located = sweep_file.plan.sweep.model_copy(update={"drive": drive})
        return scene.with_effects(effects_base(sweep.effects)), replace(
            sweep_file.plan, sweep=located
        )

    def vocabulary(self, reference: str, *, lenient: bool = False) -> Vocabulary:
        """Return every name that a sweep of the scene may use; lenient, also of newer versions."""
        scene = self._open_undriven(reference)
        reserved_names = RESERVED_COLUMNS | set(METRICS)

        @cache  # it is called for each value
        def find_axis(name: str) -> AxisSpec | None:
            # Columns and coordinates may share a name, which then means the column.
            if name in reserved_names and scene.catalogue.sets_start(name):
                return None
            return scene.catalogue.find_axis(name, lenient=lenient)

        def describe_name(name: str) -> str:
            if name in METRICS:
                return METRICS[name].definition
            axis = find_axis(name)
            return axis.description if axis else ""

        def broken(text: str, duration: float | None) -> str | None:
            most = duration or self.open(reference).duration
            return mistake_in_requirement(text, scene.base({}), scene.source.manifest, most)

        def check_drive(drive: Drive) -> SceneError | None:
            try:
                _ = self.drive or self._open_driven(reference, drive)
            except SceneError as error:
                return error
            return None

        manifest = scene.source.manifest
        return Vocabulary(
            scene.catalogue.names,
            find_axis,
            [*METRICS],
            [*LABELS],
            [*THRESHOLDS],
            units={name: entry.unit for name, entry in (*METRICS.items(), *THRESHOLDS.items())},
            lacking={}
            if manifest and manifest.oracle
            else dict.fromkeys(_ORACLE_METRICS, _NO_ORACLE),
            asks=bool(manifest and manifest.must),
            mistake_in_requirement=broken,
            mistake_in_drive=check_drive,
            describe=describe_name,
            coordinates=[
                name for name in scene.catalogue.coordinate_names if name not in reserved_names
            ],
        )


def starter_sweep(reference: str, loader: SceneLoader) -> str:
    """Return the text of a small sweep file to start from, around a scene's own values."""
    scene = loader.open(reference)
    base = scene.base({})
    step = base.settings["timestep"]
    if not isinstance(step, float) or not 0 < step < math.inf:
        raise SceneError(f"{scene.source.model}: its timestep is {step} s; write one above 0 there")
    shared = {name: base.settings[name] for name in base.settings.keys() - base.nonuniform}
    drive = "auto" if scene.source.manifest is None else None
    return starter_text(reference, shared, scene.duration, drive, loader.vocabulary(reference))
