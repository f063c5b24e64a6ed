"""What a model that `tune` wrote costs beside the model as it was, in plain MuJoCo.

Run: python -m bench.tune_cost FOLDER [ORIGINAL]

The folder is that of the study, all of whose answers are timed. Whole runs of the task, on twelve
seeds that nobody has run, take turns in loops of `mj_step`. ORIGINAL is what the model was made
slow of, if that was done on purpose.
"""

import itertools
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import numpy.typing as npt

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.parts import register_parts
from contactlab.plan.task_options import TaskOptions
from contactlab.scene.scene_source import is_menagerie, menagerie_model
from contactlab.schema.task import Task
from contactlab.schema.tune_report import REPORT, Candidate, TuneReport
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.session import Session

TURNS, TOGETHER = 9, 10
"""Turns; steps whose time is asked for at once, which others seldom share."""
FIRST, SEEDS = 100, 12
"""Beyond those of a study, and so many that they differ little from as many others."""
ASKING = min(-time.thread_time() + time.thread_time() for _ in range(1000))
"""s that it takes to ask for the time."""
Runs = tuple[mujoco.MjModel, list[Motion]]


def file_of(model: str) -> str:
    """Return the file of a model, which may be named by its collection."""
    return str(menagerie_model(model)) if is_menagerie(model) else model


def motions_of(report: TuneReport, task: Task, file: str = "") -> list[Motion]:
    """Return the motions of a task of a report's model, or of another file in its place."""
    options = TaskOptions(drive=report.task.drive, duration=report.task.duration)
    return open_model(file or report.model, Session(Path()), options).motions_of(task)


def runs_of(report: TuneReport, file: str) -> Runs:
    """Return a model as MuJoCo reads it, and the motions of the task from fresh seeds."""
    task = report.task.model_copy(update={"seeds": tuple(range(FIRST, FIRST + SEEDS))})
    return mujoco.MjModel.from_xml_path(file_of(file)), motions_of(report, task, file)


def steps_of(
    model: mujoco.MjModel, data: mujoco.MjData, motion: Motion, seed: int
) -> npt.NDArray[np.float64]:
    """Return CPU times of some steps each of a seed of a motion, in a plain loop [s].

    The first step, which begins a run, is left out.
    """
    mujoco.mj_resetData(model, data)  # what slept at the end of another run wakes
    mujoco.mj_setState(model, data, motion.starts[seed], INTEGRATION)
    taken, inputs = list[float](), motion.inputs[seed]
    ends = [0, *range(1, motion.steps, TOGETHER), motion.steps]
    for first, last in itertools.pairwise(ends):
        begin = time.thread_time()
        for step in range(first, last):
            if inputs.shape[1]:
                mujoco.mj_setState(model, data, inputs[step], motion.spec)
            mujoco.mj_step(model, data)
        taken.append(time.thread_time() - begin)
    return np.array(taken[1:]) - ASKING


def ratios(every: Sequence[Runs]) -> list[float]:
    """Return the CPU time of each over that of the first, for as much simulated time.

    Models take turns, and run twice in each: the first run warms caches. Of some steps the least of
    all turns counts, since what disturbs them only adds.
    """
    spent = np.zeros(len(every))
    datas = [mujoco.MjData(model) for model, _ in every]
    for phase, motion in enumerate(every[0][1]):
        for seed in range(motion.seeds):
            least = [np.full(1, np.inf) for _ in every]
            for _ in range(TURNS):
                for place, ((model, motions), data) in enumerate(zip(every, datas, strict=True)):
                    steps_of(model, data, motions[phase], seed)
                    taken = steps_of(model, data, motions[phase], seed)
                    least[place] = np.minimum(least[place], taken)
            spent += [each.sum() for each in least]
    lengths = [
        float(model.opt.timestep) * sum(each.seeds * (each.steps - 1) for each in motions)
        for model, motions in every
    ]
    speeds = spent / lengths
    return (speeds / speeds[0]).tolist()


def answers_of(report: TuneReport) -> dict[str, tuple[Candidate, str]]:
    """Return the answers of a report: the point, and the file of the model that was written."""
    found: dict[str, tuple[Candidate, str]] = {}
    if report.recommended and report.file:
        found["recommended"] = report.recommended, report.file
    for name, other in (("equal error", report.equal_error),):
        if other:
            found[name] = other.candidate, other.file
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
        assert point.time_ratio
        claimed = point.time_ratio.ratio
        part = f"{name}: claimed x{claimed:.3f}, measured x{measured:.3f}"
        part += f" ({measured / claimed - 1:+.1%})"
        parts.append(part + (f", over original {measured * slow:.2f}" if original else ""))
    changed = ", ".join(f"{each.name} {each.after}" for each in report.changed_settings[:4])
    cut = f"{len(report.masked)} masks, {len(report.excluded)} excludes"
    return f"{folder.name}: {'; '.join(parts)}; {changed or 'nothing set'}; {cut}"


if __name__ == "__main__":
    register_parts()
    print(measure(Path(sys.argv[1]), *sys.argv[2:]))
