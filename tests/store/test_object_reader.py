"""A store in object storage: what is wrong with it is found, and it is called by its address."""

import random
from io import BytesIO
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from contactlab.errors import OutputError, StoreError
from contactlab.run.planned_runs import local_scene
from contactlab.store.finished_store import Store
from contactlab.store.store_files import parse_address
from contactlab.store.verify_store import find_problems, write_baseline

pytestmark = pytest.mark.long

SCENE = "scenes/35472800cb1450b5/scene.xml"
TRACE = "traces/01/0000000000000001.mcap"


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        (TRACE, None, f"{TRACE}: missing"),
        (TRACE, b"changed", f"{TRACE}: changed since it was written"),
        ("traces/ff/ff.mcap", b"whose", "traces/ff/ff.mcap: belongs to no run"),
        ("sweep.json", None, "sweep.json: missing"),
        ("runs.parquet", None, "runs.parquet: missing"),
        (SCENE, b"<b/>", f"{SCENE}: changed since it was written"),
        ("notes/x.jsonl", b"{}\n", "notes/x.jsonl: left over from an interrupted write"),
    ],
)
@pytest.mark.parametrize("thorough", [True, False])
def test_planted_defects(
    kit: Any, name: str, data: bytes | None, said: str, thorough: bool
) -> None:
    kit.write(0, 1, 2)
    if data is None:
        kit.client.delete_files([name])
    else:
        kit.client.put_file(name, data)
    found = find_problems(kit.address, thorough=thorough)
    if name.endswith("ff.mcap") and not thorough:
        # Whether traces are of runs is only asked with their bytes, as in folders.
        assert found == []
    else:
        assert said in found


def test_a_changed_store_is_fetched_anew(kit: Any) -> None:
    first = kit.write(0, 1, 2)
    assert Store.open(kit.address).manifest == first
    folder = Store.open(kit.address).path
    assert Store.open(kit.address).path == folder
    again = kit.write(0, 1, 2, fresh=True)
    assert Store.open(kit.address).manifest == again


def test_a_store_that_names_files_elsewhere(kit: Any) -> None:
    manifest = kit.write(0, 1, 2)
    evil = manifest.model_copy(update={"files": {"../../evil": "0" * 64}})
    kit.client.put_file("manifest.json", evil.model_dump_json().encode())
    with pytest.raises(StoreError, match=r"is damaged: files.*must be a relative path"):
        Store.open(kit.address)


def test_no_store(bucket: str, kit: Any) -> None:
    with pytest.raises(StoreError, match=f"no store at {bucket}/none"):
        Store.open(parse_address(f"{bucket}/none"))
    kit.client.put_file("thesis.tex", b"dear")
    with pytest.raises(StoreError, match=r"is not a store: it has no manifest\.json"):
        Store.open(kit.address)


def test_messages_name_the_address(kit: Any) -> None:
    kit.write(0, 1, 2)
    store = Store.open(kit.address)
    with pytest.raises(StoreError, match=f"no run in {kit.address} "):
        store.record("zz")
    with pytest.raises(StoreError, match=f"{kit.address}/runs.parquet has no column 'x'"):
        store.columns.numbers("x")
    kit.client.put_file(TRACE, b"changed")
    with pytest.raises(StoreError, match=f"{kit.address}/{TRACE}: "):
        store.trace(kit.records[1])
    kit.client.delete_files([TRACE])
    with pytest.raises(StoreError, match=f"{kit.address}/{TRACE} is missing"):
        store.trace(kit.records[1])


def test_a_scene_for_a_worker_elsewhere(kit: Any, tmp_path: Path) -> None:
    """Fetched once, where there is none; asked of a store that is gone, it says so."""
    nowhere = tmp_path / Path(SCENE).parent
    with pytest.raises(OutputError, match=f"{kit.address}/scenes is missing"):
        local_scene(kit.address, nowhere)
    kit.interrupt()
    folder = local_scene(kit.address, nowhere)
    assert (folder / "scene.xml").read_text() == "<mujoco/>"
    assert local_scene(kit.address, nowhere) == folder
    nowhere.mkdir(parents=True)
    assert local_scene(kit.address, nowhere) == nowhere


def test_a_large_trace_goes_in_parts(kit: Any) -> None:
    data = random.Random(0).randbytes(12 << 20)  # noqa: S311 - not for secrets
    kit.client.put_file("traces/large", BytesIO(data).getbuffer())
    found = kit.client.find_object("traces/large")
    assert found is not None
    assert found.data == data
    assert kit.client.fetch_object("traces/large", kit.folder / "large")
    assert (kit.folder / "large").read_bytes() == data


def test_a_baseline_of_it(kit: Any, tmp_path: Path) -> None:
    kit.write(0, 1, 2)
    write_baseline(kit.address, tmp_path / "baseline")
    assert find_problems(tmp_path / "baseline") == []
    ids = pq.read_table(tmp_path / "baseline" / "runs.parquet")["run_id"].to_pylist()
    assert ids == [each.run_id for each in kit.records]
