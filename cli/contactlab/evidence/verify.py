"""Check a store: every file against its hash, every record against its schema, every trace."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from pydantic import ValidationError

from contactlab.errors import StoreError
from contactlab.evidence.files import TEMPORARY, sha256_of
from contactlab.evidence.identity import IDENTITY, MANIFEST, read_identity
from contactlab.evidence.journal import JOURNAL
from contactlab.evidence.mcap import check_trace
from contactlab.evidence.store import Store
from contactlab.evidence.table import tally
from contactlab.evidence.writer import TRACES
from contactlab.schema import EvidenceRecord, TraceFile


def verify(path: Path) -> list[str]:
    """Return what is wrong with a store, in words; nothing if it is sound.

    Raises:
        StoreError: it cannot be opened at all.
    """
    store = Store.open(path)
    return [*_files(store), *_identity(store), *_records(store)]


def _files(store: Store) -> Iterator[str]:
    for name, expected in store.manifest.files.items():
        path = store.path / name
        if not path.is_file():
            yield f"{name}: missing"
        elif sha256_of(path) != expected:
            yield f"{name}: changed since it was written"
    leftovers = [*store.path.glob(JOURNAL), *store.path.rglob("*" + TEMPORARY)]
    for leftover in sorted(leftovers):
        yield f"{leftover.relative_to(store.path)}: left over from an interrupted write"


def _identity(store: Store) -> Iterator[str]:
    try:
        same = read_identity(store.path) == store.manifest.sweep
    except StoreError:
        # Missing or changed, which its hash tells.
        return
    if not same:
        yield f"{IDENTITY}: names another sweep than {MANIFEST}"


def _records(store: Store) -> Iterator[str]:
    try:
        records = list(store.records())
    except (StoreError, ValidationError, KeyError, ValueError) as error:
        yield f"runs.parquet: a record does not fit its schema: {error}"
        return
    yield from _counts(store)
    named: set[str] = set()
    for record in records:
        if record.trace is not None:
            named.add(record.trace.file)
            yield from _trace(store, record, record.trace)
    for path in sorted((store.path / TRACES).rglob("*.mcap")):
        name = path.relative_to(store.path).as_posix()
        if name not in named:
            yield f"{name}: belongs to no run"


def _counts(store: Store) -> Iterator[str]:
    manifest = store.manifest
    for name, found in tally(store.table).items():
        said = getattr(manifest, name)
        if said != found:
            yield f"manifest.json: {name} is {said}, but runs.parquet has {found}"
    if manifest.runs != manifest.sweep.runs_asked:
        yield f"manifest.json: {manifest.runs} runs, but {manifest.sweep.runs_asked} were asked for"
    for run_id, count in Counter(store.table["run_id"].to_pylist()).items():
        if count > 1:
            yield f"runs.parquet: run {run_id} stands {count} times"


def _trace(store: Store, record: EvidenceRecord, trace: TraceFile) -> Iterator[str]:
    path = store.path / trace.file
    if not path.is_file():
        yield f"{trace.file}: missing"
    elif sha256_of(path) != trace.sha256:
        yield f"{trace.file}: changed since it was written"
    else:
        yield from (f"{trace.file}: {problem}" for problem in check_trace(path))
        states = trace.messages.get("/state", 0)
        if states != record.steps + 1:
            yield f"{trace.file}: {states} states for {record.steps} steps"
