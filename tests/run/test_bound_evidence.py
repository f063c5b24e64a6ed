"""What counts is bound together: whoever bends a store and redoes its hashes is found out."""

import hashlib
import json
import shutil
import struct
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from contactlab.errors import StoreError
from contactlab.plugins import hash_of_packages
from contactlab.run.evidence_record import hash_definitions
from contactlab.run.recomputed_runs import (
    recomputed_problems,
    simulate_again,
    why_plan_unverifiable,
)
from contactlab.store.atomic_files import sha256_of
from contactlab.store.finished_store import Store
from contactlab.store.mcap.file_parts import encode_file
from contactlab.store.mcap.stored_messages import file_start_of, message_stream, stored_file
from contactlab.store.mcap.trace_messages import HEADER_SIZE
from contactlab.store.row_journal import read_lines, repair_journal, with_checksum, write_journal
from contactlab.store.runs_table import digests_of
from contactlab.store.store_files import document_json
from contactlab.store.verify_store import find_problems, unverifiable_parts

Attack = Callable[[Path], None]
SEEDS = 2


@pytest.fixture(scope="module")
def sound(make_sweeper: Callable[[Path], Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    sweeper = make_sweeper(tmp_path_factory.mktemp("sound"))
    sweeper.run(
        f"{{version: 1, scene: ball_drop, duration: 0.1, seeds: {SEEDS}, "
        "axes: {timestep: [1.0e-3, 2.0e-3], drop_height: [0.02, 0.1]}}"
    )
    return sweeper.folder / "store"


@pytest.fixture
def bent(sound: Path, tmp_path: Path) -> Path:
    """A copy that may be bent."""
    return shutil.copytree(sound, tmp_path / "bent")


def problems(store: Path) -> list[str]:
    """Return all that `contactlab verify` finds."""
    return find_problems(store) or list(recomputed_problems(Store.open_unchecked(store)))


def redo(store: Path) -> None:
    """Make every hash of a store right again."""
    manifest = Store.open_unchecked(store).manifest
    files = {name: sha256_of(store / name) for name in manifest.files}
    digest = digests_of(store / "runs.parquet")
    changed = manifest.model_copy(update={"files": files, **digest._asdict()})
    (store / "manifest.json").write_text(document_json(changed))


def rewrite(store: Path, table: pa.Table) -> None:
    pq.write_table(table, store / "runs.parquet")
    redo(store)


def edit(store: Path, column: str, change: Callable[[Any], Any], row: int = 0) -> None:
    """Change a value of the table."""
    table = pq.read_table(store / "runs.parquet")
    values = table[column].to_pylist()
    values[row] = change(values[row])
    place = table.schema.get_field_index(column)
    field = table.schema.field(column)
    rewrite(store, table.set_column(place, field, pa.array(values, field.type)))


def edited(column: str, change: Callable[[Any], Any], row: int = 0) -> Attack:
    return lambda store: edit(store, column, change, row)


def swap_traces(store: Path) -> None:
    table = pq.read_table(store / "runs.parquet")
    for name in ("trace_file", "trace_sha256", "trace_bytes", "trace_messages"):
        values = table[name].to_pylist()
        values[0], values[1] = values[1], values[0]
        place = table.schema.get_field_index(name)
        table = table.set_column(place, table.schema.field(name), pa.array(values))
    rewrite(store, table)


def reverse_rows(store: Path) -> None:
    table = pq.read_table(store / "runs.parquet")
    rewrite(store, table.take(list(range(table.num_rows))[::-1]))


def in_manifest(*path: str, value: object) -> Attack:
    """Change the manifest alone, or with the identity, which holds the same."""

    def attack(store: Path) -> None:
        for name in ("manifest.json", "sweep.json"):
            document = json.loads((store / name).read_text())
            place: Any = document if name == "manifest.json" else {"sweep": document}
            for key in path[:-1]:
                place = place.get(key, {})
            if path[-1] in place:
                place[path[-1]] = value
            (store / name).write_text(json.dumps(document))
        if path[0] == "sweep":
            redo(store)

    return attack


def edit_shared(name: str, change: Callable[[Any], Any]) -> Attack:
    """Change a field that all runs share, or add one."""

    def attack(store: Path) -> None:
        table = pq.read_table(store / "runs.parquet")
        meta = dict(table.schema.metadata)
        shared = json.loads(meta[b"contactlab.shared"])
        shared[name] = change(shared.get(name))
        meta[b"contactlab.shared"] = json.dumps(shared).encode()
        rewrite(store, table.replace_schema_metadata(meta))

    return attack


def exchange_runs(store: Path, other: int) -> None:
    """Exchange two runs, their places in the plan too, and state the hash of the new order."""
    table = pq.read_table(store / "runs.parquet")
    place, indices = table.schema.get_field_index("index"), table.column("index")
    order = [*range(table.num_rows)]
    order[0], order[other] = other, 0
    table = table.take(order).set_column(place, table.schema.field("index"), indices)
    firsts = "".join(table["run_id"].to_pylist()[::SEEDS])
    in_manifest("sweep", "plan_hash", value=hashlib.sha256(firsts.encode()).hexdigest()[:32])(store)
    rewrite(store, table)


def edit_model(store: Path) -> None:
    (model,) = (store / "scenes").rglob("scene.xml")
    model.write_text(model.read_text().replace('size="', 'size="1'))
    redo(store)


def add_scene_file(store: Path) -> None:
    (scene,) = (store / "scenes").iterdir()
    (scene / "more.xml").write_text("<mujoco/>")


def edit_messages(store: Path, change: Callable[[bytes], bytes]) -> None:
    """Change the messages of a trace, which keep their lengths, and its hashes."""
    trace = min(store.rglob("*.mcap"))
    file = stored_file(trace.read_bytes())
    stream = message_stream(file)
    data, used = stream.data.copy(), stream.sizes > 0
    for start, size in zip(stream.offsets[used].tolist(), stream.sizes[used].tolist(), strict=True):
        message = slice(start + HEADER_SIZE, start + size)
        data[message] = np.frombuffer(change(data[message].tobytes()), np.uint8)
    trace.write_bytes(encode_file(file_start_of(file), replace(stream, data=data)))
    ids = pq.read_table(store / "runs.parquet")["run_id"].to_pylist()
    edit(store, "trace_sha256", lambda _: sha256_of(trace), ids.index(trace.stem))
    edit(store, "trace_bytes", lambda _: trace.stat().st_size, ids.index(trace.stem))


def edit_energy(store: Path) -> None:
    """Change the kinetic energy of a step."""
    trace = min(store.rglob("*.mcap"))
    kinetic = struct.pack("<d", Store.open(store).trace(trace.stem).kinetic[3])
    edit_messages(store, lambda data: data.replace(kinetic, bytes(8)))


def edit_tags(store: Path) -> None:
    """Have states announce another field than their time, which comes first."""
    edit_messages(store, lambda data: data.replace(b"\x09", b"\x79", 1))


@pytest.mark.long
@pytest.mark.parametrize(
    ("attack", "said"),
    [
        (swap_traces, "its record and the table differ in run_id"),
        (
            edited("label_reason", lambda _: "all is well"),
            "its label_reason contradicts its other values",
        ),
        (edited("label", lambda _: "chatter"), "its record and the table differ in label"),
        (
            edited("penetration_max", lambda depth: depth / 2),
            "its record and the table differ in metrics",
        ),
        (edited("drop_height", lambda _: 0.05), "its record and the table differ in axes"),
        (edited("seed", lambda _: 9), "its record and the table differ in seed"),
        (
            edited("settings", lambda all_: all_ | {"iterations": 7}),
            "its record and the table differ in settings",
        ),
        (
            edited("trajectory_hash", lambda _: "0" * 32),
            "its record and the table differ in trajectory_hash",
        ),
        (
            edited("initial_qpos", lambda qpos: [0.0] * len(qpos)),
            "its record and the table differ in initial",
        ),
        (
            edited("provenance", lambda text: text.replace("3.11", "3.12")),
            "its record and the table differ in provenance",
        ),
        (reverse_rows, "its runs, in their order, do not match the plan's hash"),
        (reverse_rows, "its runs are not in the order of their index"),
        (edited("cost_cpu_s", lambda spent: 2 * spent), "its cost contradicts its other values"),
        (edited("cost_latency_budget_s", lambda _: 1e-3), "its cost contradicts its other values"),
        (edited("timing_settings", lambda _: "x"), "its accuracy or timing contradicts"),
        (edited("trace_bytes", lambda size: size + 1), "changed since it was written"),
        (
            edited("trace_messages", lambda text: text.replace(":1}", ":2}")),
            "its messages by topic do not match the table",
        ),
        (edit_shared("unitz", lambda _: 1), "differ in unitz"),
        (in_manifest("finished", value="2020-01-01T00:00:00.000+00:00"), "differ in finished"),
        (in_manifest("provenance", "host", "os", value="Plan 9"), "differ in provenance"),
        (edit_tags, "has other fields than its schema"),
        (edit_shared("units", lambda units: units | {"penetration_max": "mm"}), "differ in units"),
        (edit_shared("severity", lambda order: order[1:-1]), "its severity is not the order"),
        (
            in_manifest("sweep", "plan_hash", value="0" * 32),
            "its runs, in their order, do not match the plan's hash",
        ),
        (edit_model, "its model is not the scene's"),
        (add_scene_file, "manifest.json does not name it"),
        (in_manifest("files", value={}), "manifest.json does not name it"),
        (in_manifest("records", value="0" * 64), "its records do not match the manifest's"),
    ],
)
def test_a_bent_store_is_not_sound(bent: Path, attack: Attack, said: str) -> None:
    attack(bent)
    found = problems(bent)
    assert any(said in each for each in found), found


def drop_traces(store: Path) -> None:
    shutil.rmtree(store / "traces")
    in_manifest("traces_left_out", value=True)(store)


@pytest.mark.parametrize(
    ("attack", "said"),
    [
        (edited("seed", lambda _: 9), "the stored scene and settings give another id"),
        (edited("drop_height", lambda _: 0.05), "the stored scene and settings give another id"),
        (edited("settings", lambda all_: all_ | {"iterations": 7}), "iterations is 7, not "),
        (edited("expected", lambda _: ["stable"]), "contradicts the expectations of the sweep"),
        (edited("tolerances_met", lambda _: True), "tolerances_met contradicts its metrics"),
        (
            edited("status_reason", lambda _: "all is well"),
            "its status_reason contradicts its other values",
        ),
        (edit_model, "its files have the hash"),
        (partial(exchange_runs, other=SEEDS), "plan_hash contradicts the sweep"),
        (partial(exchange_runs, other=1), "its runs are not at their places in the plan"),
        (edited("index", lambda _: 1, 0), "not in the order of their index"),
        (edited("index", lambda _: 9, -1), "its runs are not at their places in the plan"),
        (
            edit_shared("severity", lambda order: order[::-1]),
            "severity is not the order of the labels",
        ),
        (in_manifest("sweep", "resolved", "trace", value="none"), "resolved contradicts the sweep"),
        (in_manifest("sweep", "resolved", "zip", value=None), "resolved contradicts the sweep's"),
        (in_manifest("sweep", "source", value="{version: 1"), "error["),
        (in_manifest("sweep", "overrides", value=["--limit 7"]), "contradicts the sweep's text"),
    ],
)
def test_without_traces_the_engine_tells(bent: Path, attack: Attack, said: str) -> None:
    drop_traces(bent)
    attack(bent)
    assert any(said in each for each in problems(bent))


@pytest.mark.long
@pytest.mark.parametrize(
    ("attack", "said"),
    [
        (edited("penetration_max", lambda depth: depth / 2), "penetration_max is "),
        (edited("trajectory_hash", lambda _: "0" * 32), "trajectory_hash is "),
        (edited("initial_qpos", lambda qpos: [qpos[0] + 1, *qpos[1:]]), "initial_qpos is "),
        (edited("warnings", lambda _: '{"BADQACC":1}'), "warnings is "),
        (edited("effects", lambda effects: {**effects, "limit": True}), "effects is "),
        (edited("edited_geoms", lambda _: ["ball"]), "edited_geoms is "),
        (edited("coverage", lambda _: "{}"), "coverage is "),
    ],
)
def test_without_traces_outcomes_are_told_by_simulating_again(
    bent: Path, attack: Attack, said: str
) -> None:
    drop_traces(bent)
    attack(bent)
    assert problems(bent) == []
    assert unverifiable_parts(Store.open(bent)) == [
        "trajectories, metrics and labels: the traces were left out"
    ]
    (found,) = simulate_again(Store.open(bent), 100).problems
    assert said in found


@pytest.mark.parametrize("status", ["timeout", "crashed"])
def test_a_run_with_results_did_not_end_with_its_process(bent: Path, status: str) -> None:
    drop_traces(bent)
    edit(bent, "status", lambda _: status)
    edit(bent, "status_reason", lambda _: "said so")
    assert any("its status contradicts its other values" in each for each in problems(bent))


def test_fewer_simulated_runs_than_requested_are_a_problem(bent: Path) -> None:
    in_manifest("sweep", "engine", value={"name": "mujoco", "version": "3.99.0"})(bent)
    (found,) = simulate_again(Store.open_unchecked(bent), 3).problems
    assert found.startswith("simulated again: 0 of 3: 3 run ids and settings: they are of mujoco")


@pytest.mark.long
def test_what_only_a_trace_holds_is_told_by_simulating_again(bent: Path) -> None:
    edit_energy(bent)
    assert problems(bent) == []
    (found,) = simulate_again(Store.open(bent), 100).problems
    assert found.endswith("its trace differs")


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"provenance": {"contactlab": "0.0"}}, "contactlab 0.0 wrote it"),
        ({"sweep": {"resolved": {"include": {"file": "runs.csv"}}}}, "a file next to the sweep"),
        ({"sweep": {"definitions": "0" * 64}}, "other definitions of metrics and labels"),
    ],
)
def test_what_cannot_be_planned_again_is_said(bent: Path, change: Any, why: str) -> None:
    assert why_plan_unverifiable(Store.open(bent)) is None
    path = bent / "manifest.json"
    manifest = json.loads(path.read_text())
    for part, values in change.items():
        for name, value in values.items():
            place = manifest[part]
            place[name] = place[name] | value if isinstance(value, dict) and value else value
    path.write_text(json.dumps(manifest))
    assert why in (why_plan_unverifiable(Store.open(bent)) or "")


def test_a_stored_sweep_reads_no_file_of_the_folder_that_it_is_verified_in(
    bent: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "runs.csv").write_text("timestep\n1e-3\n")
    monkeypatch.chdir(tmp_path)
    text = "{version: 1, scene: ball_drop, include: {file: runs.csv}}"
    in_manifest("sweep", "source", value=text)(bent)
    assert any("runs.csv" in each for each in problems(bent))


def test_a_sound_store_simulates_alike(sound: Path) -> None:
    assert problems(sound) == []
    assert unverifiable_parts(Store.open(sound)) == []
    assert simulate_again(Store.open(sound), 3).problems == []


def test_an_edited_table_is_not_opened(bent: Path) -> None:
    table = pq.read_table(bent / "runs.parquet")
    pq.write_table(table.slice(1), bent / "runs.parquet")
    with pytest.raises(StoreError, match="was changed since it was written; `contactlab verify"):
        Store.open(bent)
    redo(bent)
    with pytest.raises(StoreError, match=r"runs is 8, but runs\.parquet has 7"):
        Store.open(bent)


@pytest.mark.long
@pytest.mark.parametrize("repair", [False, True])
def test_runs_of_other_definitions_are_not_mixed(
    sweeper: Any, ball: str, half: Path, whole: Any, monkeypatch: pytest.MonkeyPatch, repair: bool
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("contactlab.run.sweep_runner.hash_definitions", lambda: "0" * 64)
        with pytest.raises(StoreError, match=r"prepares, measures or labels .* with --fresh$"):
            sweeper.run(ball, repair=repair)
    identity = json.loads((half / "sweep.json").read_text())
    assert identity["definitions"] == hash_definitions()
    sweeper.run(ball)
    assert sweeper.outcome() == whole


def test_definitions_are_the_code_that_makes_rows(tmp_path: Path, monkeypatch: Any) -> None:
    (tmp_path / "judged").mkdir()
    (tmp_path / "judged" / "labels.py").write_text("LIMIT = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "beside").mkdir()
    (tmp_path / "beside" / "adapter.py").write_text("STEP = 1\n")

    def found() -> str:
        return hash_of_packages(["judged"], tmp_path / "beside")

    before = found()
    assert found() == before
    (tmp_path / "judged" / "labels.py").write_text("LIMIT = 2\n")
    judged_otherwise = found()
    (tmp_path / "beside" / "adapter.py").write_text("STEP = 2\n")
    assert len({before, judged_otherwise, found()}) == 3


class StopError(Exception):
    """Ends a sweep after its first runs."""


def stop(_: object) -> None:
    raise StopError


@pytest.fixture
def half(sweeper: Any, ball: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("contactlab.run.planned_runs.MAX_RUNS", 3)
    with pytest.raises(StopError):
        sweeper.run(ball, progress=stop)
    return sweeper.folder / "store"


@pytest.fixture
def whole(sweeper: Any, ball: str) -> Any:
    sweeper.run(ball, "whole")
    return sweeper.outcome("whole")


@pytest.mark.long
def test_a_model_that_was_changed_is_not_resumed(
    sweeper: Any, ball: str, half: Path, whole: Any
) -> None:
    (model,) = (half / "scenes").rglob("scene.xml")
    model.write_text(model.read_text().replace('size="', 'size="1'))
    with pytest.raises(StoreError, match="was changed since its runs began; add --repair to copy"):
        sweeper.run(ball)
    sweeper.run(ball, repair=True)
    assert sweeper.outcome() == whole
    assert problems(half) == []


def zero_trace(store: Path) -> None:
    trace = min((store / "traces").rglob("*.mcap"))
    trace.write_bytes(bytes(trace.stat().st_size))


@pytest.mark.long
def test_a_trace_of_zeros_is_run_again(sweeper: Any, ball: str, half: Path, whole: Any) -> None:
    zero_trace(half)
    sweeper.run(ball)
    assert sweeper.began == [(18, 2)]
    assert sweeper.outcome() == whole


@pytest.mark.long
@pytest.mark.parametrize("spoil", [zero_trace, reverse_rows, edit_model, drop_traces])
def test_a_finished_store_is_repaired(sweeper: Any, ball: str, spoil: Attack, whole: Any) -> None:
    sweeper.run(ball)
    store = sweeper.folder / "store"
    spoil(store)
    if spoil is drop_traces:
        with pytest.raises(StoreError, match="is a baseline without traces; sweep again elsewhere"):
            sweeper.run(ball, repair=True)
        return
    assert problems(store) != []
    sweeper.run(ball, repair=True)
    assert sweeper.outcome() == whole
    assert problems(store) == []


@pytest.mark.long
def test_repair_of_a_sound_store_does_nothing(sweeper: Any, ball: str) -> None:
    sweeper.run(ball)
    before = (sweeper.folder / "store" / "manifest.json").stat().st_mtime_ns
    sweeper.run(ball, repair=True)
    assert (sweeper.folder / "store" / "manifest.json").stat().st_mtime_ns == before


def line_of(change: Callable[[dict[str, Any]], object]) -> Callable[[bytes], bytes]:
    """Return the change of a line's row, with a checksum of the new row."""

    def changed(line: bytes) -> bytes:
        row = json.loads(line.partition(b"\t")[0])
        return with_checksum(json.dumps(change(row) or row).encode())

    return changed


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda line: line.replace(b'"label": "stable"', b'"label": "chatte"'), "checksum"),
        (lambda line: line.replace(b"0", b"1", 1), "checksum"),
        (lambda line: line.partition(b"\t")[0] + b"\n", "checksum"),
        (lambda _: with_checksum(b"5"), "is not a JSON object"),
        (lambda _: with_checksum(b"null"), "is not a JSON object"),
        (lambda _: with_checksum(b"{}"), "is not a valid run record: run_id: Field required"),
        (lambda _: with_checksum(b"[" * 100_000), "is not JSON"),
        (
            line_of(lambda row: row.pop("label") and None),
            "is not a valid run record: label: Field required",
        ),
        (line_of(lambda row: row.update(index=0, run_id="0" * 16)), "which is not run 0 of the"),
        (line_of(lambda row: row.update(scene_hash="0" * 16)), "but the scene of this sweep is"),
        (line_of(lambda row: row.update(trace_file="../../etc/passwd")), "trace_file: "),
    ],
)
def test_a_damaged_journal_is_refused_in_one_line_then_repaired(
    sweeper: Any,
    ball: str,
    half: Path,
    whole: Any,
    change: Callable[[bytes], bytes],
    why: str,
) -> None:
    journal = half / "journal.jsonl"
    write_journal(journal, [*read_lines(journal)])
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join([lines[0], change(lines[1]), lines[2]]))
    with pytest.raises(StoreError) as raised:
        sweeper.run(ball)
    assert why in str(raised.value)
    assert "journal.jsonl, line 2 " in str(raised.value)
    assert "add --repair to keep" in str(raised.value)
    assert "\n" not in str(raised.value)
    sweeper.run(ball, repair=True)
    assert sweeper.outcome() == whole
    assert problems(half) == []


@pytest.mark.long
def test_runs_without_an_identity_are_refused_then_kept(
    sweeper: Any, ball: str, half: Path, whole: Any
) -> None:
    (half / "sweep.json").unlink()
    with pytest.raises(StoreError, match=r"has runs but no sweep\.json.*--repair.*--fresh"):
        sweeper.run(ball)
    sweeper.run(ball, repair=True)
    assert sweeper.began == [(18, 3)]
    assert sweeper.outcome() == whole


@pytest.mark.night
def test_a_journal_cut_anywhere_is_resumed(
    sweeper: Any,
    ball: str,
    half: Path,
    whole: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whole lines stay, the torn one goes; nothing else is lost or added, nor refused."""
    text = (half / "journal.jsonl").read_bytes()
    cut_journal = tmp_path / "journal.jsonl"
    # Thousands of syncs of a file would take minutes.
    monkeypatch.setattr("contactlab.store.atomic_files.sync_path", lambda _: None)
    ends = [0, *(place + 1 for place, byte in enumerate(text) if byte == ord("\n"))]
    # Each byte of a line's end, with its checksum, and of the next one's start; of the rest some.
    end = ends[-2]
    for cut in (*range(0, len(text) + 1, 37), *range(end - 100, end + 100)):
        cut_journal.write_bytes(text[:cut])
        mended = repair_journal(tmp_path, lambda _row: None, lambda _row: True)
        whole_lines = max(each for each in ends if each <= cut)
        assert cut_journal.read_bytes() == text[:whole_lines]
        # The first line is what the rows of the job share.
        assert len(mended) == max(0, ends.index(whole_lines) - 1)
    begun = shutil.copytree(half, tmp_path / "begun")
    # Around each kind of end: of nothing, of the first line, and of the last.
    picked = (ends[0], ends[1], ends[-1])
    for cut in sorted({each + by for each in picked for by in (-11, -10, -9, -1, 0, 1, 2000)}):
        shutil.rmtree(half)
        shutil.copytree(begun, half)
        (half / "journal.jsonl").write_bytes(text[: max(0, cut)])
        sweeper.run(ball)
        assert sweeper.outcome() == whole
