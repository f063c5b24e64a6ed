"""What a model that `tune` wrote costs beside the model as it was, in plain MuJoCo.

Run: python -m bench.tune_cost FOLDER [ORIGINAL]

The folder is that of the study. Whole runs of the task, on seeds that nobody has run, take turns;
of each turn, the ratio of CPU times. ORIGINAL is what the model was made slow of, if that was done
on purpose.
"""

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median

import mujoco
from mujoco.rollout import rollout

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.schema.tune_report import REPORT, TuneReport
from contactlab.studies.examine.changes import fresh
from contactlab.studies.examine.examination import ExamineRequest, open_model
from contactlab.studies.session import Session

TURNS = 9
_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
_CONTROL = mujoco.mjtState.mjSTATE_CTRL
Runs = tuple[mujoco.MjModel, list[Motion]]


def runs_of(file: str) -> Runs:
    """Return a model as MuJoCo reads it, and the motions of its task from fresh seeds."""
    examined = open_model(ExamineRequest(file, sections=("budget",)), Session(Path()))
    return mujoco.MjModel.from_xml_path(file), examined.motions_of(fresh(fresh(examined.task)))


def seconds(runs: Runs) -> float:
    """Return CPU time of runs over simulated time."""
    (model, motions), spent, simulated = runs, 0.0, 0.0
    data = mujoco.MjData(model)
    size = mujoco.mj_stateSize(model, _STATE)
    for motion in motions:
        for seed in range(motion.seeds):
            mujoco.mj_setState(model, data, motion.starts[seed], INTEGRATION)
            given = motion.inputs[seed] if motion.inputs.shape[2] else None
            start = motion.starts[seed][None, :size]
            spec, steps = motion.spec if motion.inputs.shape[2] else int(_CONTROL), motion.steps
            begin = time.thread_time()
            rollout(model, data, start, given, control_spec=spec, nstep=steps)
            spent += time.thread_time() - begin
            simulated += motion.steps * model.opt.timestep
    return spent / simulated


def ratios(every: Sequence[Runs]) -> list[float]:
    """Return the time of each over that of the first, the median over turns."""
    turns = [[seconds(runs) for runs in every] for _ in range(TURNS + 1)][1:]
    return [median(turn[place] / turn[0] for turn in turns) for place in range(len(every))]


def measure(folder: Path, original: str = "") -> str:
    """Return a line about one study."""
    report = TuneReport.model_validate_json((folder / REPORT).read_text())
    if report.file is None or report.recommended is None or report.recommended.price is None:
        return f"{folder.name}: {report.sentence}"
    files = [report.model, str(folder / report.file), *([original] if original else [])]
    _, measured, *rest = ratios([runs_of(file) for file in files])
    claimed = report.recommended.price.ratio
    changed = ", ".join(f"{each.name} {each.after}" for each in report.changes) or "none"
    line = (
        f"{folder.name}: claimed x{claimed:.3f}, measured x{measured:.3f} "
        f"({measured / claimed - 1:+.1%}); {changed}; "
        f"{len(report.masked)} masks, {len(report.excluded)} excludes"
    )
    if rest:
        line += f"; slow/original {1 / rest[0]:.2f}, tuned/original {measured / rest[0]:.2f}"
    return line


if __name__ == "__main__":
    print(measure(Path(sys.argv[1]), *sys.argv[2:]))
