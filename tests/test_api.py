"""The Python interface asks what the commands ask, and gives the same answers."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

import contactlab
from contactlab.command_line.modules import command_modules
from contactlab.errors import StoreError, SweepFileError
from contactlab.schema.tradeoff_report import TradeoffReport
from contactlab.store.finished_store import Store

SWEEP = {
    "version": 1,
    "scene": "ball_drop",
    "duration": 0.2,
    "axes": {"timestep": [1e-3, 2e-3], "drop_height": [0.02, 0.1]},
}
FUNCTIONS = [name for name in contactlab.__all__ if not name.startswith("_")]


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return contactlab.sweep(SWEEP, output=tmp_path_factory.mktemp("api") / "store", workers=0)


@pytest.fixture(scope="module")
def again(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """The same sweep once more, from a file."""
    folder = tmp_path_factory.mktemp("again")
    (folder / "drops.yaml").write_text(json.dumps(SWEEP), encoding="utf-8")
    return contactlab.sweep(folder / "drops.yaml", output=folder / "store", workers=0)


def html_of(shown: object) -> str:
    """Return what a notebook shows of an object."""
    return getattr(shown, "_repr_html_")()  # noqa: B009 - its name looks private


def test_importing_it_loads_no_engine() -> None:
    code = "import contactlab, sys; assert not {'mujoco', 'numpy', 'pyarrow'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.long
def test_reading_loads_no_engine(store: Store, again: Store) -> None:
    code = (
        "import contactlab, sys; store = contactlab.open(sys.argv[1]); len(store.runs)\n"
        "contactlab.compare(*sys.argv[1:]); assert 'mujoco' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code, str(store.address), str(again.address)], check=True)


def test_its_functions_are_named_after_commands() -> None:
    # Packages have the names of three commands, and three functions are no commands.
    commands = set(command_modules()) - {"advisories"}
    assert set(FUNCTIONS) == commands | {"open", "progress", "record"}
    assert all(callable(getattr(contactlab, name)) for name in FUNCTIONS)
    assert set(FUNCTIONS) <= set(dir(contactlab))
    with pytest.raises(AttributeError, match="no attribute 'sweep_all'"):
        _ = contactlab.sweep_all  # pyright: ignore[reportAttributeAccessIssue]


def test_what_tune_cannot_do_is_said_before_anything_runs(tmp_path: Path) -> None:
    for asked, words in (({"error": 3}, "--error 3"), ({"tolerance": {"slip": 1}}, "slip")):
        with pytest.raises(SweepFileError, match=words):
            contactlab.tune("box_stack", output=tmp_path / "out", **asked)  # pyright: ignore[reportArgumentType]
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_a_name_stays_a_function_after_its_package_is_imported() -> None:
    code = (
        "import contactlab, contactlab.comparison, contactlab.reporting, contactlab.pareto\n"
        "assert all(callable(getattr(contactlab, name)) for name in ('compare', 'report'))"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_data_and_file_ask_for_the_same_runs(store: Store, again: Store) -> None:
    column = "trajectory_hash"
    assert again.table[column].to_pylist() == store.table[column].to_pylist()
    assert contactlab.compare(store, again).pairs.bitwise_equal == 4


def test_progress_counts_runs(tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []

    def count(done: int, total: int) -> None:
        calls.append((done, total))

    for _ in range(2):
        with contactlab.progress(count):
            contactlab.sweep(SWEEP, output=tmp_path / "store", workers=0)
    assert (calls[0], calls[-2], calls[-1]) == ((0, 4), (4, 4), (4, 4))


def test_settings_select_and_replace(tmp_path: Path) -> None:
    one = contactlab.sweep(
        SWEEP,
        output=tmp_path / "store",
        set={"timestep": 1e-3, "solref": "0.005 1"},
        where={"drop_height": [0.1]},
        workers=0,
    )
    [row] = one.table.select(["timestep", "solref", "drop_height"]).to_pylist()
    assert row == {"timestep": 1e-3, "solref": "0.005 1", "drop_height": 0.1}
    with pytest.raises(SweepFileError, match="solreff"):
        contactlab.sweep(SWEEP, output=tmp_path / "other", set={"solreff": 1}, workers=0)
    assert not (tmp_path / "other").exists()


def test_a_store_reads_as_data_frames(store: Store) -> None:
    frame = store.runs.to_polars()
    assert frame["run_id"].to_list() == store.table["run_id"].to_pylist()
    assert pa.table(store.runs) == store.table
    assert len(store.runs) == 4
    assert repr(store.runs) == f"<4 runs, {store.table.num_columns} columns>"
    html = html_of(store.runs)
    assert html.count("<tr>") == 5
    pandas = pytest.importorskip("pandas", reason="pandas is an extra")
    assert isinstance(store.runs.to_pandas(), pandas.DataFrame)


def test_html_is_escaped(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    table = store.table.set_column(
        store.table.column_names.index("label"), "label", pa.array(["<script>"] * 4)
    )
    monkeypatch.setitem(store.__dict__, "table", table)
    assert "<script>" not in html_of(store.runs)


def test_a_missing_store_is_named(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no store at"):
        contactlab.open(tmp_path / "none")


STUDIES: dict[str, Callable[[Path], Any]] = {
    "examine": lambda folder: contactlab.examine(
        "ball_drop", check=["task"], output=folder, workers=0
    ),
    "stability": lambda folder: contactlab.stability(["free_fall"], output=folder, workers=0),
}


@pytest.mark.long
@pytest.mark.parametrize("name", ["examine", "stability"])
def test_a_study_reports_what_its_command_prints(name: str, tmp_path: Path) -> None:
    report = STUDIES[name](tmp_path / "api")
    arguments = {"examine": ["ball_drop", "--check", "task"], "stability": ["free_fall"]}
    command = [sys.executable, "-c", "from contactlab.__main__ import main; main()", name]
    printed = subprocess.run(
        [*command, *arguments[name], "--workers", "0", "--format", "json", "-o", tmp_path / "cli"],
        capture_output=True,
        text=True,
        check=False,
    )
    said, given = json.loads(printed.stdout), report.model_dump(mode="json")
    if name == "examine":
        assert given["checks"] == said["checks"]
    else:
        assert [each["labels"] for each in given] == [each["labels"] for each in said]


def test_a_tradeoff_of_a_store_needs_no_sweep(store: Store) -> None:
    report = contactlab.tradeoff(store, metric="oracle_error")
    assert isinstance(report, TradeoffReport)
    assert report.store == str(store.address)
    assert {each.configuration["timestep"] for each in report.configurations} == {1e-3, 2e-3}
