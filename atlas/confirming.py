"""Asks plain MuJoCo for the cause that a verdict names, by `atlas/confirm.py`."""

import shlex
import subprocess
import sys
from pathlib import Path

from atlas.entry import ROOT, Confirmation, Entry

_SCRIPT = "atlas/confirm.py"
_STEPS = {"run", "reference"}  # rows that are of the steps
_SEEDS = range(3)
_SECONDS = 300


def confirmation(entry: Entry, folder: Path) -> Confirmation | None:
    """Return what plain MuJoCo shows of the first cause that an entry names, of three seeds.

    None if it names none.
    """
    report = entry.examination
    if report is None or report.budget is None or not report.budget.reasons:
        return None
    reason = report.budget.reasons[0]
    asked = ["--of", "run" if reason.row in _STEPS else reason.row, "--body", reason.body]
    if report.task.start != "qpos0":
        asked += ["--start", report.task.start]
    if report.task.own_controls:
        asked += ["--held"]
    shown = Confirmation(command="", holds=False, shown="")
    for seed in _SEEDS:
        options = [*asked, *(["--seed", str(seed)] if seed else [])]
        code, text = _run(folder / entry.name, options)
        command = shlex.join(["python", _SCRIPT, entry.name, *options])
        shown = Confirmation(command=command, holds=code == 0, shown=text)
        if shown.holds:
            break
    return shown


def _run(file: Path, options: list[str]) -> tuple[int, str]:
    asked = [sys.executable, str(ROOT / _SCRIPT), str(file), *options]
    try:
        done = subprocess.run(asked, capture_output=True, text=True, timeout=_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return 1, f"no answer within {_SECONDS} s"
    lines = (done.stdout or done.stderr).strip().splitlines()
    return done.returncode, lines[-1].partition(": ")[2] if lines else ""
