"""Recomputes runs of a store: resolves all of them again, and simulates a sample again."""

import random
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from contactlab.errors import ContactlabError
from contactlab.measure import LABELS, METRICS, THRESHOLDS, added_labels
from contactlab.plan.grid import Plan
from contactlab.plan.overrides import Overrides
from contactlab.plan.sweep_file import read_sweep
from contactlab.plugins import loaded_plugins
from contactlab.run.evidence_record import find_engine, find_provenance, hash_definitions
from contactlab.run.planned_runs import RunIndex, open_store_scene
from contactlab.run.recomputed_rows import recomputed_rows
from contactlab.run.run_verdicts import unmet_means
from contactlab.run.shards import parse_shard, part_of, shard_of_sweep
from contactlab.run.stored_runs import canonical_values, replay_run
from contactlab.run.sweep_request import SweepRequest, supported_plan
from contactlab.run.sweep_runner import chosen_runs, identity_of
from contactlab.run.tasks import Task
from contactlab.run.worker import Worker
from contactlab.scene.scene import Scene
from contactlab.schema.drive import PolicyDrive, parse_drive
from contactlab.schema.evidence import SweepIdentity
from contactlab.schema.sweep_schema import Sweep
from contactlab.schema.vocabulary import Vocabulary
from contactlab.store.arrow_values import numpy_array
from contactlab.store.finished_store import Store
from contactlab.store.mcap.trace_reader import StoredTrace, read_trace
from contactlab.store.store_files import IDENTITY, MANIFEST, SCENES, TABLE, is_slice, shard_of

_OUTCOME_COLUMNS = (
    *("status", "steps", "trajectory_hash"),
    *("label", "labels", "label_steps", "label_bodies", "knife_edge"),
)


def why_ids_unverifiable(store: Store) -> str | None:
    """Return the reason why run ids cannot be recomputed here; None if they can."""
    identity, ours = store.manifest.sweep, find_engine()
    missing = {plugin.name for plugin in identity.plugins} - {
        plugin.name for plugin in loaded_plugins()
    }
    if missing:
        return f"run ids and settings: plug-in {', '.join(sorted(missing))} is not loaded"
    if identity.engine != ours:
        theirs = f"{identity.engine.name} {identity.engine.version}"
        return f"run ids and settings: they are of {theirs}, and this is {ours.version}"
    return None


def why_plan_unverifiable(store: Store) -> str | None:
    """Return the reason why the plan cannot be made again here; None if it can."""
    identity, theirs = store.manifest.sweep, store.manifest.provenance.contactlab
    if not identity.source:
        return "the plan: the runs are of a recorded loop, which has no plan"
    if theirs != (ours := version("contactlab")):
        return f"the plan: contactlab {theirs} wrote it, and this is {ours}"
    if isinstance(identity.resolved.get("include"), dict):
        return "the plan: a file next to the sweep names some of its runs"
    theirs, ours = (
        sorted(p.sha256 for p in plugins) for plugins in (identity.plugins, loaded_plugins())
    )
    if (*theirs, identity.definitions) != (*ours, hash_definitions()):
        return "the plan: other definitions of metrics and labels, or other plug-ins, are loaded"
    return None


def recomputed_problems(store: Store, chosen: NDArray[np.bool_] | None = None) -> Iterator[str]:
    """Yield contradictions between the stored scene, plan, ids and settings and recomputed ones.

    Settings and verdicts may be limited to chosen runs (runs,).
    """
    identity, plan = store.manifest.sweep, None
    try:
        scene = open_store_scene(store)
        if scene.hash != identity.scene_hash:
            yield f"{SCENES}/{identity.scene_hash}: its files have the hash {scene.hash}"
            return
        # Each file in the manifest belongs to the scene or to its drive.
        content, drive = scene.source.content, scene.drive
        ours = {f"{scene.hash}/{file.as_posix()}" for file in (*content.files, *content.licences)}
        folders = {scene.hash} if drive.hash is None else {scene.hash, drive.hash}
        for path in store.manifest.files:
            top, _, file = path.partition("/")
            folder = file.partition("/")[0]
            if top == SCENES and (
                folder not in folders or (folder == scene.hash and file not in ours)
            ):
                yield f"{path}: is not a file of the scene"
        if why_plan_unverifiable(store) is None:
            # Axes and metrics have the units of their definitions.
            described = store.columns.described
            units = {name: metric.unit for name, metric in METRICS.items()}
            for name in store.columns.axis_names:
                if (spec := scene.catalogue.find(name)) is not None:
                    units[name] = spec.unit
            for name in units.keys() & described.keys():
                if described[name].unit != units[name]:
                    found = described[name].unit
                    yield f"{TABLE}: column {name} is in '{found}', not in '{units[name]}'"
            plan = plan_again(identity, scene)
            yield from _differing_plan(store, scene, plan)
            of_all = None if is_slice(identity) else plan
            if tuple(unmet_means(of_all, store.columns)) != store.manifest.unmet_means:
                yield f"{MANIFEST}: its unmet means contradict the expectations of the sweep"
        yield from recomputed_rows(store, scene, plan, chosen)
    except ContactlabError as error:
        yield str(error).partition("\n")[0]


def _differing_plan(store: Store, scene: Scene, plan: Plan) -> Iterator[str]:
    """Yield differences of the sweep or plan read again from the sweep's text and options."""
    identity, columns = store.manifest.sweep, store.columns
    index = RunIndex(plan, scene)
    name, source, options = identity.name, identity.source, identity.overrides
    request = SweepRequest(plan, scene, name, source, options, store.address, workers=0)
    planned = identity_of(request, index)
    if is_slice(identity):
        if shard := shard_of(store.manifest.sweep):
            index, planned = shard_of_sweep(parse_shard(shard), plan.sweep, index, planned)
        else:
            part = index.select_ids(np.isin(index.ids, store.columns.ids()))
            index, planned = part, part_of(index, part, planned)
    elif chosen := chosen_runs(plan, index):
        read = columns.batches(["run_id", *chosen.read_by])
        chosen.add_rows(row for rows in read for row in rows.to_pylist())
        if chosen.next_runs().any():
            yield f"{TABLE}: runs are missing that the results of the others require"
        _, planned = chosen.finished_part(index, planned)
    ours, stored = planned.model_dump(), identity.model_dump()
    for field in (key for key in ours if ours[key] != stored[key]):
        yield f"{IDENTITY}: {field} contradicts the sweep's text and options"
    if columns.shared.get("severity") != list(LABELS):
        yield f"{TABLE}: its severity is not the order of the labels"
    if columns.shared.get("labels", {}) != added_labels():
        yield f"{TABLE}: its labels are not as the plug-ins declare them"
    if not index.has_all(
        columns.ids(),
        np.concatenate([numpy_array(rows["index"]) for rows in columns.batches(["index"])]),
    ).all():
        yield f"{TABLE}: its runs are not at their places in the plan"


def plan_again(identity: SweepIdentity, scene: Scene) -> Plan:
    """Return the plan from a stored sweep's text and options."""
    sets, where, limit = (
        [
            override.removeprefix(option)
            for override in identity.overrides
            if override.startswith(option)
        ]
        for option in ("--set ", "--where ", "--limit ")
    )
    options = Overrides(sets, where, int(limit[0]) if limit and limit[0].isdecimal() else None)
    axes, find = scene.catalogue.names, partial(scene.catalogue.find, lenient=True)
    names = Vocabulary(axes, find, [*METRICS], [*LABELS], [*THRESHOLDS])
    with TemporaryDirectory() as folder:
        # The empty folder hides all files that the sweep may name.
        file = Path(folder) / "sweep.yaml"
        file.write_text(identity.source, encoding="utf-8")
        plan, _ = supported_plan(read_sweep(file, lambda _: names, options).plan)
    drive = (drive_entry := identity.resolved.get("drive")) and parse_drive(drive_entry)
    return replace(plan, sweep=plan.sweep.model_copy(update={"drive": drive}))


def simulated_problems(store: Store, count: int, *, allow_code: bool = False) -> Iterator[str]:
    """Simulate, measure and label a random sample of the runs again. Yield the differences."""
    identity, columns = store.manifest.sweep, store.columns
    scene = open_store_scene(store)
    names = [
        *_OUTCOME_COLUMNS,
        *(name for name in identity.metric_versions if name in columns.measured),
    ]
    with TemporaryDirectory() as folder:
        identity = store.manifest.sweep
        sweep = Sweep.model_validate(identity.resolved).model_copy(update={"trace": "all"})
        worker = Worker(
            Task(
                sweep,
                (),
                identity,
                Path(folder),
                store.scene_folder,
                find_provenance(),
                loaded_plugins(),
            ),
            None,
        )
        for row in sorted(random.sample(range(columns.runs), min(count, columns.runs))):
            stored = columns.row(row)
            # The code of a loop is not available, but that of an environment is.
            played = bool(scene.source.environment)
            if stored["status"] not in {"ok", "stopped"} or (stored.get("loop") and not played):
                continue
            record = store.record(stored["run_id"])
            if played or isinstance(record.drive, PolicyDrive):
                # The code of a policy is not run: its recorded controls are applied.
                if not (result := replay_run(store, record.run_id, allow_code=allow_code)).equal:
                    yield f"run {record.run_id}: simulated again, its hash is {result.hash}"
                continue
            values = canonical_values(scene, record.axes)
            (run,) = scene.plan_runs(values, [record.seed], record.duration, record.index)
            (finished,) = worker.run((replace(run, run_id=record.run_id),))
            again = from_json(finished.row)
            before = f"run {record.run_id}: simulated again, "
            for name in (known for known in names if again.get(known) != stored[known]):
                yield f"{before}{name} is {again.get(name)}, not {stored[name]}"
            if record.trace is not None and not store.manifest.traces_left_out:
                new = read_trace(Path(folder) / again["trace_file"])
                if _trace_bytes(store.trace(record)) != _trace_bytes(new):
                    yield f"{before}its trace differs"


def _trace_bytes(trace: StoredTrace) -> list[bytes]:
    each = (value for part in (trace, *trace.pairs) for value in vars(part).values())
    return [value.tobytes() for value in each if isinstance(value, np.ndarray)]
