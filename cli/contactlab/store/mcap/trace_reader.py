"""The arrays of a stored trace, and contradictions between it and its record."""

import hashlib
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from contactlab.contact.trace_arrays import (
    FOUND,
    POINT_FIELDS,
    SLOT_WIDTH,
    Floats,
    Integers,
)
from contactlab.disk_arrays import arrays_on_disk
from contactlab.errors import StoreError
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.mcap.compact_blocks import expand_blocks, expand_file
from contactlab.store.mcap.message_encoder import MOMENTUM_ARRAYS, PAIR_ARRAYS, STEP_ARRAYS
from contactlab.store.mcap.stored_messages import (
    UNREADABLE,
    ChannelMessages,
    find_damage,
    stored_file,
)
from contactlab.store.mcap.trace_check import check_trace
from contactlab.store.mcap.trace_messages import (
    EVIDENCE_TOPIC,
    STATE_TOPIC,
    contacts_record,
    last_state_record,
    pair_of_topic,
    point_counts,
    state_record,
)

ACTIVATIONS = "activations"
"""Entry of a trace's metadata: actuator activations, which are hashed but not in the trace."""

_TraceContent = TypeVar("_TraceContent")
_Number = TypeVar("_Number", bound=np.generic)


@dataclass(frozen=True)
class StoredPair:
    """One pair's contacts, in the M steps with contact."""

    name: str
    steps: Integers  # (M,) index of each such step, ascending
    contacts: Integers  # (M,) number of contact points stored
    # (M,) number of contacts of the pair; more than `contacts` if they exceed the slots.
    found: Integers
    mode: NDArray[np.int8]  # (M,) NO_CONTACT, STICK or SLIDE
    normal: Floats  # (M,) net normal force [N]
    tangential: Floats  # (M,) magnitude of the net tangential force [N]
    usage: Floats  # (M,) fraction of the friction limit in use
    slip: Floats  # (M,) magnitude of the force-weighted tangential velocity [m/s]
    distance: Floats  # (M,) least signed distance [m]
    # (K, 23) the contact points of all steps, concatenated; each a contact slot as in `PairTrace`,
    # rounded to single precision.
    points: Floats

    units: ClassVar[Mapping[str, str]] = {
        "contacts": "1",
        "found": "1",
        "normal": "N",
        "tangential": "N",
        "usage": "1",
        "slip": "m/s",
        "distance": "m",
    }
    """The unit of each array of measured values."""

    def spread_over_steps(
        self, steps: int, values: NDArray[_Number], apart: float = 0
    ) -> NDArray[_Number]:
        """(N,) values (M,) of the steps with contact over all N steps, `apart` in the others."""
        spread = np.full(steps, apart, dtype=values.dtype)
        spread[self.steps] = values
        return spread


@dataclass(frozen=True)
class StoredTrace:
    """One run of N steps; arrays and their time alignment are those of a run of `Trace`.

    Everything except individual contact points is bit for bit as recorded.
    """

    time: Floats
    qpos: Floats
    qvel: Floats
    kinetic: Floats
    potential: Floats
    contacts: Integers
    least_distance: Floats
    iterations: Integers
    iterations_most: Integers
    momentum: Floats | None
    angular_momentum: Floats | None
    pairs: tuple[StoredPair, ...]
    record_json: bytes  # the EvidenceRecord
    metadata: Mapping[str, str]  # the run's identity
    model_xml: bytes  # the MJCF as simulated

    units: ClassVar[Mapping[str, str]] = {
        "time": "s",
        "qpos": "m, rad",
        "qvel": "m/s, rad/s",
        "kinetic": "J",
        "potential": "J",
        "contacts": "1",
        "least_distance": "m",
        "iterations": "1",
        "iterations_most": "1",
        "momentum": "kg m/s",
        "angular_momentum": "kg m^2/s",
    }
    """The unit of each array; for coordinates, of slide and of hinge joints."""

    def pair(self, name: str) -> StoredPair:
        """Return a pair by its name. Raises a StoreError if no monitored pair has it."""
        pairs = {pair.name: pair for pair in self.pairs}
        otherwise = f"; recorded pairs: {', '.join(pairs) or 'none'}"
        StoreError.unless_known(name, pairs, f"no pair '{name}' was recorded", otherwise)
        return pairs[name]


_PAIR_ARRAYS = {"found": ("found", np.int32), **PAIR_ARRAYS}


def read_trace(path: Path, shown_path: object = None) -> StoredTrace:
    """Return the run in a trace file. A StoreError names the file by the shown path."""
    return _read_file(path, shown_path, _decode_trace)


def read_messages(path: Path, shown_path: object = None) -> bytes:
    """Return a trace file in the message form. A StoreError names it by the shown path."""
    return _read_file(path, shown_path, expand_file)


def _read_file(
    path: Path, shown_path: object, form: Callable[[bytes], _TraceContent]
) -> _TraceContent:
    shown_path = shown_path or path
    try:
        data = path.read_bytes()
    except OSError as error:
        raise StoreError(f"cannot read {shown_path}: {error.strerror}") from error
    if damage := find_damage(data):
        raise StoreError(f"{shown_path}: {damage}; repeat the run")
    try:
        # Arrays of a long trace lie in files.
        long_bytes = 32 << 20  # half a million steps of a body take ten times that in memory
        with arrays_on_disk() if len(data) > long_bytes else nullcontext():
            return form(data)
    except UNREADABLE as error:
        raise StoreError(
            f"{shown_path} is not a trace that this version of contactlab can read: {error}"
        ) from error


def _decode_trace(data: bytes) -> StoredTrace:
    file = expand_blocks(stored_file(data))
    messages = {channel.topic: file.messages[channel.id] for channel in file.channels}
    [state] = [channel for channel in file.channels if channel.topic == STATE_TOPIC]
    nq, nv = (int(state.metadata[name]) for name in ("nq", "nv"))
    arrays, times = _state_arrays(messages[STATE_TOPIC], nq, nv)
    [record_json] = messages[EVIDENCE_TOPIC].iterate_contents()
    return StoredTrace(
        **arrays,
        pairs=tuple(
            _stored_pair(pair, message, times)
            for topic, message in messages.items()
            if (pair := pair_of_topic(topic)) is not None
        ),
        record_json=record_json,
        metadata=file.metadata.metadata,
        model_xml=file.model.data,
    )


def _state_arrays(
    messages: ChannelMessages, nq: int, nv: int
) -> tuple[Mapping[str, Any], NDArray[Any]]:
    """Return the arrays of all states and steps by their names in a trace, and the log times."""
    sizes = messages.sizes
    fitting = [m for m in (0, 3) if np.all(sizes[:-1] == state_record(nq, nv, m).size)]
    if not fitting or sizes[-1] != last_state_record(nq, nv).size:
        raise ValueError(f"a state message does not hold {nq} positions and {nv} velocities")
    momentum = fitting[0]
    before = messages.pick_records(slice(None, -1), state_record(nq, nv, momentum))
    last = messages.pick_records(slice(-1, None), last_state_record(nq, nv))
    step = before["step"]
    arrays: dict[str, Any] = {
        name: np.concatenate((before[name], last[name])) for name in ("time", "qpos", "qvel")
    }
    arrays |= {name: step[field].astype(kind) for name, (field, kind) in STEP_ARRAYS.items()}
    for name, field in MOMENTUM_ARRAYS.items():
        arrays[name] = step[field].copy() if momentum else None
    return arrays, np.concatenate((before["log_time"], last["log_time"]))


def _stored_pair(name: str, messages: ChannelMessages, times: NDArray[Any]) -> StoredPair:
    """Return a pair's contacts, from the (N + 1,) log times of the states."""
    log_times = messages.heads["log_time"]
    steps = np.searchsorted(times, log_times)
    if not np.array_equal(times[np.minimum(steps, len(times) - 1)], log_times):
        raise ValueError(f"a contact of '{name}' has no state of its time")
    counts = point_counts(messages.sizes)
    arrays: dict[str, NDArray[Any]] = {
        array: np.empty(len(counts), kind) for array, (_, kind) in _PAIR_ARRAYS.items()
    }
    points = np.zeros((counts.sum(), SLOT_WIDTH))
    starts = np.cumsum(counts) - counts
    for count in np.unique(counts).tolist():
        chosen = counts == count
        items = messages.pick_records(chosen, contacts_record(count))
        for array, (field, _) in _PAIR_ARRAYS.items():
            arrays[array][chosen] = items[field]
        slots = np.empty((*items["points"].shape, SLOT_WIDTH))
        slots[..., FOUND] = items["found"][:, None]
        # Damaged bytes may be a signaling NaN.
        with np.errstate(invalid="ignore"):
            for part, columns in POINT_FIELDS.items():
                slots[..., columns] = items["points"][part]
        points[starts[chosen][:, None] + np.arange(count)] = slots
    return StoredPair(
        name=name,
        steps=steps.astype(np.int32),
        contacts=counts.astype(np.int32),
        points=points,
        **arrays,
    )


# Fields that a record gets after its trace is written, so that equal runs have equal traces.
_LATER_FIELDS = ("trace", "cost", "started", "finished", "accuracy", "timing")


def trace_problems(
    path: Path, record: EvidenceRecord, model: bytes | None = None, but: Collection[str] = ()
) -> Iterator[str]:
    """Yield contradictions between a trace file and its record, except in the fields `but`.

    The scene's model file, if given, is compared with the model in the trace.
    """
    assert record.trace is not None
    data = path.read_bytes()
    if len(data) != record.trace.bytes or hashlib.sha256(data).hexdigest() != record.trace.sha256:
        yield "changed since it was written"
        return
    if damage := find_damage(data):
        yield damage
        return
    try:
        trace = check_trace(data)
        record_json = trace.record_json
        own, stored = _plain_content(record), from_json(record_json)
        if (
            not isinstance(stored, dict)
            or {name: value for name, value in stored.items() if name not in _LATER_FIELDS} != own
        ):
            # It may be written otherwise, as by an earlier version.
            plain = _plain_content(EvidenceRecord.model_validate_json(record_json))
            for name, value in own.items():
                # Errors have tolerances, too, which are judged after the trace is written.
                is_later = name == "tolerances_met" and record.accuracy is not None
                if plain[name] != value and name not in but and not is_later:
                    yield f"its record and the table differ in {name}"
    except UNREADABLE as error:
        yield f"its content is invalid: {error}"
        return
    # The hash includes the activations, which are not in the trace.
    if trace.metadata.get(ACTIVATIONS) == "0" and trace.trajectory_hash != record.trajectory_hash:
        yield "its states do not match the trajectory's hash"
    # As many messages by topic as the table names.
    states = trace.messages[STATE_TOPIC]
    if states != record.steps + 1 or Counter(trace.messages) != Counter(record.trace.messages):
        yield f"its messages by topic do not match the table, or {record.steps} steps"
    if model is not None and trace.model_xml != model:
        yield "its model is not the scene's"


def _plain_content(record: EvidenceRecord) -> dict[str, Any]:
    content = record.model_dump(mode="json", exclude=set(_LATER_FIELDS))
    # The table has one column of settings for all runs, with nulls for settings of other runs.
    content["settings"] = {name: v for name, v in content["settings"].items() if v is not None}
    return content
