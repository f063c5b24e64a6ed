"""Plug-ins of one file: what they add reaches the store, and what is wrong with them is said."""

from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from contactlab.engines import ENGINES
from contactlab.errors import ContactlabError, PluginError, StoppedError, StoreError
from contactlab.measure import METRICS
from contactlab.plugins import (
    Plugin,
    find_extensions,
    load_plugins,
    loaded_plugins,
    require_plugins,
)
from contactlab.registry import PARTS, REGISTRIES
from contactlab.run.stored_runs import replay_run
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.run.task_bundle import pack_bundle, unpack_bundle
from contactlab.run.tasks import Task
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store
from contactlab.store.store_files import ObjectAddress
from contactlab.store.verify_store import find_problems

pytestmark = pytest.mark.usefixtures("forgotten")

TAKEN = next(iter(METRICS))
FILES = ("hover.py", "frozen_engine.py")
NAMES = ("hover", "frozen_engine")
METRIC = '''
from contactlab.measure import metric
import numpy as np

@metric(unit="m")
def strange(context):
    """Something strange."""
    {body}
'''
ONE_FAILS = """
    if (context.trace.timestep > 1.5e-3).any():
        raise KeyError("too long")
    return context.trace.timestep"""


def sweep(folder: Path, name: str = "store", workers: int = 0, text: str = "") -> Store:
    source = text or folder / "small.yaml"
    request = read_request(source, "small", folder / name, folder=folder, workers=workers)
    run_sweep(request, lambda *_: None, lambda _finished: None)
    return Store.open(folder / name)


def load(folder: Path, *names: str) -> tuple[Plugin, ...]:
    return load_plugins([folder / name for name in names])


@pytest.mark.parametrize("workers", [0, pytest.param(1, marks=pytest.mark.night)])
def test_what_a_plugin_adds_is_in_the_store(folder: Path, workers: int) -> None:
    plugins = load(folder, *FILES)
    assert [(each.name, each.version) for each in plugins] == [(name, "") for name in NAMES]
    store = sweep(folder, workers=workers)
    records = list(store.records())
    assert {(each.engine.name, each.engine.version) for each in records} >= {("frozen", "3")}
    for record in records:
        assert [each.name for each in record.plugins] == list(NAMES)
        assert [each.sha256 for each in record.plugins] == [each.sha256 for each in plugins]
        assert record.metrics["hover_height"] == 0
        assert record.metrics["oracle_error"] == 0
        assert "hovering" in {entry.label for entry in record.labels}
    assert store.manifest.sweep.plugins == records[0].plugins
    assert find_problems(folder / "store") == []
    frozen = next(each for each in records if each.engine.name == "frozen")
    assert store.trace(frozen).qpos[0].tolist() == store.trace(frozen).qpos[-1].tolist()
    assert replay_run(store, frozen.run_id).equal


def test_without_plugins_nothing_speaks_of_them(folder: Path) -> None:
    text = (folder / "small.yaml").read_text().replace("./ball", "ball_drop")
    store = sweep(folder, text=text.replace(", frozen", ""))
    assert "plugins" not in store.table.column_names
    assert "plugins" not in (folder / "store/sweep.json").read_text()
    assert "plugins" not in next(store.records()).model_dump_json()


def test_a_sweep_does_not_go_on_with_other_plugins(folder: Path) -> None:
    (first,) = load(folder, "frozen_engine.py")
    text = (folder / "small.yaml").read_text().replace("./ball", "ball_drop")
    sweep(folder, text=text)
    second = load(folder, "hover.py")[1]
    with pytest.raises(StoreError) as caught:
        sweep(folder, text=text)
    assert f"it was begun with {first}; loaded now: {first}, {second}" in str(caught.value)


def test_a_stored_run_says_which_plugin_it_needs(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    load(folder, *FILES)
    store = sweep(folder)
    run = next(each.run_id for each in store.records() if each.engine.name == "frozen")
    monkeypatch.setattr("contactlab.plugins._loaded", {})
    del ENGINES["frozen"]
    with pytest.raises(PluginError, match=r"plug-in hover .*frozen_engine .* --plugin"):
        replay_run(store, run)
    # All else is read as it is stored.
    assert store.record(run).metrics["hover_height"] == 0


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("def broken(:\n", "SyntaxError"),
        ("x = 1\nraise ValueError('no luck')\n", "line 2 of broken.py: ValueError: no luck"),
        ("import sys\nsys.exit(3)\n", "SystemExit: 3"),
        ("import contactlab_of_tomorrow\n", "No module named 'contactlab_of_tomorrow'"),
        ("x = 1\n", "it adds no metric, label, oracle, check or engine"),
        (METRIC.replace("strange(", f"{TAKEN}("), f"a metric named '{TAKEN}'"),
        (METRIC.replace('"""Something strange."""', ""), "no docstring"),
        (METRIC + "raise ValueError('late')\n", "ValueError: late"),
    ],
)
def test_a_broken_plugin_gets_one_line_and_leaves_nothing(
    source: str, message: str, tmp_path: Path
) -> None:
    before = {kind: list(registry) for kind, registry in REGISTRIES.items()}
    (tmp_path / "broken.py").write_text(source.format(body="return 0"))
    with pytest.raises(PluginError) as caught:
        load(tmp_path, "broken.py")
    text = str(caught.value)
    assert text.startswith(f"plug-in {tmp_path}/broken.py: ")
    assert message in text
    assert len(text.splitlines()) == 1
    assert {kind: list(registry) for kind, registry in REGISTRIES.items()} == before
    assert loaded_plugins() == ()


def test_a_file_that_is_missing_or_loaded_already(folder: Path) -> None:
    with pytest.raises(PluginError, match=r"no plug-in .*nowhere.py"):
        load(folder, "nowhere.py")
    assert load(folder, "hover.py") == load(folder, "hover.py")
    with (folder / "hover.py").open("a") as file:
        file.write("\n# changed\n")
    with pytest.raises(PluginError, match="start Python again"):
        load(folder, "hover.py")


def test_other_processes_load_the_same_or_nothing(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = {kind: dict(registry) for kind, registry in REGISTRIES.items()}
    plugins = load(folder, "hover.py")
    require_plugins(plugins)
    # As in another process.
    monkeypatch.setattr("contactlab.plugins._loaded", {})
    for kind, registry in REGISTRIES.items():
        registry.clear()
        registry.update(before[kind])
    (folder / "hover.py").write_text(METRIC.format(body="return context.undefined()"))
    with pytest.raises(PluginError, match=r"began with plug-in hover .* but here is hover"):
        require_plugins(plugins)
    assert "hover_height" not in METRICS


@pytest.mark.parametrize("address", ["store", ObjectAddress("s3", "bucket", "prefix")])
def test_a_file_goes_along_to_the_nodes_of_a_cluster(
    folder: Path, address: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    tasks: list[Task] = []

    def keep(task: Task, *_: object) -> None:
        tasks.append(task)
        raise StoppedError("kept")

    monkeypatch.setattr("contactlab.run.worker_pool.Worker", keep)
    plugins = load(folder, *FILES)
    with pytest.raises(StoppedError):
        sweep(folder)
    store = folder / address if isinstance(address, str) else address
    bundle = pack_bundle(replace(tasks[0], store=store))
    there = unpack_bundle(bundle, folder / "node")
    files = [each.file for each in there.plugins]
    assert files == [folder / "node/plugins" / name for name in FILES]
    assert [each.sha256 for each in there.plugins] == [each.sha256 for each in plugins]
    require_plugins(there.plugins)


@pytest.mark.long
@pytest.mark.parametrize("max_runs", [1, 32])
def test_a_metric_that_fails_is_null_and_the_run_invalid(
    folder: Path, max_runs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("contactlab.run.planned_runs.MAX_RUNS", max_runs)
    (folder / "strange.py").write_text(METRIC.format(body=ONE_FAILS))
    load(folder, *FILES, "strange.py")
    records: dict[bool, list[EvidenceRecord]] = {True: [], False: []}
    for record in sweep(folder).records():
        records[record.settings["timestep"] == 1e-3].append(record)
    assert [each.metrics["strange"] for each in records[True]] == [1e-3, 1e-3]
    assert "invalid" not in {entry.label for each in records[True] for entry in each.labels}
    for record in records[False]:
        assert (record.metrics["strange"], record.label) == (None, "invalid")
        assert record.labels[0].reason == "metric 'strange' failed: KeyError: 'too long'"
        # What else was measured is kept.
        assert record.metrics["hover_height"] == 0


@pytest.mark.long
def test_a_metric_of_the_wrong_shape_fails(folder: Path) -> None:
    (folder / "strange.py").write_text(METRIC.format(body="return np.zeros((2, 2))"))
    load(folder, *FILES, "strange.py")
    for record in sweep(folder).records():
        assert record.label == "invalid"
        assert "it returns shape (2, 2) for 1 runs" in record.labels[0].reason


@pytest.mark.long
def test_a_label_that_fails_makes_its_runs_invalid(folder: Path) -> None:
    text = (folder / "hover.py").read_text()
    broken = text.replace('runs.limits["hover"]', "(1 / 0)")
    assert broken != text
    (folder / "hover.py").write_text(broken)
    load(folder, *FILES)
    for record in sweep(folder).records():
        reason = "label 'hovering' failed: ZeroDivisionError: division by zero"
        assert (record.label, record.labels[0].reason) == ("invalid", reason)


@pytest.mark.long
@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind in PARTS for name in PARTS[kind]])
def test_every_part_is_where_it_is_said_to_be(kind: str, name: str) -> None:
    try:
        part = find_extensions(kind)[name].load()
    except ContactlabError as error:  # an extra is not installed
        pytest.skip(str(error))
    assert callable(part) or isinstance(part, ModuleType | Path)
