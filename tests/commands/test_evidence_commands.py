"""`show`, `verify` and `replay`: what a store says of its runs."""

import importlib
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from contactlab.run.stored_runs import PreparedReplay
from contactlab.store.atomic_files import sha256_of
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems

Run = Callable[..., Any]
replaying = importlib.import_module("contactlab.run.stored_runs")


@pytest.fixture
def run_id(store: Path) -> str:
    """The third run: the first that is not stable."""
    return Store.open(store).table["run_id"][2].as_py()


def test_a_stores_summary(contactlab: Run, store: Path) -> None:
    code, out, err = contactlab("show", str(store))
    assert (code, err) == (0, "")
    assert "4 runs, 4 traces in store" in out
    summary = json.loads(contactlab("show", str(store), "--format", "json")[1])
    assert (summary["runs"], summary["traces"], summary["statuses"]) == (4, 4, {"ok": 4})


def test_a_runs_record(contactlab: Run, store: Path, run_id: str) -> None:
    code, out, err = contactlab("show", str(store), run_id[:10])
    assert (code, err) == (0, "")
    for part in (run_id, "seed 0", "penetration_max", "restitution_measured", "floor-ball"):
        assert part in out
    # A ball that drops from 0.5 m or more, and bounces.
    assert "joints moved" in out
    assert "floor-ball touched" in out
    record = json.loads(contactlab("show", str(store), run_id[:10], "--format", "json")[1])
    assert record == Store.open(store).record(run_id).model_dump(mode="json")


@pytest.mark.parametrize("command", ["show", "verify"])
def test_an_id_that_fits_no_run_or_many(contactlab: Run, store: Path, command: str) -> None:
    code, out, err = contactlab(command, str(store), "not a run")
    assert (code, out) == (3, "")
    assert err == "error: no run in store has an id that starts with 'not a run'\n"
    code, out, err = contactlab(command, str(store), "")
    assert (code, out) == (3, "")
    assert err.startswith("error: 4 runs in store have ids that start with '' (")


@pytest.mark.parametrize("arguments", [["show"], ["verify"], ["verify", "x"]])
def test_no_store(contactlab: Run, tmp_path: Path, arguments: list[str]) -> None:
    command, *rest = arguments
    for place in ("nowhere", "."):
        missing = f"error: no store at {place}; `contactlab sweep` writes one\n"
        assert contactlab(command, place, *rest) == (3, "", missing)
    assert list(tmp_path.iterdir()) == []


def test_a_sound_store(contactlab: Run, store: Path) -> None:
    digest = sha256_of(store / "manifest.json")
    physics = Store.open(store).physics
    sound = f"store is sound: 4 runs, 4 traces\nphysics  {physics}\ndigest   {digest}\n"
    again = "simulated again: 2 of 2, drawn from 4 runs; chance to find 1 forged run: 50 %"
    assert contactlab("verify", str(store)) == (0, sound, "")
    both = sound.replace("\nphysics", f"\n{again}\nphysics")
    assert contactlab("verify", str(store), "--simulate", "2") == (0, both, "")
    code, out, _ = contactlab("verify", str(store), "--format", "json")
    told: dict[str, object] = {"sound": True, "problems": [], "unverified": [], "runs": 4}
    told |= {"digest": digest, "physics": physics}
    told |= {"simulated": 0, "simulation_asked": 0}
    told |= {"store": "store", "traces": 4, "traces_left_out": False}
    assert (code, json.loads(out)) == (0, told)


def test_a_damaged_store(contactlab: Run, store: Path, tmp_path: Path) -> None:
    trace = min((tmp_path / store).rglob("*.mcap"))
    trace.unlink()
    name = trace.relative_to(tmp_path / store).as_posix()
    code, out, err = contactlab("verify", str(store))
    assert (code, out) == (3, f"{name}: missing\n")
    assert err == "error: store is not sound: 1 problem\n"
    code, out, _ = contactlab("verify", str(store), "--format", "json")
    assert (code, json.loads(out)["problems"]) == (3, [f"{name}: missing"])


def test_a_sample_looks_at_its_share_of_the_runs(contactlab: Run, store: Path, run_id: str) -> None:
    """A damaged trace is found if and only if its run is drawn, and one of four always is."""
    for share in ("25%", "1%"):  # rounded up, so that a share of a small store is not empty
        code, out, _ = contactlab("verify", str(store), "--sample", share)
        assert code == 0
        assert "not verified: records and traces of 3 runs: 1 were drawn" in out
    trace = store / f"traces/{run_id[:2]}/{run_id}.mcap"
    trace.write_bytes(trace.read_bytes()[:-100])
    for place in range(4):
        chosen = np.arange(4) == place
        assert bool(find_problems(store, chosen=chosen)) == (place == 2)
    assert contactlab("verify", str(store), "--sample", "100 %")[0] == 3


@pytest.mark.parametrize("share", ["0", "101%", "-1%", "half", "nan"])
def test_what_is_no_share(contactlab: Run, store: Path, share: str) -> None:
    code, out, err = contactlab("verify", str(store), f"--sample={share}")
    assert (code, out) == (2, "")
    assert err.startswith(f"error: --sample {share}: write a share above 0")


def test_replay_needs_only_the_store(
    contactlab: Run, store: Path, tmp_path: Path, run_id: str
) -> None:
    elsewhere = tmp_path / "far" / "away"
    shutil.copytree(tmp_path / store, elsewhere)
    shutil.rmtree(tmp_path / store)
    for run in Store.open(elsewhere).table["run_id"].to_pylist():
        code, out, err = contactlab("verify", str(elsewhere), run)
        assert (code, err) == (0, "")
        assert out.startswith(f"run {run}: bitwise equal (")
    code, out, _ = contactlab("verify", str(elsewhere), run_id[:12], "--format", "json")
    result = json.loads(out)
    assert (code, result["equal"], result["run_id"]) == (0, True, run_id)
    assert result["hash"] == result["stored_hash"]


@pytest.mark.long
def test_replay_is_by_the_engine_of_the_run(
    contactlab: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The two engines do not agree, so that the wrong one would differ."""
    monkeypatch.chdir(tmp_path)
    contactlab("sweep", "impact", "-o", "both", "--where", "angle=40")
    rows = Store.open(tmp_path / "both").table.to_pylist()
    assert {row["engine_name"] for row in rows} == {"impulse", "mujoco"}
    for engine in ("impulse", "mujoco"):
        run = next(row["run_id"] for row in rows if row["engine_name"] == engine)
        code, out, err = contactlab("verify", "both", run)
        assert (code, err) == (0, "")
        assert out.startswith(f"run {run}: bitwise equal (")


def test_replay_finds_the_first_difference(
    contactlab: Run, store: Path, run_id: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A softer contact changes nothing before the first step with contact."""
    opened = Store.open(store)
    touched = int(opened.trace(opened.record(run_id)).pairs[0].steps[0])
    prepare = replaying.prepare_replay

    def prepare_softer(store: Store, run: str) -> PreparedReplay:
        start = prepare(store, run)
        start.prepared_model.model.geom_solref[:] *= 2
        return start

    monkeypatch.setattr(replaying, "prepare_replay", prepare_softer)
    code, out, err = contactlab("verify", str(store), run_id)
    assert (code, err) == (1, "error: the trajectory differs from the stored one\n")
    assert out.startswith(f"run {run_id}: differs\n")
    assert f"\nfirst   after step {touched + 1} by " in out
    result = json.loads(contactlab("verify", str(store), run_id, "--format", "json")[1])
    assert (result["equal"], result["step"]) == (False, touched + 1)
    assert result["difference"] > 0


@pytest.mark.parametrize("is_there", [True, False])
def test_replay_tells_of_a_damaged_trace(
    contactlab: Run, store: Path, run_id: str, *, is_there: bool
) -> None:
    """The states are equal by their hash, but whoever opens the trace sees others."""
    trace = store / f"traces/{run_id[:2]}/{run_id}.mcap"
    data = bytearray(trace.read_bytes())
    data[len(data) // 2] ^= 1
    trace.write_bytes(data) if is_there else trace.unlink()
    code, out, err = contactlab("verify", str(store), run_id)
    assert code == 3
    assert out.startswith(f"run {run_id}: bitwise equal (")
    assert err.startswith(
        f"error: the stored trace is damaged: traces/{run_id[:2]}/{run_id}.mcap: "
    )
    told = json.loads(contactlab("verify", str(store), run_id, "--format", "json")[1])
    assert told["damage"] in err


def test_replay_of_a_changed_hash(contactlab: Run, store: Path, run_id: str) -> None:
    table = pq.read_table(store / "runs.parquet")
    hashes = table["trajectory_hash"].to_pylist()
    hashes[2] = "0" * 32
    index = table.schema.get_field_index("trajectory_hash")
    changed = table.set_column(index, table.schema.field(index), pa.array(hashes))
    pq.write_table(changed, store / "runs.parquet")
    code, _, err = contactlab("verify", str(store), run_id)
    assert (code, "runs.parquet was changed since it was written" in err) == (3, True)
    manifest = json.loads((store / "manifest.json").read_text())
    manifest["files"]["runs.parquet"] = sha256_of(store / "runs.parquet")
    (store / "manifest.json").write_text(json.dumps(manifest))
    code, out, _ = contactlab("verify", str(store), run_id)
    assert code == 1
    assert "after step" not in out
    assert f"\nstored  {'0' * 32} with mujoco" in out


def test_replay_of_a_changed_scene(
    contactlab: Run, store: Path, run_id: str, tmp_path: Path
) -> None:
    (scene,) = (tmp_path / store / "scenes").rglob("scene.xml")
    scene.write_text(scene.read_text() + "<!-- changed -->\n")
    code, out, err = contactlab("verify", str(store), run_id)
    assert (code, out) == (3, "")
    assert err.startswith(f"error: run {run_id}: the stored scene and settings give another id")


def test_replay_of_a_run_that_was_not_simulated(
    contactlab: Run, store: Path, run_id: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = Store.open(store).record(run_id)
    lost = record.model_copy(update={"trajectory_hash": None, "trace": None, "steps": 0})
    prepare = replaying.prepare_replay

    def prepare_lost(store: Store, run: str) -> PreparedReplay:
        return replace(prepare(store, run), record=lost)

    monkeypatch.setattr(replaying, "prepare_replay", prepare_lost)
    code, out, _ = contactlab("verify", str(store), run_id)
    assert (code, out) == (1, f"run {run_id}: no trajectory was stored\n")
