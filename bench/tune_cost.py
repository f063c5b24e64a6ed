"""What a model that `tune` wrote costs beside the model as it was, in plain MuJoCo.

Run: python -m bench.tune_cost FOLDER [ORIGINAL]

The folder is that of the study, all of whose answers are timed. Whole runs of the task, on seeds
that nobody has run, take turns; of each turn, the ratio of CPU times. ORIGINAL is what the model
was made slow of, if that was done on purpose.
"""

import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median

import mujoco
from mujoco.rollout import rollout

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.plan.task_options import TaskOptions
from contactlab.schema.task import Task
from contactlab.schema.tune_report import REPORT, Point, TuneReport
from contactlab.studies.examine.changes import fresh
from contactlab.studies.examine.examination import ExamineRequest, open_model
from contactlab.studies.session import Session

TURNS, ENOUGH = 9, 5e-3
"""Of all models, and s of each run in a turn: few long steps are over before caches are warm."""
_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
_CONTROL = mujoco.mjtState.mjSTATE_CTRL
Runs = tuple[mujoco.MjModel, list[Motion]]


def motions_of(report: TuneReport, task: Task, file: str = "") -> list[Motion]:
    """Return the motions of a task of a report's model, or of another file in its place."""
    options = TaskOptions(drive=report.task.drive, duration=report.task.duration)
    request = ExamineRequest(file or report.model, task=options, sections=("budget",))
    return open_model(request, Session(Path())).motions_of(task)


def runs_of(report: TuneReport, file: str) -> Runs:
    """Return a model as MuJoCo reads it, and the motions of the task from fresh seeds."""
    task = fresh(fresh(report.task))
    return mujoco.MjModel.from_xml_path(file), motions_of(report, task, file)


def seconds(runs: Runs) -> float:
    """Return CPU time of runs over simulated time, without what calls of one step take.

    Of each run the least of several, as many as take long enough: what disturbs one only adds.
    """
    (model, motions), spent, simulated = runs, 0.0, 0.0
    data = mujoco.MjData(model)
    for motion in motions:
        for seed in range(motion.seeds):
            begin, least = time.thread_time(), {motion.steps: math.inf, 1: math.inf}
            while math.inf in least.values() or time.thread_time() < begin + ENOUGH:
                for steps, known in least.items():
                    least[steps] = min(known, once(model, data, motion, seed, steps))
            spent += least[motion.steps] - least[1]
            simulated += (motion.steps - 1) * model.opt.timestep
    return spent / simulated


def once(
    model: mujoco.MjModel, data: mujoco.MjData, motion: Motion, seed: int, steps: int
) -> float:
    """Return CPU time of the first steps of a seed of a motion."""
    start = motion.starts[seed][None, : mujoco.mj_stateSize(model, _STATE)]
    inputs = motion.inputs[seed][:steps] if motion.inputs.shape[2] else None
    spec = motion.spec if motion.inputs.shape[2] else int(_CONTROL)
    mujoco.mj_setState(model, data, motion.starts[seed], INTEGRATION)
    begin = time.thread_time()
    rollout(model, data, start, inputs, control_spec=spec, nstep=steps)
    return time.thread_time() - begin


def ratios(every: Sequence[Runs]) -> list[float]:
    """Return the time of each over that of the first, the median over turns."""
    turns = [[seconds(runs) for runs in every] for _ in range(TURNS + 1)][1:]
    return [median(turn[place] / turn[0] for turn in turns) for place in range(len(every))]


def answers_of(report: TuneReport) -> dict[str, tuple[Point, str]]:
    """Return the answers of a report: the point, and the file of the model that was written."""
    found: dict[str, tuple[Point, str]] = {}
    if report.recommended and report.file:
        found["recommended"] = report.recommended, report.file
    for name, other in (("as accurate", report.as_accurate), ("keeps the aim", report.to_aim)):
        if other:
            found[name] = other.point, other.file
    return found


def measure(folder: Path, original: str = "") -> str:
    """Return a line about one study."""
    report = TuneReport.model_validate_json((folder / REPORT).read_text())
    answers = answers_of(report)
    files = [report.model, *(str(folder / file) for _, file in answers.values())]
    found = ratios([runs_of(report, file) for file in [*files, *filter(None, [original])]])
    slow = 1 / found[-1] if original else 1.0
    parts = [f"slow/original {slow:.2f}"] if original else []
    parts += [] if answers else ["kept"]
    for (name, (point, _)), measured in zip(answers.items(), found[1:], strict=False):
        assert point.price
        claimed = point.price.ratio
        part = f"{name}: claimed x{claimed:.3f}, measured x{measured:.3f}"
        part += f" ({measured / claimed - 1:+.1%})"
        parts.append(part + (f", over original {measured * slow:.2f}" if original else ""))
    changed = ", ".join(f"{each.name} {each.after}" for each in report.changes[:4])
    cut = f"{len(report.masked)} masks, {len(report.excluded)} excludes"
    return f"{folder.name}: {'; '.join(parts)}; {changed or 'nothing set'}; {cut}"


if __name__ == "__main__":
    print(measure(Path(sys.argv[1]), *sys.argv[2:]))
