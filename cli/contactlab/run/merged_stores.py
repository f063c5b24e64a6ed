"""Joins shards of a sweep into the store that one machine would have written."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from functools import partial
from operator import attrgetter

import numpy as np

from contactlab.errors import OutputError, StoreError
from contactlab.judge.wording import plural
from contactlab.run.planned_runs import stored_sweep_scene
from contactlab.run.recomputed_runs import plan_again
from contactlab.run.resumed_sweep import StoredScene
from contactlab.run.run_verdicts import conclude_runs
from contactlab.schema.evidence import Host, Provenance, StoreManifest, SweepIdentity
from contactlab.step_progress import count_steps
from contactlab.store.atomic_files import hashes_below, sha256_of
from contactlab.store.controls_file import controls_name
from contactlab.store.finished_store import Store
from contactlab.store.folder_backend import backend_at
from contactlab.store.store_files import (
    MANIFEST,
    SCENES,
    TABLE,
    Address,
    most_common,
    other_parts,
    parse_manifest,
    shard_of,
)
from contactlab.store.store_writer import Conclusion, open_writer


def merge_stores(
    places: Sequence[Address], target: Address, *, may_lack: bool, fresh: bool = False
) -> str:
    """Write the store of all runs of some shards, given in any order. Return its gaps as text.

    With `may_lack`, the store has the existing runs, and its sweep can add the missing ones. Raises
    a StoreError that names the store which is unfinished, damaged, of another sweep, or has a run
    that another one has, too; or that names the gaps. An OutputError says that the target is one of
    the shards, is not empty, or cannot be written.
    """
    if target in places:
        raise OutputError(f"{target} is one of the shards; name another place with -o")
    stores, lacking = _open_stores(places, may_lack=may_lack)
    runs = _count_runs(stores)
    # All runs together are the whole sweep, or a part of it.
    sweep = stores[0].manifest.sweep
    if (whole := sweep.whole) is None:
        identity = sweep
    else:
        grid = None if whole.runs == runs else whole.model_copy(update={"shard": None})
        identity = sweep.model_copy(update={"runs_asked": runs, "whole": grid})
    gaps = _gaps_text(stores, runs, lacking) if identity.whole else ""
    if gaps and not may_lack:
        raise StoreError(f"{gaps}; run the missing ones, or add --partial to merge without them")
    if not fresh and _is_merged(target, identity):
        return gaps
    first = stores[0]
    with open_writer(
        target,
        identity,
        StoredScene(first.path / SCENES / identity.scene_hash),
        fresh=fresh,
        more_files={
            folder.name: StoredScene(folder)
            for folder in sorted((first.path / SCENES).iterdir())
            if folder.name != identity.scene_hash
        },
    ) as store:
        if isinstance(store, StoreManifest) or store.done:
            raise OutputError(f"{target} holds runs of a sweep; name another place, or add --fresh")
        to = backend_at(target, OutputError)
        for source in count_steps(stores, "shards", len(stores)):
            # Traces and recorded controls are checked against their hashes.
            for sha256 in filter(
                None, source.columns.read_arrow(["controls"])["controls"].unique().to_pylist()
            ):
                name = controls_name(sha256)
                to.put_file(name, source.backend.read_file(name) or b"")
            traces = source.columns.read_arrow(["trace_file", "trace_sha256"])
            with_traces = traces.filter(traces["trace_file"].is_valid())
            names = [name.as_py() for name in with_traces["trace_file"]]
            with closing(source.backend.local_files(names)) as files:
                triples = zip(names, with_traces["trace_sha256"], files, strict=True)
                for name, sha256, path in count_steps(triples, "traces", len(names)):
                    if path is None:
                        raise StoreError(f"{source.address / name} is missing")
                    if sha256_of(path) != sha256.as_py():
                        raise StoreError(f"{source.address / name}: changed since it was written")
                    to.put_file(name, path.read_bytes())
        manifests = [store.manifest for store in stores]
        times = min(each.started for each in manifests), max(each.finished for each in manifests)
        tables = {store.address: store.path / TABLE for store in stores}
        provenance = joined_provenance([each.provenance for each in manifests])
        store.join_tables(tables, provenance, times, _merge_conclusion(stores, identity))
    return gaps


def _open_stores(places: Sequence[Address], *, may_lack: bool) -> tuple[list[Store], list[str]]:
    """Return the stores in the order of their first runs, and the reasons for omitted ones.

    Raises a StoreError if two are of different sweeps.
    """
    stores, lacking = list[Store](), list[str]()
    for place in places:
        try:
            store = Store.open(place)
        except StoreError as error:
            if not may_lack or backend_at(place, StoreError).read_file(MANIFEST) is not None:
                raise
            lacking.append(str(error).partition(";")[0])
            continue
        if store.manifest.traces_left_out:
            raise StoreError(f"{place} is a baseline without traces; merge the store itself")
        hashes = {
            f"{SCENES}/{name}": sha for name, sha in hashes_below(store.path / SCENES).items()
        }
        if hashes != _scene_files(store.manifest):
            raise StoreError(f"{place} is damaged: its scene was changed since it was written")
        stores.append(store)
    if not stores:
        raise StoreError(f"no finished store to merge: {'; '.join(lacking)}")
    stores.sort(key=lambda store: store.columns.numbers("index").values[0])
    first = stores[most_common([store.manifest.sweep for store in stores])]
    for other in stores:
        ours, theirs = first.manifest, other.manifest
        if parts := other_parts(theirs.sweep, ours.sweep):
            raise StoreError(
                f"{other.address} and {first.address} are of different sweeps: they differ in "
                f"{', '.join(parts)}"
            )
        if _scene_files(ours) != _scene_files(theirs):
            raise StoreError(
                f"{other.address} and {first.address} have different files of the scene"
            )
    return stores, lacking


def _scene_files(manifest: StoreManifest) -> dict[str, str]:
    return {name: sha for name, sha in manifest.files.items() if name.startswith(f"{SCENES}/")}


def _count_runs(stores: Sequence[Store]) -> int:
    """Return the total number of runs. Raises a StoreError with a run that two stores have."""
    places = [store.columns.numbers("index").values for store in stores]
    all_places = np.concatenate(places)
    order = np.argsort(all_places, kind="stable")
    of_store = np.repeat(np.arange(len(stores)), [len(part) for part in places])[order]
    twice = np.flatnonzero(np.diff(all_places[order]) == 0)
    if len(twice):
        one, other = (stores[store] for store in of_store[twice[0] : twice[0] + 2])
        (row,) = np.flatnonzero(one.columns.numbers("index").values == all_places[order[twice[0]]])
        if one.address == other.address:
            raise StoreError(f"{one.address} is named twice; name it once")
        both = f"{one.address} and {other.address} both have run {one.columns.run_id(row)}"
        others = f" and {plural(len(twice) - 1, 'other')}" if len(twice) > 1 else ""
        raise StoreError(f"{both}{others}; leave one out")
    return len(all_places)


def _gaps_text(stores: Sequence[Store], runs: int, lacking: Sequence[str]) -> str:
    """Return text about the runs of the grid that no store has, by missing shards if known."""
    whole = stores[0].manifest.sweep.whole
    assert whole is not None
    text = f"{whole.runs - runs:,} of {whole.runs:,} runs are in none of the stores"
    held_shards = [(shard_of(store.manifest.sweep) or "").partition("/") for store in stores]
    counts = {shards for _, _, shards in held_shards}
    max_listed = 8  # a list of shards or stores that still fits in some lines
    if len(counts) == 1 and (shards := counts.pop()):
        have = {int(number) for number, _, _ in held_shards}
        missing = [number for number in range(1, int(shards) + 1) if number not in have]
        missing_shards = ", ".join(f"{number}/{shards}" for number in missing[:max_listed])
        more = f" and {len(missing) - max_listed:,} more" if len(missing) > max_listed else ""
        noun = "shard" if len(missing) == 1 else "shards"
        text += f": {noun} {missing_shards}{more}" if missing else ""
    return "; ".join([text, *lacking[:max_listed]])


def _is_merged(target: Address, identity: SweepIdentity) -> bool:
    """Return whether an earlier merge of the same runs died at its end, after tidying it up.

    Raises an OutputError if another store is there.
    """
    backend = backend_at(target, OutputError)
    if (data := backend.read_file(MANIFEST)) is None:
        return False
    if not backend.leftover_names() or parse_manifest(data, target).sweep != identity:
        raise OutputError(f"{target} already holds a store; name another place, or add --fresh")
    with backend.write_session() as session:
        session.remove_temporaries()
        session.remove_journal()
    return True


def _merge_conclusion(stores: Sequence[Store], identity: SweepIdentity) -> Conclusion:
    """Return the function that concludes over all runs together, once they are stored."""
    store = stores[0]
    advisories = sorted({name for each in stores for name in each.manifest.advisories})
    changing = sorted({run for each in stores for run in each.manifest.unrepeatable})
    expected = any(expectation.get("mean") for expectation in identity.resolved["expect"])
    if not expected or identity.whole:
        return partial(conclude_runs, None, (), advisories, changing)
    if isinstance(identity.resolved.get("include"), dict):
        raise StoreError(
            "the sweep expects means, and a file next to it names runs, which shards do not hold; "
            "run the sweep on one machine"
        )
    scene = stored_sweep_scene(identity, store.scene_folder)
    return partial(conclude_runs, plan_again(identity, scene), (), advisories, changing)


def joined_provenance(several: Sequence[Provenance]) -> Provenance:
    """Return the versions and machines of several stores, each once."""
    hosts = [each.host for each in several]
    field_names = ("cpu_model", "cpu_flags", "os")
    host = Host(**_joined_names(hosts, field_names), cores=max(each.cores for each in hosts))
    versions = _joined_names(several, ("contactlab", "python", "numpy"))
    revisions = _joined_names(several, ("git_revision",))["git_revision"]
    return Provenance(**versions, git_revision=revisions or None, host=host)


def _joined_names(several: Iterable[object], names: Iterable[str]) -> Mapping[str, str]:
    values_by_name = {
        name: dict.fromkeys(filter(None, map(attrgetter(name), several))) for name in names
    }
    return {name: ", ".join(sorted(values)) for name, values in values_by_name.items()}
