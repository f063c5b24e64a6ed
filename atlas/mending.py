"""Judges models with the changes that their records name, on seeds that nothing was chosen by."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from atlas.entry import Entry
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.model_writer import write_model
from contactlab.schema.examination import ModelChange
from contactlab.studies.examine.changes import edits_of, fresh
from contactlab.studies.examine.examination import ExamineRequest, open_model
from contactlab.studies.session import Session


def written_changes(entry: Entry, file: Path, folder: Path) -> Iterator[tuple[ModelChange, Path]]:
    """Yield the changes that an entry has judged, and the model with each, from its own words."""
    scene = SceneLoader(Path()).open(str(file)).with_effects("all")
    changes = entry.examination.changes if entry.examination else ()
    by_name = {change.name: change for change in changes}
    for place, changed in enumerate(entry.changed):
        change = by_name[changed.name]
        yield change, write_model(scene, edits_of(change, scene), folder / str(place), "").path


def judged_again(entry: Entry, file: Path, folder: Path) -> tuple[bool, str]:
    """Return whether a model is sound with the change that mends it, and what is said of it.

    As in a record, what the verdict named first must be gone too.
    """
    report, mending = entry.examination, entry.mending
    assert report is not None
    assert mending is not None
    found = written_changes(entry, file, folder)
    (model,) = (place for change, place in found if change.name == mending.name)
    reasons = report.budget.reasons if report.budget else ()
    return unseen_verdict(model, folder / "judged", [reason.row for reason in reasons[:1]])


def unseen_verdict(model: Path, folder: Path, gone: Sequence[str] = ()) -> tuple[bool, str]:
    """Return whether a model is sound on seeds that neither its task nor its changes have.

    And what its runs say. None of some rows of its budget may lead what it names.
    """
    request = ExamineRequest(str(model), sections=("labels", "budget"), max_cpu=0)
    examined = open_model(request, Session(folder, 0))
    examined.task = fresh(fresh(examined.task))
    verdict, judged = examined.verdict, examined.judged
    leading = judged.reasons[:1]
    sound = verdict.sound and not verdict.labels and judged.word in {"sound", "model"}
    sound &= not any(reason.row in gone for reason in leading)
    return sound, "; ".join([verdict.line, *(reason.sentence for reason in leading)])
