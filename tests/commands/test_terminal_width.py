"""What `show` prints of a store at three widths of a terminal, to the letter, and to a pipe."""

import csv
import io
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Run = Callable[..., Any]
GOLDEN = Path(__file__).with_name("terminal")
SWEEP = """
version: 1
scene: ball_drop
duration: 0.5
axes:
  timestep: [5.0e-4, 2.0e-3, 2.0e-2]
  solref: ["0.02 1", "0.005 1"]
  drop_height: {values: [0.05, 0.5, 1.0], role: scenario}
expect:
  - {where: {timestep: 5.0e-4}, metrics: {penetration_max: {max: 1}}}
trace: none
checks: none
"""


@pytest.fixture
def swept(contactlab: Run, tmp_path: Path) -> Path:
    (tmp_path / "wide.yaml").write_text(SWEEP)
    contactlab("sweep", "wide.yaml", "-o", "store", "--workers", "0")
    return tmp_path / "store"


@pytest.mark.long
@pytest.mark.usefixtures("swept")
@pytest.mark.parametrize("width", [60, 80, 120])
def test_a_summary_fits_the_terminal(
    contactlab: Run, monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    """With GOLDEN=write in the environment, what is printed is stored instead."""
    for name, value in {"FORCE_COLOR": "1", "NO_COLOR": "1", "COLUMNS": str(width)}.items():
        monkeypatch.setenv(name, value)
    printed = re.sub(r"\x1b\[[0-9;]*m", "", contactlab("show", "store").out)
    lines = [line.rstrip() for line in printed.splitlines()]
    assert max(map(len, lines)) <= width
    assert all("…" not in line for line in lines)
    text = re.sub(r"show store [0-9a-f]{8}", "show store RUN", "\n".join(lines)) + "\n"
    golden = GOLDEN / f"show-{width}.txt"
    if os.environ.get("GOLDEN") == "write":
        golden.write_text(text)
    assert text == golden.read_text()


@pytest.mark.long
def test_a_pipe_gets_all_and_may_close_early(contactlab: Run, swept: Path) -> None:
    assert "other labels" in contactlab("show", "store").out
    rows = list(csv.DictReader(io.StringIO(contactlab("show", "store", "--format", "csv").out)))
    assert len(rows) == 18
    assert {row["timestep"] for row in rows} == {"0.0005", "0.002", "0.02"}
    assert all(float(row["penetration_max"]) > 0 for row in rows if row["penetration_max"])
    empty = {name for name in rows[0] if not any(row[name] for row in rows)}
    assert empty <= {"expectation_met"}
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "contactlab", "show", str(swept)]
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, check=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, b"")


def test_help_has_examples_and_exit_codes(contactlab: Run) -> None:
    for name in ("sweep", "examine", "show", "report", "compare"):
        out = contactlab(name, "-h").out
        assert f"Examples:\n    contactlab {name} " in out
        assert "Exit codes: 0 " in out
