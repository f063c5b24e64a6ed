"""Judges models with the fixes of their records, on unused seeds."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.atlas.entry import Entry

from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.model_writer import write_model
from contactlab.schema.examination import Fix
from contactlab.studies.examine.fixes import edits_of
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.session import Session
from contactlab.tasks.task_motions import with_new_seeds


def write_fixed_models(entry: Entry, file: Path, folder: Path) -> Iterator[tuple[Fix, Path]]:
    """Yield the fixes that an entry has judged, and the file of the model with each."""
    scene = SceneLoader(Path()).open(str(file)).with_effects("all")
    fixes = {fix.name: fix for fix in (entry.examination.fixes if entry.examination else ())}
    for place, fixed in enumerate(entry.fixed):
        fix = fixes[fixed.name]
        yield fix, write_model(scene, edits_of(fix, scene), folder / str(place), "").path


def judged_again(entry: Entry, file: Path, folder: Path) -> tuple[bool, str]:
    """Return whether a model passes with its working fix, and its verdict in words.

    As in a record, the first reason of the verdict must be gone too.
    """
    report, working = entry.examination, entry.working_fix
    assert report is not None
    assert working is not None
    models = write_fixed_models(entry, file, folder)
    (model,) = (place for fix, place in models if fix.name == working.name)
    reasons = report.budget.reasons if report.budget else ()
    return unseen_verdict(model, folder / "judged", [reason.row for reason in reasons[:1]])


def unseen_verdict(model: Path, folder: Path, gone: Sequence[str] = ()) -> tuple[bool, str]:
    """Return whether a model passes on seeds that neither its task nor its fixes have used.

    And its verdict in words. No row of `gone` may be its first reason.
    """
    examined = open_model(str(model), Session(folder, 0), rows=None, seconds=0)
    examined.task = with_new_seeds(with_new_seeds(examined.task))
    verdict, judged = examined.verdict, examined.budget_verdict
    leading = judged.reasons[:1]
    passed = verdict.is_accurate and not verdict.labels and judged.word in {"ok", "depends"}
    passed &= not any(reason.row in gone for reason in leading)
    return passed, "; ".join([verdict.line, *(reason.sentence for reason in leading)])
