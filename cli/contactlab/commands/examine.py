"""`contactlab examine`: the verdict on a model, its causes and its fix, on one page."""

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Annotated, Any, Unpack

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Arguments, Option, command, flag
from contactlab.command_line.judgements import list_printers
from contactlab.command_line.quantities import read_seconds
from contactlab.command_line.report_formats import print_markdown, print_text, report_formats
from contactlab.command_line.surroundings import say
from contactlab.errors import ExpectationError, OutputError, SceneError, SweepFileError
from contactlab.temporary_folders import temporary_folder

if TYPE_CHECKING:
    from contactlab.schema.examination import Examination, Examinations
    from contactlab.schema.finding import Waiver
    from contactlab.studies.examine.examination import ExamineRequest
    from contactlab.studies.grip.grip_fixes import Grip
    from contactlab.tasks.session import Session
    from contactlab.writers import Report

_PAGE, _REPORT, _LIVE = "page.html", "examination.json", ".live.html"
_FILES = {".html", ".htm", ".json"}


def _list_findings(report: "Examination | Examinations", arguments: Arguments) -> "Report":
    from contactlab.reporting.examination_document import (
        findings_of_examination,
        findings_of_examinations,
    )
    from contactlab.schema.examination import Examination

    del arguments
    if isinstance(report, Examination):
        return findings_of_examination(report)
    return findings_of_examinations(report)


def _find_failure(
    report: "Examination | Examinations", arguments: Arguments
) -> "OutputError | ExpectationError | None":
    # Return the error of a requested fix that was not written, or otherwise of the verdict.
    del arguments
    if reason := getattr(report, "not_written", ""):
        return OutputError(reason)
    return ExpectationError(report.problem) if report.problem else None


def _examine_model(
    request: "ExamineRequest",
    target: Path | None,
    workers: int | None,
    *,
    allow_code: bool = False,
    page: bool = False,
    live: bool = False,
) -> "Examination":
    """Examine a model; write its report, its evidence and the requested pages.

    Raises an OutputError if they cannot be written, before anything is run.
    """
    from dataclasses import replace

    from contactlab.run.worker_pool import worker_count
    from contactlab.step_progress import step_names
    from contactlab.store.atomic_files import atomic_write, write_errors
    from contactlab.studies.examine.examination import examine_model
    from contactlab.tasks.session import Session

    file = target if target is not None and target.suffix in _FILES else None
    page = page if file is None else file.suffix != ".json"
    if page and not request.has_runs:
        raise OutputError("a page shows the runs of a task; add --section labels, or write a .json")
    if live and not page:
        raise OutputError("--live needs a whole examination; leave out --section and -o FILE.json")
    if live:
        from contactlab.live.browser_build import find_build

        find_build()
    parts = request.parts + page + live
    with (
        _open_folder(request, None if file else target, is_kept=file is None) as folder,
        step_names(parts) as begin,
    ):
        if file is not None:
            with write_errors(file), TemporaryFile(dir=file.parent):
                if file.is_dir():
                    raise OutputError(f"{file} is a folder; write the name of a file, as in a.json")
        session = Session(folder, worker_count(workers), notify=say, allow_code=allow_code)
        grips = list["Grip"]()
        report = examine_model(replace(request, begins=begin, film=grips.append), session)
        if file is None:
            report = report.model_copy(update={"evidence": str(folder)})
        if page:
            begin("drawing its page")
            report = _draw_page(report, session, file or folder / _PAGE, grips)
        if live:
            begin("writing the page that simulates")
            page_file = file.with_suffix(_LIVE) if file else folder / f"page{_LIVE}"
            _write_live_page(report, session, page_file)
        if file is None:
            session.write({_REPORT: report.model_dump_json(indent=2) + "\n"})
        elif file.suffix == ".json":
            with write_errors(file), atomic_write(file) as path:
                path.write_text(report.model_dump_json(indent=2) + "\n", encoding="utf-8")
            say(f"wrote {file}")
    return report


@contextmanager
def _open_folder(
    request: "ExamineRequest", folder: Path | None, *, is_kept: bool
) -> Generator[Path]:
    from contactlab import resources
    from contactlab.studies.examine.examination import RESULTS
    from contactlab.tasks.session import free_folder

    if not is_kept:
        with temporary_folder() as name:
            yield Path(name)
    elif folder is not None:
        yield folder
    else:
        variant = [*request.assign, *request.task.variant]
        parent = resources.RESULTS / RESULTS
        with free_folder(parent, RESULTS, request.model, variant) as new_folder:
            yield new_folder


def _check_model_file(model: Path, sections: Sequence[str]) -> None:
    """Refuse a model that cannot be written, before the measurement."""
    if model.exists():
        raise OutputError(f"{model} exists; choose another file with --write")
    if model.suffix != ".xml":
        raise OutputError(f"--write {model}: a model is written as MJCF; write a name as new.xml")
    if sections and "fixes" not in sections:
        raise OutputError(f"--write {model}: no fix is tried; add --section fixes")
    folder = next(parent for parent in model.absolute().parents if parent.exists())
    try:
        TemporaryFile(dir=folder).close()
    except OSError as error:
        why = f"{error.strerror}; choose another file with --write"
        raise OutputError(f"cannot write {model}: {why}") from error


def _write_live_page(report: "Examination", session: "Session", file: Path) -> None:
    """Write the page that simulates the runs of an examination's task."""
    from contactlab.live.live_page import write_live_page
    from contactlab.tasks.checked_model import TASK_STORE

    for note in write_live_page(session.stores[TASK_STORE], file, examination=report):
        say(f"note: {note}")
    say(f"wrote {file}, {file.stat().st_size / 1e6:.2g} MB")


def _draw_page(
    report: "Examination", session: "Session", file: Path, grips: "Sequence[Grip]"
) -> "Examination":
    """Draw the page of an examination, from the store of its runs, with films of its grips."""
    from contactlab.page.report_files import write_page
    from contactlab.reporting.report import PageRequest
    from contactlab.studies.grip.grip_film import film_writer
    from contactlab.tasks.checked_model import TASK_STORE

    film, target = None, session.folder / "grip.gif"
    for grip in grips:
        try:
            film_writer(target, size=(480, 360), rate=10)(grip)
            film = target
        except (SceneError, OutputError) as error:
            say(f"note: no film of its grip: {error}")
    report = report.model_copy(update={"page": str(file)})
    write_page(session.stores[TASK_STORE], file, PageRequest(examination=report, grip=film))
    return report


@command(
    "examine",
    keeps="nothing",
    examples=(
        "examine robot.xml",
        "robot.xml --tolerance 30% --write fixed/robot.xml",
        "examine robots/*.xml --section checks --format junit",
        'examine robot.xml --section contacts --set depth_at_rest=".1 mm"',
    ),
    formats={
        "text": print_text(),
        "full": print_text(details=True, phases=True),
        **report_formats(),
        "markdown": print_markdown(details=True, name="model"),
        **list_printers(_list_findings, "junit", "sarif", "github"),
    },
    failure=_find_failure,
)
def examine(
    models: Annotated[
        str | Path | Sequence[str | Path],
        Argument(
            "MODEL",
            "Scene, scene folder, .xml or .urdf file, or menagerie:ROBOT; or several.",
            kind=list[str],
        ),
    ],
    *,
    set: opt.Set = (),
    section: Annotated[
        Sequence[str],
        Option(
            "NAME",
            "Show only this section: labels, budget, facts, checks, contacts, servos, loop or "
            "fixes; may be repeated.",
            kind=list[str],
        ),
    ] = (),
    check: Annotated[
        Sequence[str],
        Option("NAME", "Run only this check; may be repeated.", kind=list[str]),
    ] = (),
    waive: Annotated[
        "str | Path | Sequence[Waiver] | None",
        Option("FILE", "File of waivers: findings that may fail, with reasons.", kind=Path),
    ] = None,
    output: opt.ExaminationOutput = None,
    live: Annotated[
        bool,
        flag("Also write a page that simulates the task, with the rows of the budget as switches."),
    ] = False,
    write: Annotated[
        str | Path | None,
        Option("FILE", "File for the model with the first fix.", kind=Path),
    ] = None,
    apply: Annotated[
        Sequence[str],
        Option(
            "NAME",
            "Write this fix too, which changes the model; may be repeated.",
            kind=list[str],
        ),
    ] = (),
    max_cpu: opt.MaxCpu = "60s",
    workers: opt.Workers = None,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
    **task: Unpack[opt.TaskParameters],
) -> "Examination | Any":  # noqa: ANN401 - so that a caller with one model has its report
    """Judge a model: is it right, why not, and what fixes it.

    `contactlab MODEL` is short for it. Several models have one result, Examinations, and a folder
    each in `output`. A fix is judged on the task's seeds and on new ones. `write` writes the model
    with the first fix that keeps the model, or with the fixes that change it and that `apply`
    names. Page, report and evidence go to `results/examine/NAME` unless `output` names
    another folder, or a file for one of them.

    The verdict is ok; depends on X (a modeling choice decides); inaccurate (the numerical error is
    above the tolerance); undecided (the reference has not converged); or fails (a failure label
    holds, or a check fails that is not waived). It does not depend on the speed of the machine.
    Rows of the budget that are not judged, and fixes, are skipped and named if they would exceed
    `max_cpu`.

    Raises:
        SceneError: there is no such model, keyframe or body, or it does not compile.
        SweepFileError: a setting is wrong, or the tolerance is not a share.
        EngineError: nothing moves, or another engine than MuJoCo is requested.
        PolicyError: a waiver names no finding of any check.
        OutputError: the report or the model cannot be written.
    """
    from dataclasses import replace

    from contactlab.scene.scene_source import find_scene
    from contactlab.schema.examination import Examinations
    from contactlab.studies.examine.examination import ExamineRequest, sections_of
    from contactlab.tasks.session import model_name

    opt.load_plugins(plugin)
    model_names = [str(each) for each in ([models] if isinstance(models, str | Path) else models)]
    sections = sections_of(section or (("checks",) if check else ()))
    target = None if output is None else opt.folder_of(output)
    if len(model_names) > 1:
        if write is not None or live:
            raise SweepFileError("--write, --apply and --live need one model; name it alone")
        if target is not None and target.suffix in _FILES:
            raise OutputError(f"{target}: several models have a folder each; name a folder")
        for model in model_names:
            find_scene(model)
    if write is not None:
        _check_model_file(Path(write), section)
    waivers = waive or ()
    if isinstance(waivers, str | Path):
        from contactlab.plan.sweep_file import read_yaml_as
        from contactlab.schema.finding import Waivers

        waivers = read_yaml_as(Path(waivers), Waivers).waive
    request = ExamineRequest(
        model=model_names[0],
        assign=opt.write_assignments(set),
        task=opt.task_of(**task),
        sections=sections,
        checks=check,
        accepted=waivers,
        write=None if write is None else Path(write),
        apply=tuple(apply),
        max_cpu=read_seconds(max_cpu, "--max-cpu"),
    )
    page = sections == sections_of(())
    reports = [
        _examine_model(
            replace(request, model=model),
            target if target is None or len(model_names) == 1 else target / model_name(model),
            workers,
            allow_code=allow_code,
            page=page,
            live=live,
        )
        for model in model_names
    ]
    return reports[0] if len(reports) == 1 else Examinations(examinations=tuple(reports))
