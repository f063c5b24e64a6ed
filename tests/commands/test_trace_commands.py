"""Compact traces: what a sweep writes, which commands read it, and `render STORE -o FOLDER`."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store

Run = Callable[..., Any]

SWEEP = """
version: 1
scene: ball_drop
duration: 0.3
trace_format: {form}
trace: "{rule}"
axes: {{timestep: [2.0e-3, 2.0e-2], drop_height: [0.02, 0.1]}}
"""


def swept(folder: Path, form: str, rule: str = "all") -> Path:
    """Return a store of 4 runs, whose traces have a form."""
    text = SWEEP.format(form=form, rule=rule)
    ask = read_request(text, "small", folder / f"{form}-{rule}", folder=folder, workers=0)
    run_sweep(ask, begin=lambda *_: None, progress=lambda _: None)
    assert isinstance(ask.store, Path)
    return ask.store


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """One sweep with compact traces, and one with messages."""
    folder = tmp_path_factory.mktemp("both")
    return swept(folder, "compact"), swept(folder, "messages")


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.rglob("*.mcap")}


@pytest.mark.long
def test_expanded_traces_are_the_messages_of_the_other_sweep(
    contactlab: Run, stores: tuple[Path, Path]
) -> None:
    compact, messages = stores
    folder = compact.with_name("expanded")
    done = contactlab("render", str(compact), "-o", str(folder))
    assert done.code == 0
    assert " ".join(done.out.split()).startswith(f"4 traces as messages in {folder}: ")
    assert files(folder) == files(messages)
    assert files(compact).keys() == files(messages).keys()
    assert all(len(each) < len(files(messages)[name]) for name, each in files(compact).items())


def test_one_run_is_expanded(contactlab: Run, stores: tuple[Path, Path]) -> None:
    run = Store.open(stores[0]).table["run_id"].to_pylist()[1]
    done = contactlab("render", str(stores[0]), run[:6], "-o", "a/b")
    assert (done.code, done.out[:30]) == (0, "1 trace as messages in a/b: 0.")
    assert files(Path("a/b")) == {f"{run}.mcap": files(stores[1])[f"{run}.mcap"]}


def test_messages_are_copied_as_they_are(contactlab: Run, stores: tuple[Path, Path]) -> None:
    assert contactlab("render", str(stores[1]), "-o", "copy").code == 0
    assert files(Path("copy")) == files(stores[1])


@pytest.mark.night
def test_commands_read_both_forms_alike(contactlab: Run, stores: tuple[Path, Path]) -> None:
    compact, messages = (str(each) for each in stores)
    run = Store.open(stores[0]).table["run_id"].to_pylist()[1]
    assert contactlab("verify", compact, "--simulate", "2").code == 0
    assert contactlab("verify", compact, run).code == 0
    compared = contactlab("compare", messages, compact, "--thorough")
    assert compared.code == 0
    assert "all bitwise equal" in compared.out
    assert contactlab("report", compact, "-o", "page.html").code == 0
    assert contactlab("render", compact, run, "-o", "compact.mcap").code == 0
    assert contactlab("render", messages, run, "-o", "messages.mcap").code == 0
    assert Path("compact.mcap").read_bytes() == Path("messages.mcap").read_bytes()


def test_records_are_the_same_but_for_the_file(stores: tuple[Path, Path]) -> None:
    one, other = (Store.open(each) for each in stores)
    for first, second in zip(one.records(), other.records(), strict=True):
        assert first.run_id == second.run_id
        assert first.trajectory_hash == second.trajectory_hash
        assert first.trace is not None
        assert second.trace is not None
        assert first.trace.messages == second.trace.messages
        assert first.trace.sha256 != second.trace.sha256


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("none", "-o", "x"), "no store at none"),
        (("STORE",), "name a run of the store, or a folder for all traces: -o FOLDER"),
        (("STORE", "zzz", "-o", "x"), "has an id that starts with 'zzz'"),
        (("STORE", "-o", "STORE/traces"), "is in the store; name another folder"),
        (("STORE", "-o", "/dev/null/x"), "cannot write /dev/null/x: Not a directory"),
    ],
)
def test_what_cannot_be_expanded_is_refused_in_one_line(
    contactlab: Run, stores: tuple[Path, Path], arguments: tuple[str, ...], said: str
) -> None:
    given = [each.replace("STORE", str(stores[0])) for each in arguments]
    before = files(stores[0])
    done = contactlab("render", *given)
    assert done.code in {2, 3}
    assert said in done.err
    assert len(done.err.splitlines()) == 1
    assert files(stores[0]) == before


@pytest.mark.long
def test_a_store_without_traces_says_so(contactlab: Run, tmp_path: Path) -> None:
    store = swept(tmp_path, "compact", "none")
    done = contactlab("render", str(store), "-o", "x")
    assert (done.code, done.out) == (3, "")
    assert "has no traces; sweep again with --set trace=all" in done.err
    assert not Path("x").exists()


def test_a_damaged_trace_is_refused(
    contactlab: Run, stores: tuple[Path, Path], tmp_path: Path
) -> None:
    store = tmp_path / "damaged"
    shutil.copytree(stores[0], store)
    path = next(store.rglob("*.mcap"))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    done = contactlab("render", str(store), path.stem, "-o", "x")
    assert done.code == 3
    assert f"{path.name}: changed since it was written" in done.err
    assert not Path("x").exists()


@pytest.mark.long
def test_a_plan_says_what_each_form_takes(contactlab: Run, small: Path) -> None:
    done = contactlab("sweep", small.name, "--plan")
    assert "MB with trace_format: compact" in done.out
    asked = ("--set", "trace_format=compact")
    assert "MB with trace_format: messages" in contactlab("sweep", small.name, "--plan", *asked).out
    text = contactlab("sweep", small.name, "--plan", "--format", "json", *asked).out
    plan = json.loads(text)
    assert plan["bytes"] == plan["bytes_by_format"]["compact"]
    assert plan["bytes"][1] < plan["bytes_by_format"]["messages"][1]
    none = contactlab("sweep", small.name, "--plan", "--set", "trace=none").out
    assert "trace_format" not in none
