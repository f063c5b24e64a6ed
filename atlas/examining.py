"""Examines one family in a process of its own: `python -m atlas.examining FOLDER SECONDS NAME...`.

SECONDS are its limit of CPU, the names those of its files. The record is written once all is known.
"""

import re
import resource
import sys
import warnings
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory

import mujoco

import contactlab
from atlas.entry import Changed, Entry, judge_digest
from atlas.wheels import Robot, wheels
from contactlab.errors import ContactlabError
from contactlab.schema.examination import Examination
from contactlab.studies.examine.examination import ExamineRequest, open_model
from contactlab.studies.session import Session

_VIEWS = ("labels", "budget", "facts", "checks")
_LONGEST = 300  # of a reason that is kept
_SHOWN = re.compile(r"^\s*\d*\s*\|")  # a line of a file, or what is marked below it
_TRIED = 4  # members of a family that may fail to compile


def examined(family: tuple[Robot, ...], folder: Path) -> Entry:
    """Examine the first member that is a robot or a scene, and its first change."""
    refused = list[str]()
    for robot in family[:_TRIED]:
        try:
            _refuse_objects(robot.file, folder)
            return _whole(family, robot, folder)
        except ContactlabError as error:
            refused.append(said(error).replace(f"{robot.wheel.place}/", "")[:_LONGEST])
    return unexamined(family, refused[0])


def said(error: ContactlabError) -> str:
    """Return what an error says in one line, without the lines that it shows and its code."""
    first, *lines = str(error).splitlines()
    shown = [line.partition("^")[2] for line in lines if _SHOWN.match(line)]
    causes = shown or [line for line in lines if "-->" not in line]
    return ": ".join(filter(None, (re.sub(r"^error\[.*?\]: ", "", first), *map(str.strip, causes))))


def _refuse_objects(file: Path, folder: Path) -> None:
    """Raise a ContactlabError if a file is no model, or one of a single body that moves."""
    request = ExamineRequest(str(file))
    model = open_model(request, Session(folder, 0)).base.model
    if sum(1 for body in range(model.nbody) if model.body_dofnum[body]) < 2:
        raise ContactlabError(
            "an object, not a robot or a scene: fewer than two bodies have joints"
        )


def unexamined(family: tuple[Robot, ...], refused: str) -> Entry:
    """Return the record of a family that has no verdict, and why."""
    return _entry(family, family[0]).model_copy(update={"refused": refused})


def _entry(family: tuple[Robot, ...], robot: Robot) -> Entry:
    return Entry(
        name=robot.name,
        wheel=robot.wheel.name,
        version=robot.wheel.version,
        licence=robot.wheel.licence,
        family=tuple(member.name for member in family),
        digest=family[0].digest,
        judge=judge_digest(),
        contactlab=contactlab.__version__,
        mujoco=mujoco.__version__,
    )


def _whole(family: tuple[Robot, ...], robot: Robot, folder: Path) -> Entry:
    file = str(robot.file)
    before = _cpu()
    write = folder / "written" / f"{robot.file.stem}.xml"
    report = contactlab.examine(file, workers=1, output=folder / "examined", write=write)
    cpu = _cpu() - before
    lint = contactlab.lint(file)
    counts = {word: len(lint.open(word)) for word in ("error", "warning", "note")}
    return _entry(family, robot).model_copy(
        update={
            "lint": counts,
            "examination": _kept(report, robot),
            "sound": report.sound,
            "cpu": round(cpu, 1),
            "changed": _changed(report, file, folder),
        }
    )


def _changed(report: Examination, file: str, folder: Path) -> Changed | None:
    """Examine the model with its first change, of computation if there is one."""
    changes = [change for change in report.changes if change.removes == "verdict"]
    if not changes:
        return None
    chosen = next((change for change in changes if not change.physics), changes[0])
    written = report.written
    if written is None and chosen.physics:
        again = contactlab.examine(
            file,
            only=["changes"],
            accept=[chosen.accept],
            write=folder / "accepted" / Path(file).with_suffix(".xml").name,
            workers=1,
            output=folder / "accepting",
        )
        written = again.written
    if written is None:
        return None
    after = contactlab.examine(written, only=[*_VIEWS], workers=1, output=folder / "changed")
    apart, before = chosen.apart, chosen.before
    nearer = apart is not None and (before is None or apart < before)
    return Changed(
        name=chosen.name,
        physics=chosen.physics,
        sound=after.sound and _named(report) != _named(after),
        sentence=after.sentence,
        nearer=nearer,
    )


def _named(report: Examination) -> str:
    """Return the row that a verdict names first, or ""."""
    reasons = report.budget.reasons if report.budget else ()
    return reasons[0].row if reasons else ""


def _kept(report: Examination, robot: Robot) -> Examination:
    """Return a report without what hangs on this machine, or can be asked for again."""
    place = f"{robot.file.parent}/"
    lines = [
        change.model_copy(
            update={
                "lines": tuple(line.replace(place, "") for line in change.lines),
                "unwritten": change.unwritten.replace(place, ""),
            }
        )
        for change in report.changes
    ]
    left_out = {"written": None, "evidence": None, "page": None, "checks": (), "contacts": ()}
    return report.model_copy(update={**left_out, "model": robot.name, "changes": tuple(lines)})


def _cpu() -> float:
    """Return the seconds of CPU of this process and those it started [s]."""
    spent = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in spent)


def main() -> None:
    """Examine a family, within its limit of CPU."""
    place, seconds, *names = sys.argv[1:]
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 5))
    warnings.simplefilter("ignore")
    known = {wheel.name: wheel for wheel in wheels(Path(place))}
    parts = [name.partition("/") for name in names]
    family = tuple(Robot(known[wheel], PurePosixPath(path)) for wheel, _, path in parts)
    with TemporaryDirectory(prefix="atlas-") as folder:
        examined(family, Path(folder)).save()


if __name__ == "__main__":
    main()
