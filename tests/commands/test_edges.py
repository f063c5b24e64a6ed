"""Full outputs, early interrupts, names that are no text, absurd runs: one line each."""

import os
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


@pytest.mark.long
@pytest.mark.parametrize(
    ("prefix", "variables", "problem"),
    [
        ("ulimit -n 16", {}, "a process may open 16 files here; raise the limit (ulimit -n 40)"),
        ("rmdir $PWD", {}, "the current folder was removed; change to another one"),
        ("true", {"PYTHONOPTIMIZE": "2"}, "(python -OO) libraries of contactlab fail"),
        ("true", {"MUJOCO_GL": "bad"}, "MUJOCO_GL: bad; unset it, or set it to egl, osmesa or"),
    ],
)
def test_surroundings_that_no_command_works_in_are_one_line(
    prefix: str, variables: dict[str, str], problem: str, tmp_path: Path
) -> None:
    model = Path(__file__).parent / "own_models" / "bare.xml"
    done = subprocess.run(
        ["sh", "-c", f'{prefix}; exec {sys.executable} -m contactlab lint "{model}"'],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env=os.environ | variables,
    )
    assert done.returncode == 2
    assert problem in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.long
def test_charts_are_refused_where_their_renderer_would_end_the_process() -> None:
    code = "from contactlab.charts import vega_bundle; vega_bundle()"
    done = subprocess.run(
        ["sh", "-c", f'ulimit -v 30000000; exec {sys.executable} -c "{code}"'],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"XDG_CACHE_HOME": "/nowhere"},
    )
    assert done.returncode == 1
    assert "charts need 72 GiB of address space, and the limit is 28.6 GiB" in done.stderr


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
    assert "is not UTF-8 text; rename the file" in err
    assert not (tmp_path / "store").exists()


@pytest.mark.parametrize("arguments", [["--plan"], ["-o", "store", "--workers", "0"]])
@pytest.mark.parametrize(
    ("duration", "timesteps", "said"),
    [
        (0.1, "[1.0e-3, 1.0e-300]", "0.1 s in steps of 1e-300 s are too many"),
        (0.1, "[5.0e-324]", "are too many; lengthen `timestep`"),
        (100, "[1.0e-3, 1.0e-7]", "steps would record 380.0 GiB in "),
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


@pytest.mark.parametrize(
    "words",
    [
        "compare a b --policy pipe",
        "list metrics --plugin pipe",
        "advisories check pipe",
        "examine ball_drop --waive pipe",
        "sweep pipe",
        "sweep bounce --plan --drive file=pipe",
    ],
)
def test_no_pipe_is_waited_for(contactlab: Run, tmp_path: Path, words: str) -> None:
    for name in "ab":
        (tmp_path / name).mkdir()
    os.mkfifo(tmp_path / "pipe")
    code, _, err = contactlab(*words.split())
    assert code in {2, 3}
    assert err.startswith("error: ")


@pytest.mark.parametrize("drive", ['{policy: "loop:Push"}', "{file: loop}"])
def test_a_loop_of_links_is_named(contactlab: Run, tmp_path: Path, drive: str) -> None:
    (tmp_path / "loop").symlink_to("loop")
    text = SWEEP.format(duration=0.01, timesteps="[1.0e-3]")
    (tmp_path / "small.yaml").write_text(f"{text}drive: {drive}\n")
    code, _, err = contactlab("sweep", "small.yaml", "--allow-code")
    assert code == 2
    assert "loop" in err


@pytest.mark.parametrize("option", ["--limit", "--workers"])
def test_options_have_plain_digits(
    contactlab: Callable[..., tuple[int, str, str]], option: str
) -> None:
    code, _, err = contactlab("sweep", "bounce", "--plan", option, "\uff12")
    assert (code, "write a whole number" in err) == (2, True), err
