"""Code that never returns ends at a limit, with its name; Ctrl-C while all loads is quiet."""

import logging
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import contactlab
from contactlab import foreign_code
from contactlab.engines.closed_loop import load_code
from contactlab.errors import PluginError, SceneError, SweepFileError
from contactlab.foreign_code import printed_as_text
from contactlab.plugins import load_plugins

HANGS = "while True:\n    try:\n        pass\n    except Exception:\n        pass\n"
# Runs the command, and is interrupted when a module is looked for.
INTERRUPTED = """
import os, signal, sys
module = sys.argv[1]

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == module:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
from contactlab.__main__ import main
sys.argv = ["contactlab", "list", "labels"]
main()
"""


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(foreign_code, "SECONDS", 0.05)
    (tmp_path / "hangs.py").write_text(HANGS)
    return tmp_path / "hangs.py"


def test_a_file_that_never_loads(file: Path) -> None:
    with pytest.raises(
        SceneError, match=r"policy .*hangs.py: line [1-5] .*did not return within 0.05 s"
    ):
        load_code("policy", file, "Policy")


def test_a_plugin_that_never_loads(file: Path) -> None:
    with pytest.raises(
        PluginError,
        match=r"plug-in .*hangs.py: line [1-5] of hangs.py: .*did not return within 0.05 s",
    ):
        load_plugins([file])


def test_a_factory_that_never_returns(file: Path, tmp_path: Path) -> None:
    file.write_text(f"def make():\n    {HANGS.replace(chr(10), chr(10) + '    ')}")
    sweep: dict[str, Any] = {
        "version": 1,
        "scene": {"environment": f"{file}:make"},
        "duration": 0.1,
    }
    with pytest.raises(SweepFileError, match=r"environment .*hangs.py:make: .*did not return"):
        contactlab.sweep(sweep, output=tmp_path / "store", workers=0, allow_code=True)


def test_what_returns_has_no_limit_afterwards() -> None:
    before = signal.getsignal(signal.SIGALRM)
    with foreign_code.code_limit():
        assert signal.getitimer(signal.ITIMER_REAL)[0] > 0
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0
    assert signal.getsignal(signal.SIGALRM) == before


def test_the_limit_of_a_run_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(foreign_code, "SECONDS", 0.01)
    before = signal.signal(signal.SIGALRM, signal.SIG_IGN)
    signal.setitimer(signal.ITIMER_REAL, 100)
    try:
        with foreign_code.code_limit():
            assert signal.getitimer(signal.ITIMER_REAL)[0] > 1
        assert signal.getitimer(signal.ITIMER_REAL)[0] > 1
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize(
    "module", ["contactlab.startup", "typer", "contactlab.command_line.terminal"]
)
def test_an_interrupt_while_all_loads_is_quiet(module: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, module], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def test_a_logger_that_code_makes_still_writes(capfd: pytest.CaptureFixture[str]) -> None:
    """A handler keeps the stream of its making, which ends with the code."""
    logger = logging.getLogger("made_by_code")
    with printed_as_text():
        logger.addHandler(logging.StreamHandler())
    logger.warning("one")
    with printed_as_text():
        logger.warning("two")
    assert capfd.readouterr().err == "one\ntwo\n"
