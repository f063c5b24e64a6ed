"""The readers of files that people and programs exchange, each with a sound file to start from."""

import hashlib
import io
import json
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from mcap.writer import MCAP0_MAGIC, Writer
from tests.attack.attack import MODEL, SWEEP, make_store
from tests.attack.mutations import reseal
from tests.random_traces import random_trace
from tests.written_traces import find_defect

from contactlab.contact.trace_arrays import RecordedControls
from contactlab.plan.sweep_file import read_sweep, read_yaml_as
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.scene_source import find_scene, read_manifest
from contactlab.schema.comparison import ComparePolicy
from contactlab.store.control_tables import read_control_table
from contactlab.store.controls_file import encode_controls
from contactlab.store.finished_store import Store
from contactlab.store.mcap.trace_reader import read_trace
from contactlab.store.mcap.trace_writer import TraceEncoder
from contactlab.store.row_journal import write_journal
from contactlab.store.runs_table import iterate_rows
from contactlab.store.store_files import parse_identity, parse_manifest
from contactlab.store.store_writer import open_writer
from contactlab.store.verify_store import find_problems

POLICY = b"""
version: 1
match: id
metrics:
  "time_*": {level: note}
labels: {allow: [{from: stable, to: chatter, max: 1, reason: known}]}
waive: [{check: no new chatter, max: 1, reason: known, until: 2030-01-01}]
"""
SCENE = b"""
version: 1
title: A ball
description: It falls.
model: model.xml
duration: 0.1
subject: ball
initial:
  height: {default: 0.1, unit: m, description: how high, sets: {ball.z: height + 0.1}}
pairs: [{geoms: [floor, ball], slots: 4}]
tolerances: {penetration_max: 1.0e-3}
"""
_TAIL = struct.Struct("<BQQQI8s")
_DATA_END = struct.Struct("<BQI")


@dataclass(frozen=True)
class Reader:
    """A reader of one kind of file.

    Attributes:
        sound: a file that it reads.
        read: reads such a file, given its bytes.
    """

    sound: bytes
    read: Callable[[bytes], object]


def readers(folder: Path) -> dict[str, Reader]:
    """Return all readers by name; they write what they are given into a folder."""
    store = make_store(folder / "made")
    trace = min(store.rglob("*.mcap"))

    def in_file(name: str, read: Callable[[Path], object]) -> Callable[[bytes], object]:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)

        def write_and_read(data: bytes) -> object:
            path.write_bytes(data)
            return read(path)

        return write_and_read

    scenes = SceneLoader(folder / "made")

    def read_traces(path: Path) -> None:
        find_defect(path.read_bytes())
        read_trace(path)

    def read_sealed_traces(path: Path) -> None:
        path.write_bytes(with_checksums(path.read_bytes()))
        read_traces(path)

    (folder / "scene").mkdir()
    (folder / "scene" / "model.xml").write_text(MODEL.format(height=0.1))
    return {
        "sweep": Reader(
            SWEEP.format(drive="hold").encode(),
            in_file("sweep.yaml", lambda p: read_sweep(p, scenes.vocabulary)),
        ),
        "scene": Reader(SCENE, in_file("scene/scene.yaml", read_manifest)),
        "model": Reader(
            MODEL.format(height=0.1).encode(),
            in_file("model.xml", lambda path: find_scene(str(path))),
        ),
        "policy": Reader(POLICY, in_file("policy.yaml", lambda p: read_yaml_as(p, ComparePolicy))),
        "manifest": Reader(
            (store / "manifest.json").read_bytes(), lambda d: parse_manifest(d, store)
        ),
        "identity": Reader((store / "sweep.json").read_bytes(), lambda d: parse_identity(d, store)),
        "trace": Reader(trace.read_bytes(), in_file("a.mcap", read_traces)),
        "trace with checksums": Reader(trace.read_bytes(), in_file("b.mcap", read_sealed_traces)),
        "compact trace with checksums": Reader(
            _compact_trace(), in_file("c.mcap", read_sealed_traces)
        ),
        "table": Reader((store / "runs.parquet").read_bytes(), _TableReader(store).read),
        **{
            f"drive {ending}": Reader(data, in_file(f"drive.{ending}", read_control_table))
            for ending, data in _drives(folder).items()
        },
        **_journal_readers(make_store(folder / "unfinished")),
    }


def _compact_trace() -> bytes:
    trace, series = random_trace(pairs=("a-b", "c-d"), steps=40)
    said = b"{}", {"seed": "0"}, b"<mujoco/>"
    return TraceEncoder(trace, series).encode_run(0, *said, form="compact")[0]


def _drives(folder: Path) -> dict[str, bytes]:
    """Return tables of controls of three actuators, two of them in a column of vectors."""
    times, levels = np.linspace(0, 0.04, 5), np.ones((5, 2))
    columns = pa.table({"time": times, "hip": times, "knees": list(levels)})
    npz, parquet = io.BytesIO(), io.BytesIO()
    np.savez(npz, time=times, hip=times, knees=levels)
    pq.write_table(columns, parquet)
    rows = "".join(f"{time},{time},1,1\n" for time in times)
    arrow = encode_controls(RecordedControls(times, levels), ["hip", "knee"])
    path = folder / "made.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/joints", "json", 0)
        for time in times:
            said = json.dumps({"name": ["hip", "knee"], "position": [time, 1]}).encode()
            writer.add_message(channel, int(time * 1e9), said, int(time * 1e9))
        writer.finish()
    return {
        "csv": f"time,hip,knee[0],knee[1]\n{rows}".encode(),
        "npz": npz.getvalue(),
        "parquet": parquet.getvalue(),
        "arrow": arrow,
        "mcap": path.read_bytes(),
    }


def with_checksums(data: bytes) -> bytes:
    """Return an MCAP file with the checksums of what it holds now."""
    tail = len(data) - _TAIL.size
    if tail < 0:
        return data
    opcode, length, start, offsets, _, _ = _TAIL.unpack_from(data, tail)
    if not len(MCAP0_MAGIC) + _DATA_END.size <= start <= tail:
        return data
    end = start - _DATA_END.size
    data_end = _DATA_END.pack(0x0F, 4, zlib.crc32(data[:end]))
    footer = data[start:tail] + struct.pack("<BQQQ", opcode, length, start, offsets)
    crc = struct.pack("<I", zlib.crc32(footer))
    return data[:end] + data_end + footer + crc + MCAP0_MAGIC


@dataclass(frozen=True)
class _TableReader:
    store: Path

    def read(self, data: bytes) -> None:
        """Read a table whose hash the manifest states."""
        (self.store / "runs.parquet").write_bytes(data)
        path = self.store / "manifest.json"
        manifest = json.loads(path.read_text())
        manifest["files"]["runs.parquet"] = hashlib.sha256(data).hexdigest()
        path.write_text(json.dumps(manifest))
        find_problems(self.store)
        opened = Store.open(self.store)
        for record in opened.records():
            opened.record(record.run_id)


def _journal_readers(store: Path) -> dict[str, Reader]:
    """Return readers of a journal: as it is, and with the checksum of each line redone."""
    rows = list(iterate_rows(store / "runs.parquet"))
    identity = Store.open(store).manifest.sweep
    scene = find_scene(str(store.parent / "model.xml")).content
    for name in ("manifest.json", "runs.parquet"):
        (store / name).unlink()
    journal = store / "journal.jsonl"
    write_journal(journal, rows)
    sound = journal.read_bytes()

    def resume(data: bytes) -> None:
        journal.write_bytes(data)
        with open_writer(store, identity, scene, fresh=False) as writer:
            assert writer

    def resume_sealed(data: bytes) -> None:
        journal.write_bytes(data)
        reseal(store)
        resume(journal.read_bytes())

    return {
        "journal": Reader(sound, resume),
        "journal with checksums": Reader(sound, resume_sealed),
    }
