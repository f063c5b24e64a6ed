"""What a model that `tune` wrote costs beside the model as it was, by MuJoCo's own `rollout`.

Run: python -m bench.tune_cost FOLDER [ORIGINAL]

The folder is that of the study. Whole runs of the proof's drive, from seeds that nobody has run,
take turns; of each turn, the ratio of CPU times. ORIGINAL is what the model was made slow of, if
that was done on purpose: then also what the slow and the tuned model cost beside that one.
"""

import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

import mujoco
import numpy as np
from mujoco.rollout import rollout

from contactlab.run.sweep_request import SceneLoader
from contactlab.schema.drive import Drive, parse_drive
from contactlab.schema.study_reports import TuneReport

SEEDS, LEAST, LONGEST = range(40, 50), 9, 40.0
_WARM = 20
_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS


class Run(NamedTuple):
    """A run without contactlab: a model, where it starts, and its controls (T, nu)."""

    model: mujoco.MjModel
    start: np.ndarray
    controls: np.ndarray

    def go(self) -> tuple[float, np.ndarray]:
        """Return the CPU time [s], and the origins and axes of bodies at the end."""
        states, taken, before = np.empty(0), 0.0, 0.0
        data = mujoco.MjData(self.model)
        # The first steps pay for memory that was never touched, a single one for the call.
        for steps in (_WARM, 1, len(self.controls)):
            begin, before = time.thread_time(), taken
            states, _ = rollout(self.model, data, self.start, self.controls[:steps])
            taken = time.thread_time() - begin
        mujoco.mj_setState(self.model, data, np.asarray(states)[0, -1], _STATE)
        mujoco.mj_kinematics(self.model, data)
        axes = 0.05 * data.xmat.reshape(-1, 3, 3).swapaxes(1, 2)
        return taken - before, (data.xpos[:, None] + axes).ravel()


def runs_of(reference: str, drive: Drive | None, seconds: float) -> list[Run]:
    """Return the runs of a model from fresh seeds."""
    scene = SceneLoader(Path(), drive).open(reference).with_effects("all")
    found: list[Run] = []
    for seed in SEEDS:
        run = scene.resolve({}, seed, seconds)
        start = scene.starts([run])
        model = scene.prepare(run, start, scene.compile_without_sensors(run)).model
        first = np.concatenate([np.zeros(1), start.qpos[0], start.qvel[0], start.act[0]])
        steps = np.arange(run.steps)
        found.append(Run(model, first, start.inputs(0, model.opt.timestep, steps, model.nu)))
    return found


def turn(every: Sequence[Sequence[Run]]) -> tuple[list[float], list[np.ndarray]]:
    """Return what each model takes [s], and where its runs end."""
    gone = [[run.go() for run in runs] for runs in every]
    return [sum(each for each, _ in runs) for runs in gone], [
        np.array([end for _, end in runs]) for runs in gone
    ]


def drive_of(store: Path) -> Drive | None:
    """Return what drove the runs of a store."""
    said = json.loads((store / "sweep.json").read_text())["resolved"].get("drive")
    return parse_drive(said) if said else None


def measure(folder: Path, original: str = "") -> str:
    """Return a line about one study."""
    report = TuneReport.model_validate_json((folder / "tune.json").read_text())
    if report.file is None or report.proof is None or report.proof.tuned.cost is None:
        return f"{folder.name}: kept as it is"
    asked, given = drive_of(folder / "proof"), drive_of(folder / "tuned-runs")
    every = [runs_of(report.model, asked, report.duration)]
    every.append(runs_of(str(folder / report.file), given, report.duration))
    if original:
        every.append(runs_of(original, asked, report.duration))
    turn(every)
    turns, begin = [turn(every)], time.monotonic()
    while len(turns) < LEAST or (len(turns) < 31 and time.monotonic() < begin + LONGEST / 4):
        turns.append(turn(every))
        if time.monotonic() > begin + LONGEST and len(turns) >= 3:
            break
    ratios = [times[1] / times[0] for times, _ in turns]
    claimed, measured = report.proof.tuned.cost.ratio, median(ratios)
    changed = ", ".join(f"{each.name} {each.after}" for each in report.changes) or "none"
    line = (
        f"{folder.name}: claimed x{claimed:.3f}, measured x{measured:.3f} "
        f"({measured / claimed - 1:+.1%}), {len(turns)} turns; {changed}; "
        f"{len(report.masked)} masks, {len(report.excluded)} excludes"
    )
    if original:
        slow, tuned = (median(t[0][k] / t[0][2] for t in turns) for k in (0, 1))
        ends = turns[0][1]
        line += (
            f"; slow/original {slow:.2f}, tuned/original {tuned:.2f}; "
            f"end tuned-slow {abs(ends[1] - ends[0]).max():.1e}, "
            f"original-slow {abs(ends[2] - ends[0]).max():.1e}"
        )
    return line


if __name__ == "__main__":
    print(measure(Path(sys.argv[1]), *sys.argv[2:]))
