"""Stored runs, simulated again from their store alone and compared bit for bit."""

from dataclasses import dataclass, replace

import numpy as np

from contactlab.engines import ENGINES, Buffers, PreparedRuns, Rollout, find_engine, trajectory_hash
from contactlab.errors import ContactlabError, PluginError, StoreError
from contactlab.plugins import loaded_plugins
from contactlab.scene import (
    InitialStates,
    PreparedModel,
    ResolvedRun,
    Scene,
    silence_mujoco,
    stored_scene,
)
from contactlab.schema import EvidenceRecord, effects_base
from contactlab.store import Store


@dataclass(frozen=True)
class ReplayResult:
    """A replay, compared with the stored run.

    Attributes:
        run_id: the run.
        equal: whether every state is equal, bit for bit.
        stored_hash: of the stored trajectory.
        hash: of the new one.
        step: first step after which the states differ; None if they are equal, if there is no
            trace, or if the trace is equal although its hash is not.
        difference: largest difference of a coordinate there [m, rad, m/s or rad/s].
        stored_engine: engine and version that computed the stored run.
    """

    run_id: str
    equal: bool
    stored_hash: str | None
    hash: str
    step: int | None
    difference: float | None
    stored_engine: str


@dataclass(frozen=True)
class PreparedReplay:
    """A stored run that is ready to be simulated again."""

    record: EvidenceRecord
    runs: PreparedRuns

    @property
    def prepared(self) -> PreparedModel:
        """Its model."""
        return self.runs.prepared[0]

    def roll_out(self) -> Rollout:
        """Simulate it by the engine that computed it.

        Raises:
            EngineError: there is no such engine here.
        """
        return find_engine(self.record.engine.name).roll_out(self.runs, Buffers())


def prepare_replay(store: Store, run: str) -> PreparedReplay:
    """Return a stored run's model and initial state, made from the store's own files.

    Raises:
        StoreError: there is no such run, or its settings do not give its id.
        EngineError: the engine that computed it is not here.
        SceneError: the stored scene does not compile with this engine.
    """
    record, scene, resolved = stored_run(store, run)
    runs = PreparedRuns.of(scene, resolved)
    starts = _stored_start(record, runs.prepared[0], runs.starts)
    return PreparedReplay(record, replace(runs, starts=starts, steps=record.steps_asked))


def stored_run(store: Store, run: str) -> tuple[EvidenceRecord, Scene, ResolvedRun]:
    """Return a stored run, its scene and its settings, made from the store's own files.

    Raises:
        StoreError: there is no such run, or its settings do not give its id.
        EngineError: the engine that computed it is not here.
        PluginError: it cannot be prepared, and a plug-in that it was run with is not loaded.
    """
    record = store.record(run)
    missing = [str(each) for each in record.plugins if each.name not in _loaded_names()]
    try:
        return record, *_prepared(store, record)
    except ContactlabError as error:
        if not missing:
            raise
        raise PluginError(
            f"run {record.run_id} was run with plug-in {', '.join(missing)}, not loaded here; "
            f"install it or name its file with --plugin: {error}"
        ) from error


def _loaded_names() -> set[str]:
    return {each.name for each in loaded_plugins()}


def _prepared(store: Store, record: EvidenceRecord) -> tuple[Scene, ResolvedRun]:
    find_engine(record.engine.name)
    identity = store.manifest.sweep
    source = stored_scene(store.scene_folder, identity.scene_model, identity.scene)
    scene = Scene(source, ENGINES).with_effects(effects_base(identity.resolved.get("effects", {})))
    values = {name: _parsed(scene, name, value) for name, value in record.axes.items()}
    resolved = scene.resolve(values, record.seed, record.duration)
    if scene.run_id(resolved) != record.run_id:
        raise StoreError(
            f"run {record.run_id}: the stored scene and settings give another id, "
            f"{scene.run_id(resolved)}; the store or this version's defaults changed"
        )
    return scene, resolved


def replay(store: Store, run: str) -> ReplayResult:
    """Simulate a stored run again; return whether it is equal, or where it first differs."""
    silence_mujoco()
    start = prepare_replay(store, run)
    record = start.record
    rollout = start.roll_out()
    new_hash = trajectory_hash(rollout, 0)
    equal = new_hash == record.trajectory_hash
    step, difference = (None, None) if equal else _first_difference(store, record, rollout)
    return ReplayResult(
        run_id=record.run_id,
        equal=equal,
        stored_hash=record.trajectory_hash,
        hash=new_hash,
        step=step,
        difference=difference,
        stored_engine=f"{record.engine.name} {record.engine.version}",
    )


def _stored_start(
    record: EvidenceRecord, prepared: PreparedModel, again: InitialStates
) -> InitialStates:
    """Return the stored state; controls and holds over time come from scene and settings."""
    initial = record.initial
    applied = initial.applied or (0.0,) * (6 * prepared.model.nbody)
    rows = (initial.qpos, initial.qvel, initial.ctrl, applied)
    qpos, qvel, ctrl, forces = (np.array([row], dtype=np.float64) for row in rows)
    return again._replace(qpos=qpos, qvel=qvel, ctrl=ctrl, applied=forces)


def _parsed(scene: Scene, name: str, value: object) -> object:
    spec = scene.catalogue.find(name)
    if spec is None:
        raise StoreError(f"the stored scene has no axis '{name}'")
    try:
        return spec.parse(value)
    except ValueError as error:
        raise StoreError(f"stored axis '{name}': {error}") from error


def _first_difference(
    store: Store, record: EvidenceRecord, rollout: Rollout
) -> tuple[int | None, float | None]:
    if record.trace is None:
        return None, None
    stored = store.trace(record)
    width = stored.qpos.shape[1] + stored.qvel.shape[1]
    old = np.concatenate([stored.qpos, stored.qvel], axis=1)
    new = rollout.state[0, : rollout.steps[0] + 1, 1 : 1 + width]
    rows = min(len(old), len(new))
    differs = np.flatnonzero((old[:rows] != new[:rows]).any(axis=1))
    if len(differs) == 0:
        return None if len(old) == len(new) else rows, None
    first = int(differs[0])
    return first, float(np.abs(old[first] - new[first]).max())
