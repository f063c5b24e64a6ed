"""What a model that `tune` wrote costs beside the model as it was, in plain MuJoCo.

Run: python -m bench.tune_cost FOLDER [ORIGINAL]

The folder is that of the study, all of whose answers are timed. Whole runs of the task, on twelve
seeds that nobody has run, take turns in loops of `mj_step`, without what Python adds to a step.
ORIGINAL is what the model was made slow of, if that was done on purpose.
"""

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import numpy.typing as npt

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.plan.task_options import TaskOptions
from contactlab.schema.task import Task
from contactlab.schema.tune_report import REPORT, Point, TuneReport
from contactlab.studies.examine.examination import ExamineRequest, open_model
from contactlab.studies.session import Session

TURNS = 9
FIRST, SEEDS = 100, 12
"""Beyond those of a study, and so many that they differ little from as many others."""
SWING = """<mujoco><worldbody><body><joint axis="0 1 0"/>
<geom size=".02" pos="0 0 1"/></body></worldbody></mujoco>"""
Runs = tuple[mujoco.MjModel, list[Motion]]


def motions_of(report: TuneReport, task: Task, file: str = "") -> list[Motion]:
    """Return the motions of a task of a report's model, or of another file in its place."""
    options = TaskOptions(drive=report.task.drive, duration=report.task.duration)
    request = ExamineRequest(file or report.model, task=options, sections=("budget",))
    return open_model(request, Session(Path())).motions_of(task)


def runs_of(report: TuneReport, file: str) -> Runs:
    """Return a model as MuJoCo reads it, and the motions of the task from fresh seeds."""
    task = report.task.model_copy(update={"seeds": tuple(range(FIRST, FIRST + SEEDS))})
    return mujoco.MjModel.from_xml_path(file), motions_of(report, task, file)


def asking() -> float:
    """Return what it adds to a step to be made in Python, and to ask for the time of it [s]."""
    model = mujoco.MjModel.from_xml_string(SWING)
    data, alone, many = mujoco.MjData(model), list[float](), list[float]()
    for _ in range(1000):
        begin = time.thread_time()
        mujoco.mj_step(model, data)
        alone.append(time.thread_time() - begin)
        begin = time.thread_time()
        mujoco.mj_step(model, data, 100)
        many.append((time.thread_time() - begin) / 100)
    return min(alone) - min(many)


ASKING = asking()


def steps_of(
    model: mujoco.MjModel, data: mujoco.MjData, motion: Motion, seed: int
) -> npt.NDArray[np.float64]:
    """Return (steps,) CPU times of the steps of a seed of a motion, in a plain loop [s]."""
    mujoco.mj_setState(model, data, motion.starts[seed], INTEGRATION)
    taken = np.empty(motion.steps)
    for step in range(motion.steps):
        if motion.inputs.shape[2]:
            mujoco.mj_setState(model, data, motion.inputs[seed, step], motion.spec)
        begin = time.thread_time()
        mujoco.mj_step(model, data)
        taken[step] = time.thread_time() - begin
    return taken - ASKING


def ratios(every: Sequence[Runs]) -> list[float]:
    """Return the CPU time of each over that of the first, for as much simulated time.

    Models take turns, and run twice in each: the first run warms caches. Of each step the least of
    all turns counts, since what disturbs one only adds, but not that which begins a run.
    """
    spent = np.zeros(len(every))
    datas = [mujoco.MjData(model) for model, _ in every]
    for phase, motion in enumerate(every[0][1]):
        for seed in range(motion.seeds):
            least = [np.full(motions[phase].steps, np.inf) for _, motions in every]
            for _ in range(TURNS):
                for (model, motions), data, best in zip(every, datas, least, strict=True):
                    steps_of(model, data, motions[phase], seed)
                    np.minimum(best, steps_of(model, data, motions[phase], seed), out=best)
            spent += [each[1:].sum() for each in least]
    lengths = [
        float(model.opt.timestep) * sum(each.seeds * (each.steps - 1) for each in motions)
        for model, motions in every
    ]
    speeds = spent / lengths
    return (speeds / speeds[0]).tolist()


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
