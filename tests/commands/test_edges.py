"""Full outputs, early interrupts, names that are no text, absurd runs: one line each."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab import __main__ as command_line
from contactlab.command_line import main as commands

Run = Callable[..., Any]
SWEEP = "version: 1\nscene: ball_drop\nduration: {duration}\naxes: {{timestep: {timesteps}}}\n"


@pytest.mark.long
def test_a_full_device_is_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "contactlab", "list", "metrics", "--format", "json"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr == "error: cannot print the results: No space left on device\n"


def test_an_interrupt_while_the_command_loads(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(commands, "main", interrupt)
    with pytest.raises(SystemExit) as ended:
        command_line.main()
    assert ended.value.code == 130


def test_a_name_that_is_no_text_is_refused(contactlab: Run, tmp_path: Path) -> None:
    name = "gr\udcf6sse.yaml"
    (tmp_path / name).write_text("version: 1\nscene: ball_drop\nduration: 0.01\n")
    code, _, err = contactlab("sweep", name, "-o", "store", "--workers", "0")
    assert code == 2
    assert "is not UTF-8 text; rename it" in err
    assert not (tmp_path / "store").exists()


@pytest.mark.parametrize("arguments", [["--plan"], ["-o", "store", "--workers", "0"]])
@pytest.mark.parametrize(
    ("duration", "timesteps", "said"),
    [
        (0.1, "[1.0e-3, 1.0e-300]", "0.1 s in steps of 1e-300 s are too many"),
        (0.1, "[5.0e-324]", "are too many; lengthen `timestep`"),
        (10, "[1.0e-3, 1.0e-7]", "steps would record 38.0 GiB in memory; the limit is 1 GiB"),
    ],
)
def test_runs_that_no_memory_holds_are_refused_at_once(
    contactlab: Run,
    tmp_path: Path,
    arguments: list[str],
    duration: float,
    timesteps: str,
    said: str,
) -> None:
    (tmp_path / "s.yaml").write_text(SWEEP.format(duration=duration, timesteps=timesteps))
    code, _, err = contactlab("sweep", "s.yaml", *arguments)
    assert code == 2
    assert said in err
    assert not (tmp_path / "store").exists()
