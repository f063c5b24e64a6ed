"""Twelve shipped sweeps: the ids of all their runs, and records and traces of a few.

At night all of their runs are simulated; of each, the hashes are compared.
"""

import hashlib
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tests.guards.reading import (
    EVIDENCE_TOPIC,
    is_sentence,
    lasting_facts,
    nested_facts,
    parted,
    planned_facts,
    run_facts,
    run_name,
    stored_facts,
    trace_versions,
)
from tests.guards.records import Facts, Items
from tests.guards.steady import made_up_machine

# The runs of each that the first tier simulates, in the form of `--where`.
SWEEPS: Mapping[str, tuple[str, ...]] = {
    "bounce": ("restitution=0.6", "drop_height=0.5,2.0"),
    "foot-strike": ("timestep=0.004", "speed=0.5"),
    "grasp": ("timestep=0.004", "cone=elliptic", "impratio=1", "solimp=0.9 0.95 0.001 0.5 2"),
    "impact": ("restitution=0.6", "angle=40"),
    "slide": (),
    "stack": ("boxes=5",),
    "timestep-claim-ball": ("timestep=0.02",),
    "timestep-claim-disk": ("timestep=0.002",),
    "timestep-claim-grip": ("timestep=0.002", "solimp.dmin=0.9", "solref=0.005 1"),
    "timestep-claim-plate": ("timestep=0.004", "phase=0,0.43"),
    "tradeoff-ball": (
        "timestep=0.002",
        "integrator=Euler",
        "cone=pyramidal",
        "iterations=100",
        "drop_height=0.5",
    ),
    "tradeoff-stack": (
        "timestep=0.008",
        "integrator=Euler",
        "cone=pyramidal",
        "iterations=100",
        "boxes=5",
    ),
}


def planned(name: str) -> Items:
    """Return the plan of a sweep and the ids of all its runs, without any simulation."""
    # ruff: noqa: PLC0415 - collection is quick without
    from contactlab.resources import find_sweep
    from contactlab.run.planned_runs import RunIndex
    from contactlab.run.sweep_request import read_request
    from contactlab.run.sweep_runner import identity_of

    path = find_sweep(name)
    request = read_request(path, name, Path("store"), folder=path.parent, workers=0)
    index = RunIndex(request.plan, request.scene)
    runs = {
        run_name(name, run.axes, run.seed): {"run id": run.run_id} for run in index.iterate_runs()
    }
    return {
        "sweep": {name: planned_facts(identity_of(request, index))},
        "planned run": runs,
    }


def simulated(name: str, folder: Path) -> tuple[Items, Items]:
    """Simulate a few runs of a sweep in an empty folder, and return the facts and texts of each."""
    import contactlab
    from contactlab.resources import find_sweep

    source = find_sweep(name)
    written = _with_traces(source)
    with made_up_machine():
        store = contactlab.sweep(written, output=folder / name, where=SWEEPS[name], workers=0)
    runs, words = dict[str, Facts](), dict[str, Facts]()
    for record in store.records():
        data = store.trace_messages(record)
        file = (folder / name / record.trace.file).read_bytes() if record.trace else b""
        run = run_name(name, record.axes, record.seed)
        facts, words[run] = parted(run_facts(record), is_sentence)
        runs[run] = {
            **facts,
            "trace size": len(file),
            "trace bytes": _digest(file),
            "trace": trace_facts(data),
        }
    return {"store": {name: stored_facts(store)}, "run": runs}, {"run": words}


def whole_sweep(name: str, folder: Path) -> tuple[Items, Items]:
    """Simulate all runs of a sweep, and return hashes of each."""
    import contactlab

    with made_up_machine():
        store = contactlab.sweep(name, output=folder / name, workers=0)
    runs = dict[str, Facts]()
    for record in store.records():
        facts = run_facts(record)
        kept = {name: facts[name] for name in ("run_id", "label", "trajectory_hash")}
        kept["metrics"] = _digest(json.dumps(facts["metrics"], sort_keys=True).encode())[:16]
        if record.trace:
            file = (folder / name / record.trace.file).read_bytes()
            kept |= {"trace size": len(file), "trace bytes": _digest(file)[:16]}
        runs[run_name(name, record.axes, record.seed)] = kept
    return {"run": runs}, {}


def _with_traces(source: Path) -> dict[str, Any]:
    """Return a sweep that traces all runs and measures no times."""
    from ruamel.yaml import YAML

    written = YAML(typ="safe").load(source)
    written.pop("timing", None)
    return {**written, "trace": "all"}


def trace_facts(data: bytes) -> Facts:
    """Return the schema, encoding, number and digest of the messages of each topic of a trace."""
    from mcap.reader import make_reader

    reader = make_reader(io.BytesIO(data))
    digests: dict[str, Any] = {}
    counts: dict[str, int] = {}
    facts: Facts = {}
    for schema, channel, message in reader.iter_messages():
        topic = channel.topic
        if topic not in digests:
            digests[topic] = hashlib.sha256()
            said = schema and f"{schema.name} {schema.encoding} {_digest(schema.data)[:16]}"
            facts[f"channel {topic}"] = [
                f"{channel.message_encoding} of {said}",
                *(f"{key}: {value}" for key, value in sorted(channel.metadata.items())),
            ]
        held = message.data
        if topic == EVIDENCE_TOPIC:
            facts = nested_facts(lasting_facts(json.loads(held)))
            held = json.dumps(parted(facts, is_sentence)[0], sort_keys=True).encode()
        digests[topic].update(f"{message.log_time} {len(held)}\n".encode() + held)
        counts[topic] = counts.get(topic, 0) + 1
    for topic, made in sorted(digests.items()):
        facts[f"messages {topic}"] = f"{counts[topic]}, {made.hexdigest()[:16]}"
    for attachment in reader.iter_attachments():
        facts[f"attachment {attachment.name}"] = _digest(attachment.data)[:16]
    for entry in reader.iter_metadata():
        facts[f"metadata {entry.name}"] = trace_versions(entry.metadata)
    return facts


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
