"""Asks plain MuJoCo for the cause that a verdict names, by `bench/atlas/confirm.py`."""

import shlex
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from bench.atlas.entry import ROOT, Confirmation, Entry
from bench.atlas.mending import write_fixed_models

from contactlab.modifications.catalogue import find_softness_rows
from contactlab.run.sweep_request import SceneLoader
from contactlab.schema.examination import Examination
from contactlab.tasks.task_motions import task_motions, with_new_seeds

SCRIPT = "bench/atlas/confirm.py"
_STEPS = ("numerical error", "reference")  # reasons that concern the steps
_OF_LABELS = {
    "constraint_violated": ["--of", "limit"],
    "tunneling": ["--of", "depth"],
    "broken": ["--of", "depth"],
    "diverged": ["--of", "warning"],
    "solver_nonconvergence": ["--of", "iterations"],
    "energy_injection": ["--of", "gain", "--body", "world"],  # of the whole model
    "energy_loss": ["--of", "loss", "--body", "world"],
}
_SEEDS = range(3)
_SECONDS = 60


def questions(entry: Entry) -> list[str]:
    """Return the options that ask for the first cause that an entry names, or nothing."""
    report, asked = entry.examination, _cause(entry)
    if report is None or not asked:
        return []
    if report.task.start != "qpos0":
        asked += ["--start", report.task.start]
    return [*asked, "--held"] if report.task.own_controls else asked


def confirmed(entry: Entry, file: Path, asked: Sequence[str]) -> Confirmation:
    """Return what plain MuJoCo shows of a cause.

    Three seeds of controls of its own are tried, then those of the task.
    """
    shown = Confirmation(command="", holds=False, shown="")
    for seed in _SEEDS:
        options = [*asked, *(["--seed", str(seed)] if seed else [])]
        code, text = _run(file, options)
        command = shlex.join(["python", SCRIPT, entry.name, *options])
        shown = Confirmation(command=command, holds=code == 0, shown=text)
        if shown.holds:
            return shown
    with TemporaryDirectory(prefix="atlas-") as place:
        stored = Path(place) / "inputs.npz"
        for seed in _SEEDS:
            write_inputs(file, stored, seed)
            code, text = _run(file, [*asked, "--inputs", str(stored)])
            if code == 0:
                write = ["python", "-m", "bench.atlas", "inputs", entry.name, stored.name]
                write += ["--seed", str(seed)] if seed else []
                show = ["python", SCRIPT, entry.name, *asked, "--inputs", stored.name]
                command = f"{shlex.join(write)}\n{shlex.join(show)}"
                return Confirmation(command=command, holds=True, shown=text)
    return shown


def nearer(entry: Entry, file: Path, folder: Path) -> Iterator[tuple[str, bool, str]]:
    """Yield, of each change that was judged, its name, whether it is nearer, and what is shown.

    The model with it is written into the folder from the record's own words, and compared with the
    original over the original's task, by inputs of a seed that no change was chosen by.
    """
    report = entry.examination
    if report is None:
        return
    reasons = report.budget.reasons if report.budget else ()
    row = reasons[0].row if reasons and reasons[0].row not in _STEPS else "run"
    row = "run" if row == "solver" else row
    # Of labels that stiffer parts remove: the first row whose change is meant then.
    soft = (row for each in report.labels for row in find_softness_rows(each.label)[:1])
    softness = next(soft, row)
    write_inputs(file, folder / "inputs.npz", unseen=True)
    for fix, written in write_fixed_models(entry, file, folder):
        of = softness if fix.changes_model and fix.removes == "labels" else row
        options = ["--of", of, "--inputs", str(folder / "inputs.npz")]
        code, text = _run(file, [*options, "--against", str(written)])
        yield fix.name, code == 0, text


def asked_again(entry: Entry, file: Path, folder: Path) -> Entry:
    """Return a record with what plain MuJoCo shows now of its cause, and with its changes."""
    options = questions(entry)
    confirmation = confirmed(entry, file, options) if options else None
    shown = {
        fix.name: still_shown(confirmation, written)
        for fix, written in write_fixed_models(entry, file, folder)
        if confirmation and confirmation.holds
    }
    fixed = tuple(each.model_copy(update={"shown": shown.get(each.name)}) for each in entry.fixed)
    return entry.model_copy(update={"confirmation": confirmation, "fixed": fixed})


def still_shown(before: Confirmation, file: Path) -> bool | None:
    """Return whether plain MuJoCo shows in a changed model what it shows in the original.

    None where it replays inputs, whose steps are those of the original.
    """
    _python, _script, _model, *options = shlex.split(before.command)
    return None if "\n" in before.command else _run(file, options)[0] == 0


def write_inputs(model: Path, file: Path, seed: int = 0, *, unseen: bool = False) -> None:
    """Write the start and the inputs of a seed of a model's own task, by its place.

    Or of a seed that changes are judged by, and none was chosen by.
    """
    scene = SceneLoader(Path()).open(str(model)).with_effects("all")
    task = scene.task({}, None)
    motions = task_motions(scene, {}, with_new_seeds(task) if unseen else task)
    rows = np.concatenate([motion.inputs[seed] for motion in motions])
    np.savez(file, start=motions[0].starts[seed], rows=rows, spec=motions[0].spec)


def _cause(entry: Entry) -> list[str]:
    """Return the options that ask for what makes a model unsound, or what its budget names."""
    report = entry.examination
    if report is None:
        return []
    labels = [_OF_LABELS[label.label] for label in report.labels if label.label in _OF_LABELS]
    if entry.word == "fails" and labels:
        return [*labels[0]]
    for reason in report.budget.reasons if report.budget else ():
        if reason.row in _STEPS and (raised := _raised(report, reason.phase)):
            return ["--of", "refsafe", "--body", raised]
        drift = "loss" if (reason.error or 0.0) < 0 else "gain"
        of = {**dict.fromkeys(_STEPS, "run"), "energy": drift}.get(reason.row, reason.row)
        return ["--of", of, "--body", reason.body]
    return []


def _raised(report: Examination, phase: str) -> str:
    """Return the body whose motion in a phase hangs on constants that the step raises, or ""."""
    assert report.budget is not None
    rows = (row for one in report.budget.phases if one.name == phase for row in one.rows)
    shares = {row.body: row.error or 0.0 for row in rows if row.name == "refsafe"}
    found = (body for body, share in shares.items() if share > report.budget.tolerance)
    return next(found, None) or ""


def _run(file: Path, options: list[str]) -> tuple[int, str]:
    asked = [sys.executable, str(ROOT / SCRIPT), str(file), *options]
    try:
        done = subprocess.run(asked, capture_output=True, text=True, timeout=_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return 1, f"no answer within {_SECONDS} s"
    lines = (done.stdout or done.stderr).strip().splitlines()
    return done.returncode, lines[-1].partition(": ")[2] if lines else ""
