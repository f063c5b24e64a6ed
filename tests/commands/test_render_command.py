"""`contactlab render`: what it says, and how it refuses."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.errors import install_command
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store

Run = Callable[..., Any]


SWEEP = "{version: 1, scene: ball_drop, duration: 0.3, axes: {drop_height: [0.02]}}"


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """A store of one run, and the run's id."""
    folder = tmp_path_factory.mktemp("rendered")
    ask = read_request(SWEEP, "small", folder / "store", folder=folder, workers=0)
    run_sweep(ask, begin=lambda *_: None, progress=lambda _: None)
    [run] = Store.open(ask.store).table["run_id"].to_pylist()
    return str(ask.store), run


def test_the_file_is_named_on_stdout_and_the_scale_on_stderr(
    contactlab: Run, store: tuple[str, str]
) -> None:
    done = contactlab("render", store[0], store[1][:6], "-o", "run.mcap")
    assert (done.code, done.out) == (0, "run.mcap\n")
    assert "an arrow is the force on the second side of a pair: 0.0" in done.err
    assert Path("run.mcap").stat().st_size > 1000


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("-o", "run.avi"), "cannot write run.avi: end its name in .gif, .mcap, .mp4, "),
        (("-o", "none/run.png"), "cannot write none/run.png: there is no folder none"),
        (("-o", "run.mp4", "--at", "0.1"), "--at is for .png and .svg only; leave it out for .mp4"),
        (("-o", "run.png", "--at", "9"), "--at 9: choose a time within the run, 0 to 0.3 s"),
        (("-o", "run.png", "--at", "nan"), "--at nan: write a number"),
        (
            ("-o", "run.rrd", "--speed", "2"),
            "--speed is for .mp4 and .gif only; leave it out for .rrd",
        ),
        (("-o", "run.mp4", "--speed", "0"), "--speed takes 0.001 to 1000"),
        (("-o", "run.mp4", "--speed", "1e-9"), "--speed takes 0.001 to 1000"),
        (
            ("-o", "run.mcap", "--size", "64x64"),
            "--size, --camera and --side-by-side are for pictures",
        ),
        (("-o", "run.png", "--size", "big"), "--size big: write width and height, as in 640x480"),
        (("-o", "run.png", "--size", "641x480"), "--size takes even numbers from 64 to 4096"),
    ],
)
def test_what_does_not_fit_is_refused(
    contactlab: Run, store: tuple[str, str], arguments: tuple[str, ...], said: str
) -> None:
    done = contactlab("render", *store, *arguments)
    assert done.code == 2
    assert said in done.err
    assert done.out == ""
    assert not list(Path().glob("run*"))


def test_an_unknown_run_is_named(contactlab: Run, store: tuple[str, str]) -> None:
    done = contactlab("render", store[0], "zz", "-o", "run.mcap")
    assert done.code == 3
    assert f"no run in {store[0]} has an id that starts with 'zz'" in done.err


def test_a_run_without_trace_says_how_to_keep_one(contactlab: Run, small: Path) -> None:
    swept = contactlab("sweep", str(small), "-o", "bare", "--set", "trace=none", "--workers", "0")
    assert swept.code == 0, swept.err
    run = Store.open(Path("bare")).table["run_id"][0].as_py()
    done = contactlab("render", "bare", run, "-o", "run.mcap")
    assert done.code == 3
    assert f"no trace of run {run} was kept; sweep again with --set trace=all" in done.err


@pytest.mark.parametrize(
    ("suffix", "module", "extra"),
    [
        (".mcap", "foxglove_schemas_protobuf", "view"),
        (".rrd", "rerun", "rerun"),
        (".mp4", "av", "view"),
        (".png", "PIL", "view"),
    ],
)
def test_what_is_not_installed_is_named_with_how_to_get_it(
    contactlab: Run,
    store: tuple[str, str],
    monkeypatch: pytest.MonkeyPatch,
    suffix: str,
    module: str,
    extra: str,
) -> None:
    ours = ("contactlab.view.", f"{module}.")
    for name in [each for each in sys.modules if each.startswith(ours)]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, module, None)
    done = contactlab("render", *store, "-o", f"run{suffix}")
    assert done.code == 2
    assert f"needs {module}, which is not installed; {install_command(extra)}" in done.err
    assert not list(Path().glob("run*"))
