"""A store in object storage: interrupted anywhere, resumed from anywhere, published once."""

import contextlib
from typing import Any

import pytest

from contactlab.errors import OutputError, StoreError
from contactlab.schema.evidence import StoreManifest
from contactlab.store.finished_store import Store
from contactlab.store.row_journal import with_checksum
from contactlab.store.store_files import ObjectAddress
from contactlab.store.store_writer import StoreWriter, open_writer
from contactlab.store.verify_store import find_problems

OTHER = "journal/other-00000000.jsonl"


def test_a_whole_store(kit: Any) -> None:
    manifest = kit.write(0, 1, 2)
    assert find_problems(kit.address) == []
    store = Store.open(kit.address)
    assert store.manifest == manifest
    assert [each.run_id for each in store.records()] == [each.run_id for each in kit.records]
    assert store.trace(kit.records[1]).time.shape == (5,)
    assert kit.names() == {
        ".lock",
        "manifest.json",
        "runs.parquet",
        "scenes/35472800cb1450b5/scene.xml",
        "sweep.json",
        *(each.trace.file for each in kit.records if each.trace),
    }


def test_a_finished_store_is_left_alone(kit: Any) -> None:
    manifest = kit.write(0, 1, 2)
    kit.client.put_file(OTHER, kit.row(0) + b"\n")
    assert find_problems(kit.address) == [f"{OTHER}: left over from an interrupted write"]
    with kit.opened() as store:
        assert store == manifest
    assert find_problems(kit.address) == []


def test_resumed(kit: Any) -> None:
    kit.interrupt(0)
    with pytest.raises(StoreError, match=f"{kit.address} is unfinished; run its sweep again"):
        Store.open(kit.address)
    kit.interrupt(2)
    assert kit.done() == kit.ids(0, 2)
    kit.write(1)
    assert find_problems(kit.address) == []


@pytest.mark.parametrize("damage", ["gone", "cut"])
def test_a_row_without_its_trace_is_done_again(kit: Any, damage: str) -> None:
    """Also if the trace comes to lie there again before its new row does."""
    kit.interrupt(0, 1)
    trace = kit.records[0].trace
    assert trace is not None
    if damage == "gone":
        kit.client.delete_files([trace.file])
    else:
        kit.client.put_file(trace.file, b"half")
    assert kit.done() == kit.ids(1)
    kit.put_trace(0)
    assert kit.done() == kit.ids(1)
    kit.write(0, 2)
    assert find_problems(kit.address) == []


def test_rows_of_two_sweeps(kit: Any) -> None:
    """Both did the same run: one that lost its lock without noticing, and its successor."""
    kit.interrupt(0, 1)
    kit.client.put_file(OTHER, with_checksum(kit.row(1)) + with_checksum(kit.row(0)))
    assert kit.done() == kit.ids(0, 1)
    kit.write(2)
    assert find_problems(kit.address) == []


def test_published_by_another_meanwhile(kit: Any) -> None:
    """What it published is kept, to the byte."""
    theirs = kit.write(0, 1, 2)
    whole = {name: kit.client.find_object(name) for name in ("manifest.json", "runs.parquet")}
    kit.client.delete_files(["manifest.json", "runs.parquet"])
    with kit.opened() as store:
        kit.add(store, 0, 1, 2)
        for name, found in whole.items():
            assert found is not None
            kit.client.put_file(name, found.data)
        assert isinstance(store, StoreWriter)
        assert kit.finish(store) == theirs
    for name, found in whole.items():
        again = kit.client.find_object(name)
        assert again is not None
        assert found is not None
        assert again.data == found.data
    assert find_problems(kit.address) == []


def test_published_by_another_at_the_same_moment(kit: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A manifest that appears once our table lies there does not name another table."""
    kit.write(0, 1, 2)
    found = kit.client.find_object("manifest.json")
    assert found is not None
    kit.client.delete_files(["manifest.json"])
    kind: Any = type(kit.client)
    put = kind.put_file

    def racing(client: object, name: str, data: Any) -> None:
        put(client, name, data)
        if name == "runs.parquet":
            put(client, "manifest.json", found.data)

    monkeypatch.setattr(kind, "put_file", racing)
    kit.write(0, 1, 2)
    assert find_problems(kit.address) == []


def test_other_objects_are_left_alone(kit: Any) -> None:
    kit.client.put_file("thesis/main.tex", b"dear")
    for fresh in (False, True):
        with (
            pytest.raises(OutputError, match=r"holds other files \(thesis\)"),
            kit.opened(fresh=fresh),
        ):
            pass
    found = kit.client.find_object("thesis/main.tex")
    assert found is not None
    assert found.data == b"dear"


def test_fresh(kit: Any, connect: Any) -> None:
    neighbour = connect(ObjectAddress("s3", kit.address.bucket, "some/store-2"))
    neighbour.put_file("runs.parquet", b"another's")
    kit.write(0, 1, 2)
    kit.client.put_file("traces/ff/ff.mcap", b"an orphan")
    kit.write(0, 1, 2, fresh=True)
    assert find_problems(kit.address) == []
    assert neighbour.find_object("runs.parquet") is not None


def test_another_sweeps_store(kit: Any) -> None:
    kit.interrupt(0)
    identity = kit.identity(3, plan_hash="c")
    with (
        pytest.raises(StoreError, match=f"{kit.address} holds another sweep \\(other runs\\)"),
        open_writer(kit.address, identity, kit.scene, fresh=False),
    ):
        pass


def test_failed_runs_again(kit: Any) -> None:
    """From an unfinished store and from a finished one, where nothing else is lost."""
    failed = kit.records[1].model_copy(
        update={"status": "timeout", "label": "timeout", "trace": None}
    )
    good = kit.records[1]
    kit.records = [kit.records[0], failed, kit.records[2]]
    with contextlib.suppress(KeyboardInterrupt), kit.opened() as store:
        assert isinstance(store, StoreWriter)
        store.append_rows([kit.row(1)])
        raise KeyboardInterrupt
    with kit.opened(retry_failed=True) as store:
        assert isinstance(store, StoreWriter)
        assert store.done == set()
        kit.add(store, 0, 2)
        store.append_rows([kit.row(1)])
        kit.finish(store)
    assert Store.open(kit.address).manifest.statuses == {"ok": 2, "timeout": 1}
    kit.records = [kit.records[0], good, kit.records[2]]
    with kit.opened(retry_failed=True) as store:
        assert isinstance(store, StoreWriter)
        assert store.done == kit.ids(0, 2)
        kit.add(store, 1)
        kit.finish(store)
    assert Store.open(kit.address).manifest.statuses == {"ok": 3}
    assert find_problems(kit.address) == []
    with kit.opened(retry_failed=True) as store:
        assert isinstance(store, StoreManifest)
