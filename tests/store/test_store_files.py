"""Nothing that a store says leads out of its folder, or to anything but files and folders."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.errors import ContactlabError, StoreError
from contactlab.store.finished_store import Store
from contactlab.store.store_files import check_tree, read_stored, stored_file
from contactlab.store.store_writer import open_writer
from contactlab.store.verify_store import find_problems, write_baseline

OUTSIDE = "not for the store"
TRACE = "traces/00/" + "0" * 16 + ".mcap"


@pytest.mark.parametrize(
    "name", ["/etc/passwd", "../x", "a/../../x", "a//x", "./x", "a/", "", ".", "..", "a\0b"]
)
def test_a_name_stays_below_the_folder(tmp_path: Path, name: str) -> None:
    with pytest.raises(StoreError, match="names a file"):
        stored_file(tmp_path, name)


def test_only_regular_files_of_a_bounded_size_are_read(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "file").write_text("content")
    (tmp_path / "link").symlink_to("real")
    (tmp_path / "real" / "other").symlink_to("file")
    os.mkfifo(tmp_path / "pipe")
    assert read_stored(tmp_path, "real/file") == b"content"
    assert read_stored(tmp_path, "real/file/x") is None
    assert read_stored(tmp_path, "none") is None
    for name in ("link/file", "real/other", "pipe", "real"):
        with pytest.raises(StoreError, match="files"):
            read_stored(tmp_path, name)
    with pytest.raises(StoreError, match="more than 6"):
        read_stored(tmp_path, "real/file", most=6)


def test_a_tree_holds_folders_and_files(tmp_path: Path) -> None:
    deep = tmp_path.joinpath(*["d"] * 100)
    deep.mkdir(parents=True)
    (deep / "file").touch()
    check_tree(tmp_path)
    check_tree(tmp_path / "none")
    (deep / "link").symlink_to("file")
    with pytest.raises(StoreError, match="link is a symbolic link"):
        check_tree(tmp_path)


def changed(store: Path, **values: object) -> None:
    """Change the sweep that the manifest names."""
    path = store / "manifest.json"
    content = json.loads(path.read_text())
    content["sweep"].update(values)
    path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    "change",
    [
        {"scene_hash": "../../../evil"},
        {"scene_hash": "/etc"},
        {"scene_model": "../../../../etc/passwd"},
        {"scene_model": "/etc/passwd"},
    ],
)
def test_a_manifest_names_only_what_is_in_the_store(store: Path, change: dict[str, str]) -> None:
    changed(store, **change)
    with pytest.raises(StoreError, match="is damaged"):
        Store.open(store)


def test_a_manifest_lists_only_files_of_the_store(store: Path) -> None:
    path = store / "manifest.json"
    content = json.loads(path.read_text())
    content["files"]["../../secret"] = "0" * 64
    path.write_text(json.dumps(content))
    with pytest.raises(StoreError, match="is damaged"):
        Store.open(store)


@pytest.mark.parametrize(
    "file", ["/dev/zero", "../secret.mcap", "traces/../../x.mcap", "traces/00/../../y.mcap"]
)
def test_a_record_names_only_traces_of_the_store(file: str, store: Path) -> None:
    trace = Store.open(store).record("0" * 16).trace
    assert trace is not None
    with pytest.raises(ValueError, match="pattern"):
        type(trace).model_validate(trace.model_dump() | {"file": file})


@pytest.mark.parametrize(
    "name",
    [
        "runs.parquet",
        "manifest.json",
        "sweep.json",
        "scenes/35472800cb1450b5/scene.xml",
        "scenes",
        TRACE,
    ],
)
def test_links_out_of_a_store_are_not_followed(store: Path, tmp_path: Path, name: str) -> None:
    outside = tmp_path / "outside"
    (store / name).rename(outside)
    (store / name).symlink_to(outside)
    problems: list[str] = []
    try:
        problems = find_problems(store)
    except StoreError as error:
        problems = [str(error)]
    assert any("symbolic link" in each for each in problems)
    with pytest.raises(ContactlabError, match="symbolic link"):
        write_baseline(store, tmp_path / "baseline")


def test_a_pipe_in_place_of_a_trace_is_named(store: Path) -> None:
    (store / TRACE).unlink()
    os.mkfifo(store / TRACE)
    with pytest.raises(StoreError, match="not a regular file"):
        Store.open(store).trace("0" * 16)


@pytest.mark.parametrize(
    "name", [".lock", "journal.jsonl", "notes.jsonl", "traces", "scenes", "sweep.json.tmp"]
)
def test_resuming_writes_through_no_link(
    store: Path, tmp_path: Path, identity_of: Callable[..., Any], scene_file: Any, name: str
) -> None:
    outside = tmp_path / "outside"
    outside.write_text(OUTSIDE)
    path = store / name
    shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    path.symlink_to(outside)
    (store / "manifest.json").unlink()
    with (
        pytest.raises(ContactlabError, match="symbolic link"),
        open_writer(store, identity_of(3), scene_file, fresh=False),
    ):
        pass
    assert outside.read_text() == OUTSIDE


def test_a_left_temporary_file_is_replaced_not_followed(store: Path, tmp_path: Path) -> None:
    outside, target = tmp_path / "outside", tmp_path / "baseline"
    outside.write_text(OUTSIDE)
    write_baseline(store, target)
    (target / "manifest.json.tmp").symlink_to(outside)
    write_baseline(store, target)
    assert outside.read_text() == OUTSIDE
