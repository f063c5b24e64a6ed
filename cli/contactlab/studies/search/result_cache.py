"""Finds an earlier report for the same model, task, target and options."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from shutil import copytree

from pydantic import ValidationError

from contactlab.modifications.modification import ReductionName
from contactlab.scene.mujoco_versions import VERSION
from contactlab.schema.tune_report import (
    EQUAL_ERROR_FOLDER,
    FOLDER,
    REPORT,
    TuneReport,
)
from contactlab.studies.search.tune_request import TuneRequest, refuse_contradictions
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.session import Session


def find_cached_report(
    request: TuneRequest, session: Session, places: Sequence[Path]
) -> TuneReport | None:
    """Return the report of the same question in one of the folders, or None.

    It is copied into the folder of the session, with the written models. A report that the time
    limit ended, or with missing files, does not count.

    Raises:
        SceneError: there is no such model, or it does not compile.
        SweepFileError: the tolerance is not a share, or options contradict each other.
        OutputError: the folder cannot be written, or has another model's results.
    """
    refuse_contradictions(request)
    known = [(place, report) for place in places if (report := _read_report(place))]
    if not known:
        return None
    session = replace(session, folder=session.folder.resolve())
    examined = open_model(request.model, session, request.task)
    for place, report in known:
        own = report.scene_hash, report.mujoco, report.task
        if own != (examined.scene.hash, VERSION, examined.task) or not _is_same_question(
            request, report
        ):
            continue
        session.notify(f"{place / REPORT} answers the same question; remove it to search again")
        if place.resolve() != session.folder:
            session.claim("tune", request.model)
            for folder in (FOLDER, EQUAL_ERROR_FOLDER):
                if (place / folder).is_dir():
                    copytree(place / folder, session.folder / folder, dirs_exist_ok=True)
            session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
        return report
    return None


def _read_report(place: Path) -> TuneReport | None:
    try:
        report = TuneReport.model_validate_json((place / REPORT).read_bytes())
    except (OSError, ValidationError):
        return None
    other = report.equal_error.file if report.equal_error else None
    files = [file for file in (report.file, other) if file]
    return report if all((place / file).is_file() for file in files) else None


def _applied_reductions(report: TuneReport) -> dict[ReductionName, float | None]:
    found = dict[ReductionName, float | None]()
    if report.far_pairs and report.far_pairs.removed:
        found["far-pairs"] = report.far_pairs.distance
    if report.simplified_hulls:
        found["hulls"] = report.simplified_hulls.max_distance
    if report.removed_sensors:
        found["sensors"] = None
    return found


def _is_same_question(request: TuneRequest, report: TuneReport) -> bool:
    """Return whether a report of the same model and task has the same target and options."""
    target = report.target
    given = target.limit if target.kind in ("error", "forward error") else None
    asked = request.error
    if asked is not None and request.error_at is None:
        asked = min(asked, target.tolerance)
    same_work = report.ended == "complete" or report.max_time == request.max_time
    return (
        report.ended != "time"
        and same_work
        and (
            (asked, request.real_time, tuple(request.observed), request.error_at)
            == (given, target.real_time, target.observed, target.error_at)
            and dict(request.apply) == _applied_reductions(report)
        )
    )
