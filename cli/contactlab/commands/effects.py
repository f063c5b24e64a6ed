"""`contactlab effects`: the effects and parts that a model needs, and the time of each."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Unpack

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, Option, command
from contactlab.command_line.quantities import read_seconds
from contactlab.command_line.report_formats import report_formats
from contactlab.command_line.surroundings import say, study_session
from contactlab.errors import SweepFileError

if TYPE_CHECKING:
    from contactlab.plan.task_options import TaskOptions
    from contactlab.schema.parts_report import PartsReport
    from contactlab.schema.study_reports import EffectsReport

_SEEDS = 6


def _folder(given: Given) -> Path:
    return opt.study_folder("effects", given["source"], given["output"])


@command(
    "examine",
    examples=("effects grasp_mug",),
    formats=report_formats(_folder),
)
def effects(
    source: Annotated[
        str | Path,
        Argument("SCENE|SWEEP|MODEL", "Scene, sweep file or model file.", kind=str),
    ],
    *,
    set: opt.Set = (),
    output: opt.StudyFolder = None,
    seeds: Annotated[
        int | None,
        Option(None, "Runs per scenario and effect of a scene or sweep; default 6.", least=1),
    ] = None,
    max_time: opt.MaxTime = "2min",
    metric: Annotated[
        Literal["reality"] | None,
        Option(None, "Find the effects that bring runs closer to recorded runs."),
    ] = None,
    figure: opt.Figure = None,
    workers: opt.Workers = None,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
    **task: Unpack[opt.TaskParameters],
) -> "EffectsReport | PartsReport":
    """Measure the influence and the time of each effect or part.

    For a model file, each feature and part is removed alone: in the task, with gravity tilted, and
    with twice the inputs. For a scene or sweep, the smallest set of effects that keeps every result
    is searched. Results go to `results/effects/NAME` unless `output` is given.

    Raises:
        SceneError: there is no such scene.
        SweepFileError: the sweep or a setting is wrong.
    """
    from contactlab.scene.scene_source import MODEL_SUFFIXES, is_menagerie
    from contactlab.studies.effects.ablation import find_smallest_set
    from contactlab.studies.effects.effects_request import EffectsRequest

    opt.load_plugins(plugin)
    opt.check_figure(figure)
    asked = opt.task_of(**task)
    folder = opt.study_folder("effects", source, output)
    if is_menagerie(str(source)) or Path(str(source)).suffix in MODEL_SUFFIXES:
        for name, value in (("seeds", seeds), ("metric", metric), ("figure", figure)):
            if value is not None:
                raise SweepFileError(f"--{name} needs a scene or a sweep; leave it out for a model")
        return _of_model(str(source), opt.assigned(set), asked, max_time, folder, workers)
    count = _SEEDS if seeds is None else seeds
    request = EffectsRequest(str(source), opt.assigned(set), count, task=asked, metric=metric)
    with study_session(folder, workers, allow_code=allow_code) as session:
        report = find_smallest_set(request, session)
    if figure is not None:
        from contactlab.charts import save_figure
        from contactlab.studies.effects.effects_chart import specification

        save_figure(specification(report), Path(figure))
        say(f"drew {figure}")
    return report


def _of_model(
    source: str,
    assign: Sequence[str],
    task: "TaskOptions",
    max_time: float | str,
    folder: Path,
    workers: int | None,
) -> "PartsReport":
    """Remove one part of a model after the other."""
    from contactlab.run.worker_pool import worker_count
    from contactlab.studies.search.model_ablation import PartsRequest, ablate_model
    from contactlab.tasks.session import Session

    request = PartsRequest(source, assign, task, read_seconds(max_time))
    return ablate_model(request, Session(folder.resolve(), worker_count(workers), notify=say))
