"""A question that was answered before: the same model, task and aim, and time enough."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from shutil import copytree

from pydantic import ValidationError

from contactlab.scene.mujoco_versions import VERSION
from contactlab.schema.tune_report import (
    FOLDER,
    FOLDER_AS_NOW,
    FOLDER_OF_AIM,
    REPORT,
    TuneReport,
)
from contactlab.studies.examine.examination import ExamineRequest, open_model
from contactlab.studies.search.tune_request import TuneRequest, refuse_contradictions
from contactlab.studies.session import Session


def answered(request: TuneRequest, session: Session, places: Sequence[Path]) -> TuneReport | None:
    """Return the answer that one of the folders has to the same question, or None.

    It is copied into the folder of the session, with the models that were written. An answer for
    which time was too short, or whose files are gone, is none.

    Raises:
        SceneError: there is no such model, or it does not compile.
        SweepFileError: the tolerance is no share, or options contradict each other.
        OutputError: the folder cannot be written, or has another model's results.
    """
    refuse_contradictions(request)
    known = [(place, report) for place in places if (report := _read(place))]
    if not known:
        return None
    session = replace(session, folder=session.folder.resolve())
    asked = ExamineRequest(request.model, task=request.task, sections=("budget",))
    examined = open_model(asked, session)
    for place, report in known:
        own = report.scene_hash, report.mujoco, report.task
        if own != (examined.scene.hash, VERSION, examined.task) or not _is_same(request, report):
            continue
        session.notify(f"{place / REPORT} has the answer; remove it to search anew")
        if place.resolve() != session.folder:
            session.claim("tune", request.model)
            for folder in (FOLDER, FOLDER_AS_NOW, FOLDER_OF_AIM):
                if (place / folder).is_dir():
                    copytree(place / folder, session.folder / folder, dirs_exist_ok=True)
            session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
        return report
    return None


def _read(place: Path) -> TuneReport | None:
    try:
        report = TuneReport.model_validate_json((place / REPORT).read_bytes())
    except (OSError, ValidationError):
        return None
    others = [other.file for other in (report.to_aim, report.as_accurate) if other]
    files = [file for file in (report.file, *others) if file]
    return report if all((place / file).is_file() for file in files) else None


def _is_same(request: TuneRequest, report: TuneReport) -> bool:
    """Return whether an answer for the same model and task is to the same question."""
    aim, apart, hulls = report.aim, report.stayed_apart, report.fewer_vertices
    given = aim.limit if aim.kind in ("error", "watched") else None
    asked = request.error
    if asked is not None and request.at is None:
        asked = min(asked, aim.within)
    return not report.ended and (
        (asked, request.real_time, tuple(request.watched), request.at)
        == (given, aim.real_time, aim.watched, aim.at)
        and request.apart == (apart.margin if apart and apart.left_out else None)
        and request.hulls == (hulls.within if hulls else None)
        and request.drop_sensors == bool(report.sensors)
    )
