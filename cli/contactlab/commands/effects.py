"""`contactlab effects`: the features and parts that a model needs, and the time of each."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Unpack

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Arguments, Option, command
from contactlab.command_line.quantities import read_seconds
from contactlab.command_line.report_formats import report_formats
from contactlab.command_line.surroundings import say
from contactlab.errors import OutputError, SweepFileError

if TYPE_CHECKING:
    from contactlab.schema.effects_report import EffectsReport


_MAX_CPU = "2min"


def _choose_folder(arguments: Arguments) -> Path:
    return opt.study_folder("effects", arguments["source"], arguments["output"])


@command(
    "examine",
    keeps=lambda given: "finished runs" if given["metric"] else "nothing",
    examples=("effects robot.xml", "effects robot.xml --write small/robot.xml --keep sensors"),
    formats=report_formats(_choose_folder),
)
def effects(
    source: Annotated[
        str | Path,
        Argument("SCENE|SWEEP|MODEL", "Scene, sweep file or model file.", kind=str),
    ],
    *,
    set: opt.Set = (),
    output: opt.StudyFolder = None,
    write: Annotated[
        str | Path | None,
        Option("FILE", "Write the smaller model to this file.", kind=str),
    ] = None,
    keep: Annotated[
        Sequence[str],
        Option("NAME", "Keep this feature or part; may be repeated.", kind=list[str]),
    ] = (),
    apply: Annotated[
        Sequence[str],
        Option(
            "NAME",
            "Also leave out far-pairs[=5cm], which no proof allows.",
            kind=list[str],
        ),
    ] = (),
    max_cpu: opt.MaxCpu = _MAX_CPU,
    metric: Annotated[
        Literal["reality"] | None,
        Option(None, "Find the effects of a scene that bring runs closer to recorded runs."),
    ] = None,
    figure: opt.Figure = None,
    workers: opt.Workers = None,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
    **task: Unpack[opt.TaskParameters],
) -> "EffectsReport":
    """Find the needed features and parts, and write a smaller model.

    Each is left out alone: in the task, with gravity tilted, and with twice the inputs. Those that
    may go together, and save more than 3 % of the time, are left out of the smaller model, which is
    verified next to the original. Results go to `results/effects/NAME` unless `output` is given.

    Raises:
        SceneError: there is no such scene, or no part of a name to keep.
        SweepFileError: the sweep or a setting is wrong.
        OutputError: the file of the smaller model exists or is not an .xml file.
    """
    from contactlab.run.worker_pool import worker_count
    from contactlab.scene.scene_source import MODEL_SUFFIXES, is_menagerie
    from contactlab.studies.effects.effects_request import EffectsRequest
    from contactlab.studies.effects.effects_study import study_effects
    from contactlab.studies.effects.recorded_effects import study_recordings
    from contactlab.tasks.session import Session

    opt.load_plugins(plugin)
    opt.check_figure(figure)
    task_options = opt.task_of(**task)
    folder = opt.study_folder("effects", source, output)
    if write is not None and Path(write).exists():
        raise OutputError(f"{write} exists; choose another file with --write")
    if write is not None and Path(write).suffix != ".xml":
        raise OutputError(f"--write {write}: a model is written as MJCF; write a name as new.xml")
    words = (apply,) if isinstance(apply, str) else apply
    reductions = opt.read_reductions(words, ["far-pairs"])
    request = EffectsRequest(
        source=str(source),
        assign=opt.write_assignments(set),
        task=task_options,
        max_cpu=read_seconds(max_cpu, "--max-cpu"),
        keep=(keep,) if isinstance(keep, str) else tuple(keep),
        far_distance=reductions.get("far-pairs"),
        write=None if write is None else Path(write),
    )
    count = worker_count(workers)
    session = Session(folder.resolve(), count, notify=say, allow_code=allow_code)
    if metric is None:
        report = study_effects(request, session)
    else:
        if is_menagerie(str(source)) or Path(source).suffix in MODEL_SUFFIXES:
            raise SweepFileError("--metric needs a scene or a sweep with a recording")
        if request.far_distance is not None:
            raise SweepFileError("--apply far-pairs compares no recordings. Leave --metric out")
        if request.max_cpu != read_seconds(_MAX_CPU, "--max-cpu"):
            raise SweepFileError(
                "--max-cpu does not limit --metric reality, which simulates every recorded run. "
                "Leave one of both out"
            )
        report = study_recordings(request, session)
    if figure is not None:
        from contactlab.charts import save_figure
        from contactlab.studies.effects.effects_chart import draw_effects

        save_figure(draw_effects(report), Path(figure))
        say(f"drew {figure}")
    return report
