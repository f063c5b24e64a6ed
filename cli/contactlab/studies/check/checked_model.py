"""The model under check, with its settings and initial state, and its runs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from contactlab.engines import ChecksRuns, find_engine
from contactlab.errors import SceneError, SweepFileError
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.compiled_scene import CompiledScene, PreparedModel
from contactlab.scene.initial_states import QPOS0
from contactlab.scene.model_options import MODEL_ENGINE
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.resolution import ResolvedRun
from contactlab.scene.run_setup import actuated_limbs, make_setup
from contactlab.scene.scene import Scene
from contactlab.scene.setting_values import Settings
from contactlab.schema.check_report import TaskKind
from contactlab.schema.drive import Drive
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store
from contactlab.store.mcap.stored_trace import StoredTrace
from contactlab.studies.check.check_results import DEFAULT_LIMITS, Limits
from contactlab.studies.session import Values, read_settings

_WALKING = 2
"""Number of actuated limbs from which a free body is taken to walk."""


def axis_value(name: str, value: object) -> object:
    """Return a resolved setting in the form that its axis takes."""
    if name != "friction":
        return value
    assert isinstance(value, tuple)
    return value[0], value[2], value[3]


@dataclass(frozen=True)
class CheckedModel:
    """A model under check.

    Attributes:
        reference: the model as requested, and as sweeps name their scene.
        given: the settings as requested, `NAME=VALUE` each.
        values: the same settings, by axis.
        duration: simulated time of its nominal run [s].
        drive: what drives it; the scene's own if None.
        kind_reason: why it is for that kind of task, in words.
    """

    reference: str
    scenes: SceneLoader
    given: tuple[str, ...]
    values: Mapping[str, object]
    duration: float
    drive: Drive | None
    limits: Limits
    kind: TaskKind
    kind_reason: str

    def changed(self, settings: Values) -> "CheckedModel":
        """Return the model with more settings."""
        return replace(self, values={**self.values, **settings})

    @cached_property
    def scene(self) -> Scene:
        """The model's scene, driven."""
        return self.scenes.driven(self.reference, self.drive)

    @cached_property
    def resolved(self) -> ResolvedRun:
        """Everything that determines the nominal run."""
        return self.scene.resolve(self.values, 0, self.duration)

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

    @property
    def hold_window(self) -> tuple[float, float] | None:
        """Start and end [s] of the hold that the scene declares; None without one."""
        holding = self.base.holding
        return None if holding is None else holding.window(self.resolved.initial)

    @property
    def keyframe(self) -> str | None:
        """The keyframe that it starts from; None for the scene's initial state."""
        start = self.resolved.keyframe
        return None if start == QPOS0 else start

    @property
    def settings(self) -> Settings:
        """Every resolved setting."""
        return self.resolved.settings


def open_model(
    reference: str,
    assign: Sequence[str],
    kind: TaskKind | None = None,
    *,
    drive: Drive | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> CheckedModel:
    """Open a model for its checks; what is None is derived from the model or its scene.

    Each of `assign` is a `NAME=VALUE` for an axis of the scene, or for `duration`.

    Raises:
        SceneError: there is no such scene, or it does not compile.
        SweepFileError: a setting is wrong; all that are, are named.
    """
    scenes = SceneLoader(Path())
    scene = scenes.open(reference)
    values, sweep = read_settings(scenes, reference, assign, ("duration",))
    engine = find_engine(str(values.get("engine", MODEL_ENGINE)))
    if not isinstance(engine, ChecksRuns):
        raise SweepFileError(
            f"--set engine: a check goes over its runs a second time, which the {engine.name} "
            "engine cannot"
        )
    resolved = scene.resolve(values, 0, None)
    if not 0 < resolved.timestep < math.inf:
        raise SceneError(
            f"{scene.source.model}: its timestep is {resolved.timestep:g} s; write one above 0 "
            "there, or `--set timestep=`"
        )
    task, reason = _kind(scene.base(resolved.structure), kind)
    return CheckedModel(
        reference=reference,
        scenes=scenes,
        given=tuple(assign),
        values=_settings(resolved, values),
        duration=scene.duration if sweep.duration is None else sweep.duration,
        drive="exercise" if drive is None and scene.source.manifest is None else drive,
        limits=limits,
        kind=task,
        kind_reason=reason,
    )


def _settings(resolved: ResolvedRun, values: Values) -> dict[str, object]:
    """Replace parts of settings, such as `solref.timeconst`, by the whole settings they change."""
    settings = resolved.settings
    whole: dict[str, object] = {}
    for name, value in values.items():
        changed = PARAMETERS[name].sets if name in PARAMETERS else name
        whole[changed] = settings[changed] if name in PARAMETERS else value
    return {name: axis_value(name, value) for name, value in whole.items()}


def _kind(base: CompiledScene, asked: TaskKind | None) -> tuple[TaskKind, str]:
    """Return the kind of task and why: locomotion for a free body with several actuated limbs."""
    if asked is not None:
        return asked, "as asked"
    walking = {
        name: count for name, count in actuated_limbs(base.model).items() if count >= _WALKING
    }
    if walking:
        name, count = max(walking.items(), key=lambda each: each[1])
        return "locomotion", f"'{name}' is free and has {count} actuated limbs"
    return "manipulation", "no free body has several actuated limbs"


@dataclass(frozen=True)
class CheckRun:
    """A run of the model and its evidence.

    Attributes:
        row: settings of this run, beyond those under check.
        values: all settings of this run.
        store: its store.
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
    def has_trace(self) -> bool:
        """Whether it has a trace, however short."""
        return self.record.trace is not None

    @property
    def is_complete(self) -> bool:
        """Whether it was simulated to its end, without an engine warning."""
        return self.record.status == "ok" and not self.record.warnings
