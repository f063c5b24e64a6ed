"""Repairs the causes that come before all others, the file and the start, and judges the rest then.

Softness, steps and solvers are judged in vain while bodies begin in each other or collide twice. So
each repair is run, in this order, and the verdict that remains is that of the repaired model.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from contactlab.budget.measuring import evaluations, pace, steps_of
from contactlab.errors import OutputError, SceneError
from contactlab.modifications.catalogue import list_rows
from contactlab.scene.model_draft import ModelEdits, join_edits
from contactlab.scene.model_names import name_of
from contactlab.scene.model_writer import WrittenModel, write_model
from contactlab.schema.examination import Cause, Fix, RejectedFix, RunLabel, Stage
from contactlab.schema.verdict import PASSING_VERDICTS, VERDICT_ORDER, VerdictWord, join_verdict
from contactlab.schema.verification import VerifiedChange
from contactlab.studies.examine.fixes import RepairedFiles
from contactlab.studies.examine.linted_file import FileFault
from contactlab.studies.examine.start_fixes import moved_starts
from contactlab.studies.lint.overlaps import COINCIDENT, find_coincident_geoms
from contactlab.tasks.checked_model import CheckedModel
from contactlab.tasks.task_verdict import run_labels

SINGLE = "single"
"""Name for `--apply` of the repair of geoms that collide twice."""
_JUDGING = ("numerics", "model")  # kinds of rows that a verdict and its main cause are read from
_STORE = "repaired"  # of runs of a repaired model


class Repair(NamedTuple):
    """A change that repairs a cause, if it does.

    Attributes:
        stage: of the cause.
        sentence: the cause.
        is_certain: whether the cause is known without a run.
    """

    stage: Stage
    sentence: str
    name: str
    apply: str
    edits: ModelEdits
    is_certain: bool = False


@dataclass(frozen=True)
class RepairedModel:
    """A model with its first causes repaired, or as its author wrote it.

    Attributes:
        examined: the model.
        labels: failure labels of its runs.
        causes: those that were repaired, and those of the file that cannot be.
        fixes: the repairs.
        rejected: repairs that make a measure worse.
        edits: all repairs together.
    """

    examined: CheckedModel
    labels: tuple[RunLabel, ...]
    causes: tuple[Cause, ...] = ()
    fixes: tuple[Fix, ...] = ()
    rejected: tuple[RejectedFix, ...] = ()
    edits: ModelEdits = field(default_factory=ModelEdits)

    @property
    def word(self) -> VerdictWord:
        """The verdict that is left."""
        return join_verdict(self.examined.judged.word, failing=bool(self.labels))


@dataclass(frozen=True)
class CauseRepairer:
    """Repairs the first causes of a model's verdict.

    Attributes:
        original: the model as its author wrote it.
        folder: for written models.
        open_model: opens a written model under the same task, with rows of its budget.
        verify: compares a repaired model with the original.
        left: returns the CPU time that is left [s].
        describe: returns the headline of a repaired model.
    """

    original: CheckedModel
    folder: Path
    open_model: Callable[[str, Sequence[str]], CheckedModel]
    verify: Callable[[CheckedModel, ModelEdits], VerifiedChange]
    left: Callable[[], float]
    describe: Callable[[RepairedModel], str]

    def repair_model(
        self, labels: tuple[RunLabel, ...], faults: Sequence[FileFault]
    ) -> RepairedModel:
        """Return the model with its file and its start repaired, as far as that helps."""
        model = RepairedModel(self.original, labels)
        for fault in faults:
            if fault.rule == COINCIDENT:
                model = self._try_repair(model, self._single_geoms(fault), "fails")
            else:
                model = replace(model, causes=(*model.causes, *list_file_causes([fault])))
        if any(fault.is_of_start for fault in faults) or model.word == "ok":
            return model
        first = model
        for repair in self._moved_starts(first):
            tried = self._try_repair(first, repair, first.word)
            better = _rank_verdict(tried.word) > _rank_verdict(model.word)
            model = tried if better else replace(model, rejected=tried.rejected)
        return model

    def _single_geoms(self, fault: FileFault) -> Repair:
        model = self.original.base.model
        doubled = [name_of(model, "geom", second) for _, second in find_coincident_geoms(model)]
        more = f" and {len(doubled) - 1} more" if len(doubled) > 1 else ""
        name, edits = f"no contacts of {doubled[0]}{more}", ModelEdits(masked=tuple(doubled))
        return Repair("file", fault.sentence, name, SINGLE, edits, is_certain=True)

    def _moved_starts(self, model: RepairedModel) -> Iterator[Repair]:
        examined = model.examined
        scene = examined.scene.with_effects("all")
        for start in moved_starts(scene, examined.values, examined.motions[0]):
            yield Repair("start", start.sentence, start.name, start.apply, start.edits)

    def _try_repair(
        self, model: RepairedModel, repair: Repair, before: VerdictWord
    ) -> RepairedModel:
        # The model itself if it cannot be judged, or is no better.
        examined, edits = model.examined, join_edits([model.edits, repair.edits])
        known = Cause(stage=repair.stage, sentence=repair.sentence)
        listed = replace(model, causes=(*model.causes, known)) if repair.is_certain else model
        rows = [row.name for row in list_rows() if row.kind in _JUDGING]
        looks = evaluations(
            examined.motions[0].model,
            examined.settings,
            [row for row in list_rows() if row.name in rows],
        )
        if looks * steps_of(examined.motions) * pace(examined.motions) > self.left():
            return listed
        try:
            written = self._write_repaired(edits, repair.apply)
            changed = self.open_model(written.reference, rows)
            labels = self._find_labels(changed)
        except (SceneError, OutputError):
            return listed
        repaired = RepairedModel(changed, labels, model.causes, model.fixes, model.rejected, edits)
        if _rank_verdict(repaired.word) <= _rank_verdict(before) and not repair.is_certain:
            return model
        found = None if repair.is_certain else self.verify(changed, edits)
        if found is not None and not found.passed:
            rejected = RejectedFix(name=repair.name, reason=found.sentence)
            return replace(model, rejected=(*model.rejected, rejected))
        removes = "verdict" if repaired.word in PASSING_VERDICTS else "cause"
        fix = Fix(
            name=repair.name,
            changes_model=True,
            apply=repair.apply,
            removes=removes,
            settings={},
            changed_keyframes=edits.posed,
            moved_bodies=edits.placed,
            masked_geoms=edits.masked,
            error=None,
            distance_to_reference=None,
            distance_before=None,
            time_ratio=None,
            lines=written.lines,
            verification=found,
        )
        cause = known.model_copy(
            update={
                "repair": repair.name,
                "verdict": repaired.word,
                "remainder": self.describe(repaired),
            }
        )
        causes = (*model.causes, cause)
        return replace(repaired, causes=causes, fixes=(*model.fixes, fix))

    def _write_repaired(self, edits: ModelEdits, name: str) -> WrittenModel:
        original = self.original
        whole = replace(edits, settings={**original.values, **edits.settings})
        return write_model(original.scene.with_effects("all"), whole, self.folder / name)

    def _find_labels(self, changed: CheckedModel) -> tuple[RunLabel, ...]:
        task = changed.task
        runs = changed.run(_STORE, "With repaired causes", seeds=task.seeds, trace="none")
        return run_labels(task, [run.record for run in runs], changed.budget)

    def list_files(self, model: RepairedModel) -> RepairedFiles | None:
        """Return the repairs as fixes are written with them; None without any."""
        if not model.fixes:
            return None
        edits = replace(model.edits, settings={**self.original.values, **model.edits.settings})
        scene = self.original.scene.with_effects("all")
        return RepairedFiles(scene, edits, tuple(fix.apply for fix in model.fixes))


def list_file_causes(faults: Sequence[FileFault]) -> Iterator[Cause]:
    """Yield the causes that a file has before any is repaired."""
    for fault in faults:
        yield Cause(stage="file", sentence=fault.sentence)


def _rank_verdict(word: VerdictWord) -> int:
    return VERDICT_ORDER.index(word)
