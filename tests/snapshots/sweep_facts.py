"""What six shipped sweeps, each cut down, come to: every fact of a record, a digest of each topic.

Left out is what follows clock, machine and version: times, costs, provenance, the digest of the
code, and a trace file's own digest, which holds provenance and follows the version of Zstandard.
Topics are digested as they are read back. Values are rounded to 12 digits. Trajectory hashes and
digests have all bits: another instruction set or C library may change them while the rounded
values stay.
"""

import hashlib
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tests.snapshots.facts import fact_lines, section, shared_and_own

# What is kept of each sweep, as `--only` has it.
SWEEPS: Mapping[str, tuple[str, ...]] = {
    "bounce": ("restitution=0.6", "drop_height=0.5,2.0"),
    "foot-strike": ("timestep=0.004", "speed=0.5"),
    "grasp": ("timestep=0.004", "cone=elliptic", "impratio=1", "solimp=0.9 0.95 0.001 0.5 2"),
    "impact": ("restitution=0.6", "angle=40"),
    "slide": (),
    "stack": ("boxes=5",),
}
_UNSTEADY = {"cost", "started", "finished", "provenance", "timing"}
_RECORD_TOPIC = "/evidence"
# Versions of metrics stand in the records.
_UNSTEADY_IDENTITY = {"definitions", "engine", "metric_versions"}
_OUTCOMES = {"runs", "labels", "statuses", "traces", "expectations", "unmet_means"}


def sweep_text(name: str, folder: Path) -> str:
    """Run a sweep in a folder, and return its facts."""
    import contactlab  # noqa: PLC0415 - collection is quick without

    store = contactlab.sweep(name, output=folder / name, only=SWEEPS[name], workers=0)
    records = list(store.records())
    facts = [_lasting(record.model_dump(mode="json")) for record in records]
    shared, others = shared_and_own(facts)
    identity = store.manifest.sweep.model_dump(mode="json", exclude=_UNSTEADY_IDENTITY)
    identity["source"] = _digest(identity["source"].encode())
    outcome = store.manifest.model_dump(mode="json", include=_OUTCOMES)
    described = store.columns.described.values()
    columns = [f"{column.name}: {column.type} [{column.unit}]" for column in described]
    sections = [
        section("sweep", fact_lines(identity | outcome)),
        section("columns", columns),
        section("every run", shared),
    ]
    for record, own in zip(records, others, strict=True):
        traced = _trace_lines(store.trace_messages(record)) if record.trace else []
        sections.append(section(f"run {record.run_id}: {record.label}", [*own, *traced]))
    return "".join(sections).rstrip() + "\n"


def _lasting(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts of a record that neither clock, machine nor version changes."""
    facts = {name: fact for name, fact in record.items() if name not in _UNSTEADY}
    if facts.get("trace"):
        facts["trace"] = {name: facts["trace"][name] for name in ("file", "messages")}
    # An engine of contactlab's own has its version.
    if facts["engine"]["version"] == record["provenance"]["contactlab"]:
        facts["engine"] = {"name": facts["engine"]["name"]}
    return facts


def _trace_lines(data: bytes) -> list[str]:
    """Return what a trace's file holds: how each topic is encoded, and digests of messages."""
    from mcap.reader import make_reader  # noqa: PLC0415 - collection is quick without

    reader = make_reader(io.BytesIO(data))
    digests: dict[str, Any] = {}
    lines: list[str] = []
    for schema, channel, message in reader.iter_messages():
        if channel.topic not in digests:
            digests[channel.topic] = hashlib.sha256()
            said = schema and f"{schema.name} {schema.encoding} {_digest(schema.data)}"
            lines.append(f"trace {channel.topic}: {channel.message_encoding} of {said}")
            if channel.metadata:
                lines += fact_lines(channel.metadata, f"trace {channel.topic}")
        held = message.data
        if channel.topic == _RECORD_TOPIC:
            held = "\n".join(fact_lines(_lasting(json.loads(held)))).encode()
        digests[channel.topic].update(f"{message.log_time} {len(held)}\n".encode() + held)
    lines += [f"trace {topic}: messages {made.hexdigest()}" for topic, made in digests.items()]
    for attachment in reader.iter_attachments():
        lines.append(f"trace attachment {attachment.name}: {_digest(attachment.data)}")
    for entry in reader.iter_metadata():
        ours = f" {entry.metadata['contactlab']}"
        said = {name: text.removesuffix(ours) for name, text in entry.metadata.items()}
        del said["contactlab"]
        lines += fact_lines(said, f"trace metadata {entry.name}")
    return sorted(lines)


def _digest(data: bytes) -> str:
    return f"sha256 {hashlib.sha256(data).hexdigest()}"
