"""Plug-ins that raise, write, print, hang or fork: evidence stays, and says so."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from tests.plugins.test_plugin_files import METRIC, load, sweep

from contactlab.errors import PluginError, StoreError
from contactlab.measure import METRICS
from contactlab.run.recomputed_runs import simulate_again
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems

pytestmark = pytest.mark.usefixtures("forgotten")

SWEEP = """
version: 1
scene: ball_drop
duration: 0.01
trace: all
checks: none
{rest}
axes: {{timestep: [1.0e-3, 2.0e-3]}}
"""
LABEL = '''
from contactlab.plugin import Onset, label

@label("noted")
def {name}(runs):
    """A label."""
    return {{{run}: Onset("here", 0)}}
'''


def plug_in(folder: Path, body: str, rest: str = "", workers: int = 0, name: str = "own") -> Store:
    """Return the store of two runs, measured by a plug-in with this body."""
    (folder / "own.py").write_text(METRIC.format(body=body.replace("\n", "\n    ")))
    load(folder, "own.py")
    return sweep(folder, name, workers, SWEEP.format(rest=rest))


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("raise BaseException('lost')", "BaseException: lost"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("raise type('E', (BaseException,), {'__str__': lambda e: 1 / 0})", "ZeroDivisionError"),
        ("context.trace.qpos[:] = 0", "ValueError: assignment destination is read-only"),
        ("context.trace.pairs[0].slots[:] = 0", "ValueError: assignment destination is read-only"),
        ("context.net.series.normal[:] = 0", "read-only"),
        ("return [1j, 2j]", "ValueError: it returns complex numbers"),
    ],
)
def test_an_error_of_any_kind_makes_a_run_invalid(tmp_path: Path, body: str, said: str) -> None:
    for record in plug_in(tmp_path, body).records():
        assert record.label == "invalid"
        assert said in record.labels[0].reason


def test_a_metric_that_would_write_changes_no_trace(tmp_path: Path) -> None:
    plain = sweep(tmp_path, "plain", 0, SWEEP.format(rest=""))
    height = "height = context.trace.qpos[:, :, 2]\nheight -= height[:, :1]\nreturn height[:, 0]"
    bent = plug_in(tmp_path, height)
    for before, after in zip(plain.records(), bent.records(), strict=True):
        assert before.trajectory_hash == after.trajectory_hash


def test_a_process_that_a_metric_forks_returns_nothing(tmp_path: Path) -> None:
    body = "import os\nif os.fork(): os.wait()\nreturn context.trace.timestep"
    store = plug_in(tmp_path, body, workers=1)
    assert find_problems(store.path) == []


@pytest.mark.parametrize("name", ["run_id", "label", "status", "trace_file"])
def test_a_metric_has_no_name_of_another_column(tmp_path: Path, name: str) -> None:
    (tmp_path / "own.py").write_text(
        METRIC.format(body="return context.undefined()").replace("strange", name)
    )
    load(tmp_path, "own.py")
    with pytest.raises(PluginError, match=f"'{name}' is the name of a column"):
        sweep(tmp_path, text=SWEEP.format(rest=""))


def test_a_metric_is_not_a_coroutine(tmp_path: Path) -> None:
    text = METRIC.format(body="return 1").replace("\ndef ", "\nasync def ")
    (tmp_path / "own.py").write_text(text)
    with pytest.raises(PluginError, match="`async def`; write `def`"):
        load(tmp_path, "own.py")


def test_a_label_of_no_run_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(LABEL.format(name="far", run=10**9))
    load(tmp_path, "own.py")
    for record in sweep(tmp_path, text=SWEEP.format(rest="")).records():
        assert "it names run 1000000000 of" in record.labels[0].reason


PRINTS = (
    "import os, sys\nprint('::error::forged')\nsys.stderr.write('\\x1b[2Jcleared\\n')\n"
    "os.write(1, b'::set-output name=x::y\\n')\nreturn context.trace.timestep"
)


def check_printed(out: str, err: str) -> None:
    assert "\n::" not in f"\n{out}\n{err}"
    assert "\x1b" not in out + err
    assert r"\u003a:error::forged" in err
    assert r"\u003a:set-output" in err


def test_what_a_plugin_prints_is_text(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    plug_in(tmp_path, PRINTS)
    printed = capfd.readouterr()
    check_printed(printed.out, printed.err)


def test_printed_output_of_a_repeated_run_is_text(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    store = plug_in(tmp_path, PRINTS)
    capfd.readouterr()
    assert simulate_again(store, 2).problems == []
    printed = capfd.readouterr()
    check_printed(printed.out, printed.err)


@pytest.mark.parametrize("workers", [0, 1])
def test_code_that_changes_the_folder_loses_no_trace(
    tmp_path: Path, workers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The store has a relative path, as in a command."""
    monkeypatch.chdir(tmp_path)
    leave = "import os; os.chdir('/')"
    body = METRIC.format(body=f"{leave}\n    return context.trace.timestep")
    (tmp_path / "own.py").write_text(f"{leave}\n{body}")
    load(tmp_path, "own.py")
    sweep(Path(), "own", workers, SWEEP.format(rest=""))
    assert Path.cwd() == tmp_path
    assert find_problems(tmp_path / "own") == []


@pytest.mark.long
def test_what_a_plugin_prints_in_a_worker_is_text(tmp_path: Path) -> None:
    warn = "import warnings\nwarnings.warn('::error::late\\\\n', stacklevel=1)\n"
    body = METRIC.format(body=(warn + PRINTS).replace("\n", "\n    "))
    (tmp_path / "own.py").write_text(f"print('::error::loads')\n{body}")
    (tmp_path / "sweep.yaml").write_text(SWEEP.format(rest=""))
    command = [sys.executable, "-m", "contactlab", "sweep", "sweep.yaml", "--plugin", "own.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    check_printed(done.stdout, done.stderr)
    assert r"\u003a:error::loads" in done.stderr
    # Without the line of its source.
    assert "warning: " in done.stderr
    assert "warnings.warn(" not in done.stderr


@pytest.mark.long
def test_a_metric_that_hangs_is_ended_by_the_limit_of_its_run(tmp_path: Path) -> None:
    body = "while True:\n    try:\n        pass\n    except BaseException:\n        pass"
    for record in plug_in(tmp_path, body, "timeout: 0.3", workers=1).records():
        assert record.label == "timeout"


def test_a_plugin_that_is_added_is_another_sweep(tmp_path: Path) -> None:
    sweep(tmp_path, "own", 0, SWEEP.format(rest=""))
    with pytest.raises(StoreError, match="it was begun with none; loaded now: own"):
        plug_in(tmp_path, "return context.undefined()")
    assert "strange" in METRICS


def test_all_is_shown_up_to_a_limit(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    body: Any = "print('x' * 70_000)\nreturn context.trace.timestep"
    plug_in(tmp_path, body)
    assert "more bytes of printed text are left out" in capfd.readouterr().err
