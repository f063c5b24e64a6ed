"""Examines one family in a process of its own.

`python -m bench.atlas.examining KIND FOLDER SECONDS NAME...` examines the files NAME, within
SECONDS of CPU. KIND is `whole`, `verdict` (for other releases of MuJoCo) or `tuned` (which adds to
an existing record). The record is written at the end.
"""

import re
import resource
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory

import mujoco
from bench.atlas.confirming import confirmed, questions, still_shown
from bench.atlas.entry import (
    RECORDS,
    Entry,
    FixedModel,
    Gripped,
    Tuned,
    film_of,
    judge_digest,
    recorded,
    records_of,
)
from bench.atlas.playing import film, moments, real_time
from bench.atlas.wheels import Robot, wheels

import contactlab
from contactlab.errors import ContactlabError, SceneError
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.model_writer import write_model
from contactlab.schema.examination import Examination
from contactlab.studies.examine.fixes import edits_of
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.session import Session

_VIEWS = ("labels", "budget", "facts", "checks")
MAX_CPU = 120
"""CPU that an examination is given [s], and each of the model with a change."""
TUNED_WITHIN = 3
"""CPU that a search may take at most, over what it is given."""
_LONGEST_PATCH = 8_000
_LONGEST = 300  # of a reason that is kept
_SHOWN = re.compile(r"^\s*\d*\s*\|")  # a line of a file, or what is marked below it
_TRIED = 4  # members of a family that may fail to compile


def examined(family: tuple[Robot, ...], folder: Path, *, whole: bool) -> Entry:
    """Examine the first member that is a robot or a scene, and its changes if that is asked for."""
    refused = list[str]()
    for robot in family[:_TRIED]:
        try:
            _refuse_objects(robot.file, folder)
            return _whole(family, robot, folder) if whole else _verdict(family, robot, folder)
        except ContactlabError as error:
            said_of = said(error).replace(f"{robot.wheel.place}/", "")
            refused.append(said_of.replace(f"{folder}/", "")[:_LONGEST])
    return unexamined(family, refused[0])


def said(error: ContactlabError) -> str:
    """Return what an error says in one line, without the lines that it shows and its code."""
    first, *lines = str(error).splitlines()
    shown = [line.partition("^")[2] for line in lines if _SHOWN.match(line)]
    causes = shown or [line for line in lines if "-->" not in line]
    return ": ".join(filter(None, (re.sub(r"^error\[.*?\]: ", "", first), *map(str.strip, causes))))


def _refuse_objects(file: Path, folder: Path) -> None:
    """Raise a ContactlabError if a file is no model, or one of a single body that moves."""
    model = open_model(str(file), Session(folder, 0)).base.model
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
        source=robot.wheel.source,
        family=tuple(member.name for member in family),
        digest=family[0].digest,
        judge=judge_digest(),
        contactlab=contactlab.__version__,
        mujoco=mujoco.__version__,
    )


def _verdict(family: tuple[Robot, ...], robot: Robot, folder: Path) -> Entry:
    """Return what is said of a model alone, without its changes."""
    before, file = _cpu(), str(robot.file)
    place = folder / "examined"
    report = contactlab.examine(
        file, section=[*_VIEWS], max_cpu=f"{MAX_CPU}s", workers=1, output=place
    )
    return _entry(family, robot).model_copy(
        update={
            "examination": _kept(report, robot),
            "passed": report.passed,
            "cpu": round(_cpu() - before, 1),
            "max_cpu": MAX_CPU,
        }
    )


def _whole(family: tuple[Robot, ...], robot: Robot, folder: Path) -> Entry:
    before, file = _cpu(), str(robot.file)
    report = contactlab.examine(file, max_cpu=f"{MAX_CPU}s", workers=1, output=folder / "examined")
    cpu = _cpu() - before
    lint = contactlab.lint(file)
    entry = _entry(family, robot).model_copy(
        update={
            "lint": {word: len(lint.open(word)) for word in ("error", "warning", "note")},
            "examination": _kept(report, robot),
            "passed": report.passed,
            "cpu": round(cpu, 1),
            "max_cpu": MAX_CPU,
        }
    )
    if entry.flagged:
        asked = questions(entry)
        confirmation = confirmed(entry, robot.file, asked) if asked else None
        entry = entry.model_copy(update={"confirmation": confirmation})
    return entry.model_copy(
        update={
            "fixed": tuple(_fixed(report, entry, file, folder)),
            "grip": _gripped(file),
            "rate": _shown(family, file, folder),
        }
    )


def _gripped(file: str) -> Gripped | None:
    """Return how a hand holds the usual object; None where nothing closes, or holds it.

    Two legs that close on it drop it, and are no hand.
    """
    try:
        report = contactlab.grip(file)
    except ContactlabError:
        return None
    if report.verdict == "drops":
        return None
    speeds = [drift.speed for drift in report.drifts]
    known = [speed for speed in speeds if speed is not None]
    worst = max(known) if known and len(known) == len(speeds) else None
    return Gripped(word=report.verdict, sentence=report.sentence, speed=worst)


def _shown(family: tuple[Robot, ...], file: str, folder: Path) -> float:
    """Return how fast plain steps of a task are, and keep a film of it if something draws here."""
    motions = open_model(str(file), Session(folder, 0)).motions
    try:
        made = film(motions[0].model, moments(motions))
    except Exception as error:  # noqa: BLE001 - of whatever draws: a film is no verdict
        print(f"no film: {error}", file=sys.stderr)
    else:
        stored = film_of(family[0].name)
        stored.parent.mkdir(exist_ok=True)
        stored.write_bytes(made)
    return float(f"{real_time(motions):.2g}")


def _fixed(report: Examination, entry: Entry, file: str, folder: Path) -> Iterator[FixedModel]:
    """Examine the model with each fix, until one passes."""
    scene = SceneLoader(Path()).open(file).with_effects("all")
    cause = _named(report)
    for place, fix in enumerate(sorted(report.fixes, key=lambda fix: fix.changes_model)):
        try:
            written = write_model(scene, edits_of(fix, scene), folder / f"fixed{place}", "")
        except SceneError:  # the fix says why it has no lines
            continue
        after = contactlab.examine(
            written.path,
            section=[*_VIEWS],
            max_cpu=f"{MAX_CPU}s",
            workers=1,
            output=folder / f"of{place}",
        )
        distance, before = fix.distance_to_reference, fix.distance_before
        asked = entry.confirmation
        fixed = FixedModel(
            name=fix.name,
            changes_model=fix.changes_model,
            apply=fix.apply,
            passed=after.passed and (not cause or cause != _named(after)),
            headline=after.headline,
            nearer=None if distance is None else before is None or distance < before,
            patch=patch if len(patch := written.patch.decode()) <= _LONGEST_PATCH else "",
            shown=still_shown(asked, written.path) if asked and asked.holds else None,
        )
        yield fixed
        if fixed.passed:
            return


def tuned(entry: Entry, file: Path, folder: Path, seconds: int) -> Entry:
    """Return a record with what `contactlab tune` recommends within some time [s]."""
    report = contactlab.tune(file, max_cpu=f"{seconds}s", workers=1, output=folder / "tuned")
    price = report.recommended.time_ratio if report.recommended else None
    settings = report.recommended.settings if report.recommended else {}
    found = Tuned(
        sentence=report.sentence,
        settings=settings,
        ratio=price.ratio if price else None,
        seconds=seconds,
    )
    return entry.model_copy(update={"tuned": found})


def _named(report: Examination) -> str:
    """Return the row that a verdict names first, or ""."""
    reasons = report.budget.reasons if report.budget else ()
    return reasons[0].row if reasons else ""


def _kept(report: Examination, robot: Robot) -> Examination:
    """Return a report without what hangs on this machine, or can be asked for again."""
    place = f"{robot.file.parent}/"
    lines = [
        fix.model_copy(
            update={
                "lines": tuple(line.replace(place, "") for line in fix.lines),
                "no_patch_reason": fix.no_patch_reason.replace(place, ""),
            }
        )
        for fix in report.fixes
    ]
    wheels_at = f"{robot.wheel.place.parent}/"
    facts = [
        fact.model_copy(
            update={
                "place": fact.place.replace(wheels_at, ""),
                "sentence": fact.sentence.replace(wheels_at, ""),
            }
        )
        for fact in report.facts
    ]
    left_out = {"written": None, "evidence": None, "page": None, "checks": (), "contacts": ()}
    told = {"model": robot.name, "fixes": tuple(lines), "facts": tuple(facts)}
    return report.model_copy(update={**left_out, **told})


def _cpu() -> float:
    """Return the seconds of CPU of this process and those it started [s]."""
    spent = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in spent)


def main() -> None:
    """Examine a family, within its limit of CPU."""
    kind, place, seconds, *names = sys.argv[1:]
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 5))
    warnings.simplefilter("ignore")
    known = {wheel.name: wheel for wheel in wheels(Path(place))}
    parts = [name.partition("/") for name in names]
    family = tuple(Robot(known[wheel], PurePosixPath(path)) for wheel, _, path in parts)
    with TemporaryDirectory(prefix="atlas-") as folder:
        if kind == "tuned":
            entry = recorded(names[0])
            assert entry is not None
            file = Path(place) / entry.name
            tuned(entry, file, Path(folder), int(seconds) // TUNED_WITHIN).save(RECORDS)
        else:
            entry = examined(family, Path(folder), whole=kind == "whole")
            entry.save(records_of(kind))


if __name__ == "__main__":
    main()
