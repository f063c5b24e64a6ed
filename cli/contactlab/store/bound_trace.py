"""Whether a trace is that of its record: what the one holds is recomputed from the other."""

import json
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from contactlab.contact.trace_arrays import hash_of_states
from contactlab.errors import StoreError
from contactlab.schema.evidence import EvidenceRecord, TraceFile
from contactlab.store.atomic_files import sha256_of
from contactlab.store.mcap.mcap_check import check_trace
from contactlab.store.mcap.stored_trace import StoredTrace
from contactlab.store.mcap.trace_reader import read_trace

ACTIVATIONS = "activations"
"""Entry of a trace's metadata: actuator activations, which are hashed but not in the trace."""
# What a record has only once its trace is written; so that equal runs have equal traces.
_LATER = ("trace", "cost", "started", "finished", "accuracy", "timing")


def trace_problems(
    path: Path, record: EvidenceRecord, model: bytes | None = None, but: Collection[str] = ()
) -> Iterator[str]:
    """Yield how a trace's file and its record contradict each other.

    Args:
        path: the file.
        record: the record of its run.
        model: the scene's model file, which the trace holds too; None if that is not compared.
        but: fields of the record that are not compared.
    """
    assert record.trace is not None
    if sha256_of(path) != record.trace.sha256:
        yield "changed since it was written"
        return
    if problems := check_trace(path):
        yield from problems
        return
    try:
        trace = read_trace(path, path.name)
        yield from _contradictions(trace, record, but)
        yield from _wrong_counts(trace, record, record.trace)
    except (StoreError, ValueError) as error:
        yield str(error)
        return
    if model is not None and trace.model_xml != model:
        yield "its model is not the scene's"


def states_are_whole(trace: StoredTrace) -> bool:
    """Return whether a trace has all that its trajectory's hash is made of."""
    return trace.metadata.get(ACTIVATIONS) == "0"


def _contradictions(
    trace: StoredTrace, record: EvidenceRecord, but: Collection[str]
) -> Iterator[str]:
    inside = _plain(EvidenceRecord.model_validate_json(trace.record_json))
    for name, value in _plain(record).items():
        # Errors have a tolerance too, which is judged after the trace is written.
        is_later = name == "tolerances_met" and record.accuracy is not None
        if inside[name] != value and name not in but and not is_later:
            yield f"its record has another {name} than the table"
    states = np.column_stack((trace.time, trace.qpos, trace.qvel))
    if states_are_whole(trace) and hash_of_states(states) != record.trajectory_hash:
        yield "its states do not give the trajectory's hash"


def _plain(record: EvidenceRecord) -> dict[str, Any]:
    content = json.loads(record.model_dump_json(exclude=set(_LATER)))
    # The table has one column of settings for all runs, with nulls for those of other runs.
    content["settings"] = {name: v for name, v in content["settings"].items() if v is not None}
    return content


def _wrong_counts(trace: StoredTrace, record: EvidenceRecord, file: TraceFile) -> Iterator[str]:
    for name, states in (
        ("its messages", len(trace.time)),
        ("the table", file.messages.get("/state")),
    ):
        if states != record.steps + 1:
            yield f"{states} states in {name} for {record.steps} steps"
