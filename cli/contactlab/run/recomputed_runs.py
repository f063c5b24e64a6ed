"""What the engine says of a store: its runs resolved again, and a sample simulated again."""

import random
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pydantic_core import from_json, to_json

from contactlab.errors import ContactlabError
from contactlab.plugins import loaded_plugins
from contactlab.run.evidence_record import engine, provenance
from contactlab.run.planned_runs import stored_sweep_scene
from contactlab.run.stored_runs import canonical_values, replay, resolve_record
from contactlab.run.tasks import PlannedRun, Task
from contactlab.run.worker import Worker
from contactlab.schema.drive import PolicyDrive
from contactlab.schema.sweep_schema import Sweep
from contactlab.store.finished_store import Store
from contactlab.store.store_files import SCENES

_OUTCOME = ("status", "steps", "trajectory_hash", "label", "labels", "label_steps", "knife_edge")


def unresolved(store: Store) -> str | None:
    """Return why run ids cannot be recomputed here; None if they can."""
    identity, ours = store.manifest.sweep, engine()
    missing = {each.name for each in identity.plugins} - {each.name for each in loaded_plugins()}
    if missing:
        return f"run ids and settings: plug-in {', '.join(sorted(missing))} is not loaded"
    if identity.engine != ours:
        theirs = f"{identity.engine.name} {identity.engine.version}"
        return f"run ids and settings: they are of {theirs}, and this is {ours.version}"
    return None


def recomputed_problems(store: Store) -> Iterator[str]:
    """Yield where scene, run ids and settings are not what the stored files give."""
    identity = store.manifest.sweep
    try:
        scene = stored_sweep_scene(store.manifest.sweep, store.scene_folder)
    except ContactlabError as error:
        yield str(error)
        return
    if scene.hash != identity.scene_hash:
        yield f"{SCENES}/{identity.scene_hash}: its files have the hash {scene.hash}"
        return
    for record in store.records():
        try:
            values = resolve_record(scene, record).values
        except ContactlabError as error:
            yield str(error)
            continue
        again, stored = _known(values), _known(record.settings)
        for name in sorted(name for name in again | stored if again.get(name) != stored.get(name)):
            yield f"run {record.run_id}: {name} is {stored.get(name)}, not {again.get(name)}"


def simulated_problems(store: Store, count: int) -> Iterator[str]:
    """Simulate, measure and label a random sample of the runs again; yield how they differ."""
    identity, columns = store.manifest.sweep, store.columns
    scene = stored_sweep_scene(store.manifest.sweep, store.scene_folder)
    names = [*_OUTCOME, *(name for name in identity.metric_versions if name in columns.measured)]
    with TemporaryDirectory() as folder:
        worker = Worker(_task(store, Path(folder)), None)
        for row in sorted(random.sample(range(columns.runs), min(count, columns.runs))):
            stored = columns.row(row)
            if stored["status"] not in {"ok", "stopped"}:
                continue
            record = store.record(stored["run_id"])
            if isinstance(record.drive, PolicyDrive):
                # Its code is not run: the controls that it gave are.
                if not (result := replay(store, record.run_id)).equal:
                    yield f"run {record.run_id}: simulated again, its hash is {result.hash}"
                continue
            values = canonical_values(scene, record)
            planned = PlannedRun(record.index, record.run_id, values, record.seed)
            (finished,) = worker.run((planned,))
            again = from_json(finished.row)
            before = f"run {record.run_id}: simulated again, "
            for name in (each for each in names if again[each] != stored[each]):
                yield f"{before}{name} is {again[name]}, not {stored[name]}"


def _task(store: Store, folder: Path) -> Task:
    identity = store.manifest.sweep
    return Task(
        sweep=Sweep.model_validate(identity.resolved).model_copy(update={"trace": "none"}),
        expected=(),
        identity=identity,
        store=folder,
        scene_folder=store.scene_folder,
        provenance=provenance(),
        plugins=loaded_plugins(),
    )


def _known(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings as they are in JSON, without those that are null."""
    plain = from_json(to_json(dict(settings)))
    return {name: value for name, value in plain.items() if value is not None}
