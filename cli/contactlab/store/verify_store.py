"""Checks a store, and keeps a valid one as a baseline: without traces, small enough to commit.

Its files are checked against their hashes, its content against recomputed values.
"""

import fcntl
import os
import re
import shutil
from collections import Counter
from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from itertools import islice, tee
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from contactlab.errors import OutputError, StoreError
from contactlab.schema.evidence import RECORD_VERSION, Cost, EvidenceRecord, SweepIdentity
from contactlab.step_progress import count_steps
from contactlab.store.arrow_values import numpy_array
from contactlab.store.atomic_files import (
    exchange_folders,
    move_folder,
    sha256_of,
    sync_filesystem,
    write_error,
)
from contactlab.store.controls_file import controls_name, read_controls
from contactlab.store.finished_store import Store
from contactlab.store.row_checks import RowChecks, is_null
from contactlab.store.run_columns import rows_of, select_rows
from contactlab.store.runs_table import RowsDigest, digests_of, write_compact_table
from contactlab.store.store_files import (
    IDENTITY,
    LOCK,
    MANIFEST,
    SCENES,
    TABLE,
    TRACES,
    Address,
    check_tree,
    document_json,
    parse_identity,
    stored_file,
)
from contactlab.store.table_layout import (
    FIXED_COLUMNS,
    as_ratios,
    record_to_row,
    row_to_record,
    texts_of,
)

MOST_PROBLEMS = 1000
_ENDED = frozenset(("crashed", "timeout"))
# Checking this many records takes about two seconds; a baseline in a repository has fewer.
_MAX_QUICK_RECORDS = 1 << 17
# Files that records name, with hashes; a store without traces has their empty folder.
_RECORD_FILES = re.compile(r"traces/([0-9a-f]{2}/)?(.*\.mcap)?|controls/[0-9a-f]{64}\.arrow")


def find_problems(
    address: Address, *, thorough: bool = True, chosen: NDArray[np.bool_] | None = None
) -> list[str]:
    """Return the first thousand defects of a store; empty if it is valid.

    A thorough check recomputes everything possible from every record and trace; a quick one shows
    that files have their hashes, counts are right, and traces exist. Records and traces may be
    limited to the `chosen` ones (runs,). Apart from the ids, memory does not grow with the number
    of runs. Raises a StoreError if the store cannot be opened at all.
    """
    problems = _find_problems(Store.open_unchecked(address), chosen, thorough=thorough)
    return list(islice(problems, MOST_PROBLEMS))


def _find_problems(
    store: Store, chosen: NDArray[np.bool_] | None, *, thorough: bool
) -> Iterator[str]:
    changed = list(_check_files(store))
    yield from changed
    try:
        if parse_identity(store.file(IDENTITY).read_bytes(), store.address) != store.manifest.sweep:
            yield f"{IDENTITY} and {MANIFEST} name different sweeps"
    except (OSError, StoreError) as error:
        # A missing or changed file is among the changed ones.
        if not any(problem.startswith(IDENTITY) for problem in changed):
            yield f"{IDENTITY} cannot be read: {error}"
    model = None
    if not any(problem.startswith(SCENES) for problem in changed):
        path = store.scene_folder / store.manifest.sweep.scene_model
        # A trace does not contain a compiled model.
        model = path.read_bytes() if path.is_file() and path.suffix != ".mjb" else None
    try:
        yield from _check_columns(store)
        if thorough:
            yield from _check_sweep(store)
            yield from _check_records(store, model, chosen)
            if "controls" in store.columns.schema.names:
                for sha256 in sorted(store.columns.values("controls") - {None}):
                    try:
                        read_controls(store.backend, sha256)
                    except StoreError as error:
                        yield str(error)
        else:
            yield from damaged_traces(store)
    except (StoreError, LookupError, ValueError, OSError) as error:
        yield f"{TABLE}: {error}"
    # Files, and empty folders, that no part of the store names.
    files = store.manifest.files
    bound = {*files, *store.backend.leftover_names(), IDENTITY, TABLE, MANIFEST, LOCK}
    for name in store.backend.file_names():
        was_left = name.endswith("/") and any(file.startswith(name) for file in files)
        if name not in bound and not was_left and not _RECORD_FILES.fullmatch(name):
            yield f"{name}: {MANIFEST} does not name it"


def contradictory_records(store: Store) -> list[str]:
    """Return the records that contradict the sweep or themselves, as in an edited table.

    Traces are not read. A store of more than a hundred thousand runs is not checked.
    """
    problems = list[str]()
    if store.columns.runs > _MAX_QUICK_RECORDS:
        return problems
    try:
        rows = _suspected_rows(store, store.columns.iterate_batches(), traced=False)
        for _ in _sound_records(store, rows, problems):
            pass
    except (StoreError, LookupError, ValueError, OSError) as error:
        problems.append(f"{TABLE}: {error}")
    return problems


def unverifiable_parts(store: Store) -> list[str]:
    """Return the parts of a store that its own content cannot prove, with reasons."""
    manifest = store.manifest
    parts: list[str] = []
    if manifest.traces_left_out:
        parts.append("trajectories, metrics and labels: the traces were left out")
    elif without := manifest.runs - manifest.traces:
        parts.append(f"trajectories, metrics and labels of {without:,} runs: they kept no trace")
    return parts


def damaged_traces(store: Store) -> Iterator[str]:
    """Yield missing or changed traces: all are checked by size, the first also by content."""
    if store.manifest.traces_left_out:
        return
    # A quick check reads traces up to this total size, and only checks the size of the others.
    remaining_bytes = 256 << 20
    traces = store.columns.iterate_present(("trace_file", "trace_bytes", "trace_sha256"))
    for trace in count_steps(traces, "traces", store.manifest.traces):
        file, expected, sha256 = trace.values()
        remaining_bytes -= expected or 0
        size = store.backend.trace_size(file)
        if size is None:
            yield f"{file}: missing"
        elif size != expected or (
            remaining_bytes >= 0 and not store.backend.holds_trace(file, size, sha256)
        ):
            yield f"{file}: changed since it was written"


def trace_damage(store: Store, record: EvidenceRecord) -> str | None:
    """Return the damage of the stored trace of a run; None if it is valid, or not kept."""
    from contactlab.store.mcap.trace_reader import trace_problems  # noqa: PLC0415 - takes a while

    if record.trace is None or store.manifest.traces_left_out:
        return None
    with closing(store.backend.local_files([record.trace.file])) as files:
        path = next(files)
        problems = ("missing",) if path is None else trace_problems(path, record)
        return next((f"{record.trace.file}: {problem}" for problem in problems), None)


def trace_warning(store: Store) -> tuple[str, ...]:
    """Return lines that name damaged traces and runs that do not repeat, if there are any."""
    changing = ", ".join(store.manifest.unrepeatable)
    lines = (f"its policy does not repeat: run {changing} changes each time",) if changing else ()
    damaged = list(damaged_traces(store))
    if not damaged:
        return lines
    max_named_damages = 3  # a warning of a line
    problems = "; ".join(damaged[:max_named_damages])
    more = (
        f"; and {len(damaged) - max_named_damages:,} more"
        if len(damaged) > max_named_damages
        else ""
    )
    return (*lines, f"{problems}{more} (see `contactlab verify {store.address}`)")


def _check_files(store: Store) -> Iterator[str]:
    files = store.manifest.files
    for name, expected in files.items():
        try:
            path = stored_file(store.path, name)
        except StoreError as error:
            yield str(error)
            continue
        if path is None:
            yield f"{name}: missing"
        elif sha256_of(path) != expected:
            yield f"{name}: changed since it was written"
    for name in (IDENTITY, TABLE):
        if name not in files:
            yield f"{name}: {MANIFEST} does not name it"
    for name in store.backend.leftover_names():
        yield f"{name}: left over from an interrupted write"


def _check_columns(store: Store) -> Iterator[str]:
    version = store.columns.shared["schema_version"]
    if version != RECORD_VERSION:
        yield (
            f"{TABLE}: its records are of version {version}; "
            f"this contactlab reads version {RECORD_VERSION}"
        )
    manifest = store.manifest
    yield from (f"{MANIFEST}: {miscount}" for miscount in store.find_miscounts())
    if manifest.runs != manifest.sweep.runs_asked:
        run_count = manifest.sweep.runs_asked
        yield f"{MANIFEST}: {manifest.runs} runs, but the sweep has {run_count}"
    last = -1
    for part in store.columns.iterate_batches(["index"]):
        places = numpy_array(part["index"])
        if part["index"].null_count or not (np.diff(places, prepend=last) > 0).all():
            yield f"{TABLE}: its runs are not in the order of their index"
            break
        last = places[-1]
    ids = store.columns.read_ids()
    ids.sort()
    repeated_ids = ids[1:][ids[1:] == ids[:-1]]
    for run, count in Counter(repeated_ids.tolist()).items():
        yield f"{TABLE}: run {run:016x} occurs {count + 1} times"


def _check_sweep(store: Store) -> Iterator[str]:
    sweep, columns = store.manifest.sweep, store.columns
    # A baseline has no list of columns, which is informative only.
    listed_columns = columns.column_descriptions
    described = {field.name: texts_of(field.metadata) for field in columns.schema}
    for name in described.keys() | listed_columns.keys() if listed_columns else ():
        if listed_columns.get(name) != described.get(name):
            yield f"{TABLE}: column {name} differs from its description in the list of columns"
    ratios = {column.name for column in as_ratios(columns.schema.names)}
    for fixed in FIXED_COLUMNS:
        description = columns.described.get(fixed.name)
        if description and description.unit not in {
            fixed.unit,
            "1" if fixed.name in ratios else fixed.unit,
        }:
            yield f"{TABLE}: column {fixed.name} is in '{description.unit}', not in '{fixed.unit}'"
    for name, stated in (("scene_hash", sweep.scene_hash), ("scene", sweep.scene)):
        if others := columns.values(name) - {stated, None}:
            yield f"{TABLE}: it also has runs of scene {', '.join(sorted(others))}"
    shared, versions = columns.shared, sweep.metric_versions
    units = {name: columns.described[name].unit for name in versions}
    stated = {"sweep": sweep.name, "metric_versions": versions, "units": units}
    own = ("schema_version", "severity", *({"labels"} & shared.keys()))
    stated |= {name: shared.get(name) for name in own}
    own = {"started", "finished", "provenance"}
    stated |= store.manifest.model_dump(mode="json", include=own)
    for name in dict.fromkeys((*shared, *stated)):
        if shared.get(name) != stated.get(name):
            yield f"{MANIFEST} and {TABLE} differ in {name}"
    if f"{SCENES}/{sweep.scene_hash}/{sweep.scene_model}" not in store.manifest.files:
        yield f"{MANIFEST}: it does not name the scene's model, {sweep.scene_model}"
    seeds = sweep.resolved.get("seeds", 1)
    count = seeds if isinstance(seeds, int) else len(seeds)
    if sweep.whole is None and columns.plan_hash(count) != sweep.plan_hash:
        yield f"{TABLE}: its runs, in their order, do not match the plan's hash"


def _check_records(
    store: Store, model: bytes | None, chosen: NDArray[np.bool_] | None
) -> Iterator[str]:
    """Yield problems of records and traces, or of the chosen ones, by batches of rows."""
    from contactlab.store.mcap.trace_reader import trace_problems  # noqa: PLC0415 - takes a while

    problems, digest = list[str](), RowsDigest()
    left_out = store.manifest.traces_left_out
    trace_names = set[str]() if left_out else store.columns.values("trace_file")
    # All rows are in the digest; those with a trace are checked with it.
    rows = select_rows(map(digest.add_rows, store.columns.iterate_batches()), chosen)
    suspected = _suspected_rows(store, rows, traced=not left_out)
    sound = _sound_records(store, suspected, problems)
    traced = (record for record in sound if record.trace is not None and not left_out)
    records, ahead = tee(traced)
    paths = store.backend.local_files(record.trace.file for record in ahead if record.trace)
    traces = store.manifest.traces if chosen is None else min(chosen.sum(), store.manifest.traces)
    pairs = zip(records, paths, strict=True)
    for record, path in count_steps(pairs, "traces", traces):
        assert record.trace is not None
        trace_faults = ("missing",) if path is None else trace_problems(path, record, model)
        yield from (f"{record.trace.file}: {problem}" for problem in trace_faults)
        yield from problems
        problems.clear()
    yield from problems
    for name in store.backend.trace_names():
        if name not in trace_names:
            yield f"{name}: belongs to no run"
    digests = digest.digests_for(store.columns.schema)
    if store.manifest.records != digests.records:
        yield f"{TABLE}: its records do not match the manifest's digest"
    elif store.manifest.physics not in {None, digests.physics}:
        yield f"{MANIFEST}: its digest of the physics does not match {TABLE}"


def _sound_records(
    store: Store, rows: Iterable[dict[str, Any]], problems: list[str]
) -> Iterator[EvidenceRecord]:
    """Yield the records that fit their schema, and collect the problems of the others."""
    for row in rows:
        try:
            record = row_to_record(row, store.columns.shared)
        except (LookupError, TypeError, ValueError) as error:
            problems.append(f"{TABLE}: run {row['run_id']} does not match its schema: {error}")
            continue
        wrong = wrong_parts(row, record, store.manifest.sweep)
        where = f"{TABLE}: run {record.run_id}: its"
        problems += (f"{where} {name} contradicts its other values" for name in wrong)
        yield record


def _suspected_rows(
    store: Store, batches: Iterable[pa.RecordBatch], *, traced: bool
) -> Iterator[dict[str, Any]]:
    """Yield the rows that may violate a rule and, if `traced`, those with a trace."""
    columns = store.columns
    checks = RowChecks(store.manifest.sweep, columns.shared)
    for rows in batches:
        is_suspect = checks.find_suspects(rows)
        if traced and "trace_file" in rows.schema.names:
            is_suspect = is_suspect | ~is_null(rows["trace_file"])
        suspects = rows_of(rows, is_suspect).to_pylist() if is_suspect.any() else []
        # Otherwise they would stay in memory along with the next rows, freed or not.
        del rows
        pa.default_memory_pool().release_unused()
        yield from suspects


def wrong_parts(
    row: Mapping[str, Any], record: EvidenceRecord, sweep: SweepIdentity
) -> Iterator[str]:
    """Yield the parts of a record that contradict the sweep, or the rest of the record."""
    resolved, again = sweep.resolved, record_to_row(record)
    yield from (name for name in ("label_reason", "label_step") if row[name] != again[name])
    if record.labels and record.label != record.labels[0].label:
        yield "label"
    if (record.status == "ok") != (record.status_reason is None):
        yield "status_reason"
    if record.status in _ENDED and (
        record.label != record.status
        or record.steps
        or record.trajectory_hash
        or record.trace is not None
        or any(value is not None for value in record.metrics.values())
    ):
        # A run that ended with its process has no results.
        yield "status"
    if record.trace is not None and not record.trace.file.endswith(f"/{record.run_id}.mcap"):
        yield "trace"
    if (record.timing and not resolved.get("timing")) or (
        record.accuracy and not resolved.get("accuracy")
    ):
        yield "accuracy or timing"
    if record.knife_edge is not None and not resolved.get("knife_edge"):
        yield "knife_edge"
    cost, timestep = record.cost, record.settings.get("timestep")
    budget = resolved.get("latency_budget")
    if not isinstance(timestep, int | float):
        yield "timestep"
    elif cost is not None and cost != Cost.of_steps(cost.cpu_s, record.steps, timestep, budget):
        yield "cost"


def write_baseline(source: Address, target: Path, pinned: str | None = None) -> Store:
    """Copy a store without its traces, replacing an earlier baseline.

    Records stay complete: they name their traces with size and hash. The columns' descriptions are
    omitted. The target is replaced in one step; with a pinned digest, only a baseline with this
    digest. Raises a StoreError if the store is not valid; an OutputError if the target is not a
    baseline, is another one, or cannot be written.
    """
    if problems := find_problems(source, thorough=False):
        raise StoreError(f"{source} is not sound: {problems[0]} (see `contactlab verify {source}`)")
    try:
        with _staging_folder(target) as folder:
            _check_target(source, target, pinned)
            # Copy everything except the traces.
            store = Store.open_unchecked(source)
            copy = folder / "new"
            shutil.copytree(store.scene_folder.parent, copy / SCENES)
            shutil.copyfile(store.file(IDENTITY), copy / IDENTITY)
            write_compact_table(store.table, copy / TABLE)
            for sha256 in {
                record.controls for record in store.records() if record.controls is not None
            }:
                file = copy / controls_name(sha256)
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(store.backend.read_file(controls_name(sha256)) or b"")
            files = {name: sha256_of(copy / name) for name in store.manifest.files}
            digests = digests_of(copy / TABLE)
            if store.manifest.records != digests.records:
                raise StoreError(
                    f"{store.address} is not sound: its records are not those of its manifest"
                )
            changes = {"files": files, "physics": digests.physics, "traces_left_out": True}
            text = document_json(store.manifest.model_copy(update=changes))
            (copy / MANIFEST).write_text(text, encoding="utf-8")
            sync_filesystem(folder)
            if target.exists():
                exchange_folders(copy, target)
            else:
                move_folder(copy, target)
    except OSError as error:
        raise write_error(Path(error.filename or target), error) from error
    return Store.open_unchecked(target)


@contextmanager
def _staging_folder(target: Path) -> Generator[Path]:
    """Yield an empty folder next to a baseline; one left by a killed update is cleaned up first."""
    folder = target.absolute().with_name(f".{target.absolute().name}.update")
    check_tree(folder)
    folder.mkdir(parents=True, exist_ok=True)
    lock = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            message = f"{target} is being replaced by another update; wait for it"
            raise OutputError(message) from error
        if (folder / "old").exists() and not target.exists():
            (folder / "old").rename(target)
        for name in ("old", "new"):
            shutil.rmtree(folder / name, ignore_errors=True)
        try:
            yield folder
        finally:
            if (folder / "old").exists() and not target.exists():
                # The only copy: an update failed between two renames.
                (folder / "old").rename(target)
            shutil.rmtree(folder)
    finally:
        os.close(lock)


def _check_target(source: Address, target: Path, pinned: str | None) -> None:
    if pinned is not None and (digest := Store.open_unchecked(target).digest) != pinned:
        raise OutputError(f"{target} has the digest {digest}, not {pinned}, so it is not replaced")
    if not target.exists() or (target.is_dir() and not any(target.iterdir())):
        return
    if isinstance(source, Path) and target.samefile(source):
        raise OutputError(f"{target} is the store itself; name another folder for the baseline")
    try:
        replaceable = Store.open_unchecked(target).manifest.traces_left_out
    except StoreError:
        # A baseline of another version may be replaced; anything else may not.
        replaceable = (target / MANIFEST).is_file() and not (target / TRACES).exists()
    if not replaceable:
        raise OutputError(f"{target} is not a baseline, so it is not replaced; name another folder")
