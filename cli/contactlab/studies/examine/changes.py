"""Changes that pay: those that remove what a verdict names, as lines of the model's files.

Each was chosen by the task's own seeds, so that it is judged again by fresh ones.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from contactlab.budget import Motion, Remedy, Settings, Verdict, remedies
from contactlab.budget.remedies import CANDIDATES
from contactlab.budget.report import remedy_report
from contactlab.errors import SceneError
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import WrittenModel, write_model
from contactlab.scene.scene import Scene
from contactlab.schema.examination import ModelChange
from contactlab.schema.task import Task
from contactlab.studies.session import Values

MOST_CHANGES = 3
_BY_HAND = "no option of the model: its effect is that of stiffer solref in each of its parts"


def fresh(task: Task) -> Task:
    """Return a task whose seeds no change was chosen by."""
    count = max(task.seeds) + 1
    return task.model_copy(update={"seeds": tuple(seed + count for seed in task.seeds)})


def confirmed(
    tried: Sequence[Remedy], motions: Sequence[Motion], verdict: Verdict, workers: int | None
) -> list[Remedy]:
    """Return changes with what they do in motions of fresh seeds too, the worse of both.

    Three that remove the verdict in both suffice; the others, which come after them, are as they
    were tried. What a change costs is kept from where it was measured first.
    """
    judged = list[Remedy]()
    settings = Settings(places=False)
    for remedy in tried:
        if not remedy.removes or sum(one.removes for one in judged) == MOST_CHANGES:
            judged.append(remedy)
            continue
        again = [candidate for candidate in CANDIDATES if candidate.name == remedy.name]
        found = remedies(motions, verdict, settings=settings, candidates=again, workers=workers)
        removes = bool(found) and found[0].removes
        worst = max(remedy, *found, key=lambda one: np.nan_to_num(one.share))
        judged.append(replace(worst, removes=removes, price=remedy.price))
    return judged


def model_change(scene: Scene, remedy: Remedy, values: Values) -> ModelChange:
    """Return a change as the lines that make it; why not, where it cannot be written."""
    lines, unwritten = tuple[str, ...](), ""
    if remedy.physics:
        unwritten = _BY_HAND
    else:
        with TemporaryDirectory(prefix="contactlab-") as folder:
            try:
                lines = written(scene, remedy.options, values, Path(folder) / "changed").lines
            except SceneError as error:
                unwritten = str(error).splitlines()[0]
    tried = remedy_report(remedy)
    return ModelChange(
        name=tried.name,
        physics=tried.physics,
        options=tried.options,
        share=tried.share,
        price=tried.price,
        lines=lines,
        unwritten=unwritten,
    )


def written(
    scene: Scene, options: Values, values: Values, folder: Path, name: str = ""
) -> WrittenModel:
    """Write a scene's model with settings and changed options into a folder."""
    own = {key: value for key, value in values.items() if key not in options}
    return write_model(scene, ModelEdits({**own, **options}), folder, name)


def write_first(
    scene: Scene, changes: Sequence[ModelChange], values: Values, file: Path
) -> WrittenModel | None:
    """Write the first change that computes the same model otherwise, if there is one.

    Raises an OutputError if the file cannot be written.
    """
    for change in changes:
        if change.lines and not change.physics:
            return written(scene, change.options, values, file.parent, file.name)
    return None
