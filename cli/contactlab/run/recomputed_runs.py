"""Recomputes runs of a store: resolves all of them again, and simulates a sample again."""

import random
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from contactlab.errors import ContactlabError
from contactlab.foreign_code import printed_as_text
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
from contactlab.schema.evidence import Accuracy, EvidenceRecord, SweepIdentity, Timing
from contactlab.schema.vocabulary import Vocabulary
from contactlab.step_progress import finish_step, step_count
from contactlab.store.arrow_values import numpy_array
from contactlab.store.finished_store import Store
from contactlab.store.mcap.trace_reader import StoredTrace, read_trace
from contactlab.store.store_files import (
    IDENTITY,
    MANIFEST,
    SCENES,
    TABLE,
    is_slice,
    shard_of,
    stored_sweep,
)
from contactlab.store.table_layout import COLUMNS_OF_MACHINE

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
                if (spec := scene.catalogue.find_axis(name)) is not None:
                    units[name] = spec.unit
            for name in units.keys() & described.keys():
                if described[name].unit != units[name]:
                    stored_unit = described[name].unit
                    yield f"{TABLE}: column {name} is in '{stored_unit}', not in '{units[name]}'"
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
    own_identity = identity_of(request, index)
    if is_slice(identity):
        if shard := shard_of(store.manifest.sweep):
            index, own_identity = shard_of_sweep(
                parse_shard(shard), plan.sweep, index, own_identity
            )
        else:
            part = index.select_ids(np.isin(index.ids, store.columns.read_ids()))
            index, own_identity = part, part_of(index, part, own_identity)
    elif chosen := chosen_runs(plan, index):
        batches = columns.iterate_batches(["run_id", *chosen.read_by])
        chosen.add_rows(row for rows in batches for row in rows.to_pylist())
        if chosen.next_runs().any():
            yield f"{TABLE}: runs are missing that the results of the others require"
        _, own_identity = chosen.finished_part(index, own_identity)
    ours, stored = own_identity.model_dump(), identity.model_dump()
    for key in (key for key in ours if ours[key] != stored[key]):
        yield f"{IDENTITY}: {key} contradicts the sweep's text and options"
    if columns.shared.get("severity") != list(LABELS):
        yield f"{TABLE}: its severity is not the order of the labels"
    if columns.shared.get("labels", {}) != added_labels():
        yield f"{TABLE}: its labels are not as the plug-ins declare them"
    if not index.has_all(
        columns.read_ids(),
        np.concatenate([numpy_array(rows["index"]) for rows in columns.iterate_batches(["index"])]),
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
    axes, find = scene.catalogue.names, partial(scene.catalogue.find_axis, lenient=True)
    names = Vocabulary(axes, find, [*METRICS], [*LABELS], [*THRESHOLDS])
    with TemporaryDirectory() as folder:
        # The empty folder hides all files that the sweep may name.
        file = Path(folder) / "sweep.yaml"
        file.write_text(identity.source, encoding="utf-8")
        plan, _ = supported_plan(read_sweep(file, lambda _: names, options).plan)
    drive = (drive_entry := identity.resolved.get("drive")) and parse_drive(drive_entry)
    return replace(plan, sweep=plan.sweep.model_copy(update={"drive": drive}))


@dataclass
class Resimulation:
    """Runs of a store that were simulated, measured and labeled again."""

    requested_runs: int  # runs that were requested, at most all
    simulated: int = 0
    problems: list[str] = field(default_factory=list[str])
    left_out: Counter[str] = field(default_factory=Counter[str])
    """Reasons why runs cannot be simulated again, each with their number."""

    def add_shortage(self) -> None:
        """Add a problem if fewer runs were simulated than requested."""
        if self.simulated < self.requested_runs:
            why = "; ".join(f"{count:,} {reason}" for reason, count in self.left_out.items())
            count_text = f"simulated again: {self.simulated:,} of {self.requested_runs:,}"
            self.problems.append(f"{count_text}: {why}" if why else count_text)


def simulate_again(store: Store, count: int, *, allow_code: bool = False) -> Resimulation:
    """Simulate, measure and label a random sample of the runs again, and compare all fields.

    A sample has runs that can be repeated, if there are enough.
    """
    columns = store.columns
    resimulation = Resimulation(min(count, columns.runs))
    if (why := why_ids_unverifiable(store)) is not None:
        resimulation.left_out[why] = resimulation.requested_runs
        resimulation.add_shortage()
        return resimulation
    scene = open_store_scene(store)
    # The code of a loop is not available, but that of an environment is.
    played = bool(scene.source.environment)
    order = random.sample(range(columns.runs), columns.runs)
    with TemporaryDirectory() as folder, step_count("runs", resimulation.requested_runs) as again:
        identity = store.manifest.sweep
        sweep = stored_sweep(identity).model_copy(update={"trace": "all"})
        provenance, plugins = find_provenance(), loaded_plugins()
        task = Task(sweep, (), identity, Path(folder), store.scene_folder, provenance, plugins)
        worker = Worker(task, None)
        for row in order:
            if resimulation.simulated >= resimulation.requested_runs:
                break
            stored = columns.read_row(row)
            if stored["status"] in {"crashed", "timeout"}:
                resimulation.left_out[f"ended by {stored['status']}, which is not repeated"] += 1
                continue
            if stored.get("loop") and not played:
                resimulation.left_out["of a loop: its code is not in the store"] += 1
                continue
            finish_step(again, resimulation.simulated - again.finished_steps)
            resimulation.simulated += 1
            record = store.record(stored["run_id"])
            if played:
                replay = replay_run(store, record.run_id, allow_code=allow_code)
                if not replay.equal:
                    resimulation.problems.append(
                        f"run {record.run_id}: simulated again, its hash is {replay.hash}"
                    )
                continue
            resimulation.problems += _differing_fields(store, scene, worker, record, stored)
    resimulation.add_shortage()
    return resimulation


# Fields that depend on the sweep's expectations, which `recomputed_rows` judges again.
_JUDGED_COLUMNS = frozenset(
    ("expected", "expectation_met", "expectation_reason", "tolerances_met", "axis_names")
)


def compared_columns(store: Store) -> list[str]:
    """Return the columns that a simulation of a run makes again, except clocks and axes.

    With other definitions of metrics, these are the outcomes and the metrics of the same version.
    """
    names, metrics = store.columns.schema.names, store.manifest.sweep.metric_versions
    if why_plan_unverifiable(store) is not None:
        return [name for name in names if name in {*_OUTCOME_COLUMNS, *metrics}]
    unknown = {*COLUMNS_OF_MACHINE, *_JUDGED_COLUMNS, *Accuracy.model_fields, *Timing.model_fields}
    return [name for name in names if name not in {*unknown, *store.columns.axis_names}]


def uncompared_parts(store: Store) -> list[str]:
    """Return the parts of records that no simulation of a run makes again, with reasons."""
    resolved, parts = store.manifest.sweep.resolved, list[str]()
    if resolved.get("accuracy"):
        parts.append("errors: they are measured against references by a sweep alone")
    if resolved.get("timing"):
        parts.append("times: no run takes the same time again")
    if store.manifest.parameter_budgets:
        parts.append("error budgets of parameters: a sweep alone measures them")
    return parts


def _differing_fields(
    store: Store, scene: Scene, worker: Worker, record: EvidenceRecord, stored: Mapping[str, Any]
) -> Iterator[str]:
    values = canonical_values(scene, record.axes)
    (run,) = scene.plan_runs(values, [record.seed], record.duration, record.index)
    run, names = replace(run, run_id=record.run_id), compared_columns(store)
    before = f"run {record.run_id}: simulated again, "
    if isinstance(record.drive, PolicyDrive):
        # The code of a policy is not run: its recorded controls are applied.
        names = [name for name in names if name != "controls"]
        if record.controls is None:
            yield f"{before}it has no controls, which its policy made"
            return
        worker.keep_controls(record.controls, store.backend)
        run = replace(run, controls=record.controls)
    with printed_as_text() if loaded_plugins() else nullcontext():
        (finished,) = worker.run((run,))
    again = from_json(finished.row)
    for name in names:
        new, old = _without_nulls(again.get(name)), _without_nulls(stored[name])
        if new != old:
            yield f"{before}{name} is {new}, not {old}"
    if record.trace is not None and not store.manifest.traces_left_out:
        new_trace = read_trace(worker.store_folder / again["trace_file"])
        if _trace_bytes(store.trace(record)) != _trace_bytes(new_trace):
            yield f"{before}its trace differs"


def _without_nulls(value: Any) -> Any:  # noqa: ANN401 - of any column
    if isinstance(value, dict):
        return {name: entry for name, entry in value.items() if entry is not None}
    return value


def _trace_bytes(trace: StoredTrace) -> list[bytes]:
    each = (value for part in (trace, *trace.pairs) for value in vars(part).values())
    return [value.tobytes() for value in each if isinstance(value, np.ndarray)]
