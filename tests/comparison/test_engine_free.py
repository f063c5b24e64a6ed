"""Stored evidence is compared without the engine, in a process that cannot even load it."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.long

COMPARE = """
import sys
from pathlib import Path

sys.modules["mujoco"] = None
from contactlab.comparison.compare_stores import compare_stores
from contactlab.comparison.report import report_of
from contactlab.writers import as_junit, as_markdown, as_text

report = compare_stores(Path(sys.argv[1]), Path(sys.argv[2]))
assert as_text(report_of(report)) and as_markdown(report_of(report)) and as_junit(report_of(report))
loaded = {"contactlab.run", "contactlab.scene", "contactlab.engines", "scipy"} & set(sys.modules)
print(report.verdict, sorted(loaded))
"""


def test_no_engine_is_loaded(
    baseline: Path, runs: Callable[[], Any], stored: Callable[..., Path]
) -> None:
    candidate = stored("again", runs())
    done = subprocess.run(
        [sys.executable, "-c", COMPARE, str(baseline), str(candidate)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("same []\n", "")
