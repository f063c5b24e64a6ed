"""Repairs the causes that come before all others, the file and the start, and judges the rest then.

Softness, steps and solvers are judged in vain while bodies begin in each other or collide twice. So
each repair is run, in this order, and the verdict that remains is that of the repaired model.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from contactlab.budget.counted_time import count_pace
from contactlab.budget.measuring import Settings, count_evaluations, steps_of
from contactlab.closed_loop.loop_margins import LoopStudy
from contactlab.errors import OutputError, SceneError
from contactlab.foreign_code import printed_as_text
from contactlab.modifications.catalogue import list_rows
from contactlab.rendering.amounts import format_others
from contactlab.reporting.loop_words import loop_sentence
from contactlab.scene.model_draft import ModelEdits, join_edits
from contactlab.scene.model_names import name_of
from contactlab.scene.model_writer import WrittenModel, write_model
from contactlab.scene.scene import Scene
from contactlab.schema.control_loop import ControlLoopReport
from contactlab.schema.drive import PolicyDrive
from contactlab.schema.examination import Cause, Fix, RejectedFix, RunLabel, Stage
from contactlab.schema.verdict import PASSING_VERDICTS, VERDICT_ORDER, VerdictWord, join_verdict
from contactlab.schema.verification import VerifiedChange
from contactlab.studies.examine.design_causes import leaves_hand
from contactlab.studies.examine.engine_faults import list_workarounds
from contactlab.studies.examine.fixes import RepairedFiles
from contactlab.studies.examine.linted_file import FileFault, lint_file, write_rule_edits
from contactlab.studies.examine.masked_passages import find_masked_fall
from contactlab.studies.examine.permanent_overlaps import find_permanent_overlaps
from contactlab.studies.examine.policy_loop import list_loop_repairs
from contactlab.studies.examine.start_fixes import MovedStart, moved_starts, standing_starts
from contactlab.studies.grip.gripping import GripRequest, judge_grip
from contactlab.studies.lint.overlaps import COINCIDENT, find_coincident_geoms
from contactlab.tasks.checked_model import CheckedModel
from contactlab.tasks.task_verdict import run_labels

SINGLE = "single"
"""Name for `--apply` of the repair of geoms that collide twice."""
GRIP = "grip"
"""Name for `--apply` of the repair that keeps an object in its hand."""
MASKED_FALL = "masked-fall"
_JUDGING = ("numerics", "model")  # kinds of rows that a verdict and its main cause are read from
_STORE = "repaired"  # of runs of a repaired model


class Repair(NamedTuple):
    """A change that repairs a cause, if it does.

    Attributes:
        stage: of the cause.
        sentence: the cause.
        is_certain: whether the cause is known without a run of the repaired model.
        keeps_model: whether it computes the same model differently.
        file: main file of a model with the change, if its own files have it, and changed lines.
        rule: of lint that finds the cause; "" if none does.
        drive: of the task with the change, if that is another one.
        controller: the change of the controller, in words.
    """

    stage: Stage
    sentence: str
    name: str
    apply: str
    edits: ModelEdits
    is_certain: bool = False
    keeps_model: bool = False
    file: tuple[Path, tuple[str, ...]] | None = None
    rule: str = ""
    drive: PolicyDrive | None = None
    controller: str = ""

    def repairs_fault(self, fault: FileFault) -> bool:
        """Return whether it is a repair of a fault: of its rule, or of the start it gives."""
        return fault.rule == self.rule or (self.stage == fault.stage == "start")


class PendingRepair(NamedTuple):
    """A repair that improves the verdict, and that its verification rejects.

    Attributes:
        repair: the change.
        examined: the model with it.
    """

    repair: Repair
    examined: CheckedModel


@dataclass(frozen=True)
class RepairedModel:
    """A model with its first causes repaired, or as its author wrote it.

    Attributes:
        examined: the model.
        labels: failure labels of its runs.
        causes: those that were repaired, and those of the file that cannot be.
        fixes: the repairs.
        rejected: repairs that make a measure worse.
        edits: all repairs together, except those of files.
        scene: of its files with repairs by rules of lint; None for the original's.
        faults: of its files, that make it fail whatever its runs say, and are not repaired.
        failed_checks: checks of the original that fail for other reasons than its runs.
        pending: rejected repairs, which may pass together with another one.
    """

    examined: CheckedModel
    labels: tuple[RunLabel, ...]
    causes: tuple[Cause, ...] = ()
    fixes: tuple[Fix, ...] = ()
    rejected: tuple[RejectedFix, ...] = ()
    edits: ModelEdits = field(default_factory=ModelEdits)
    scene: Scene | None = None
    faults: tuple[FileFault, ...] = ()
    failed_checks: tuple[str, ...] = ()
    pending: tuple[PendingRepair, ...] = ()

    @property
    def word(self) -> VerdictWord:
        """The verdict that is left."""
        failing = bool(self.labels or self.faults or self.failed_checks)
        return join_verdict(self.examined.budget_verdict.word, failing=failing)

    @property
    def passes(self) -> bool:
        """Whether the verdict that is left passes."""
        return self.word in PASSING_VERDICTS

    @property
    def complaints(self) -> frozenset[str]:
        """Its faults, its failure labels, and the rows of its budget that do not pass."""
        reasons = self.examined.budget_verdict.reasons
        rows = {one.row for one in reasons if one.verdict not in PASSING_VERDICTS}
        faults = {fault.rule for fault in self.faults}
        return frozenset(rows | faults | {label.label for label in self.labels})


@dataclass(frozen=True)
class CauseRepairer:
    """Repairs the first causes of a model's verdict.

    Attributes:
        original: the model as its author wrote it.
        folder: for written models.
        open_model: opens a written model under the same task, or with another drive, with rows of
            its budget.
        verify: compares a repaired model with the original, and whether it rests elsewhere.
        find_time_left: returns the counted time that is left [s].
        describe: returns the headline of a repaired model.
        meets_fault: whether a known fault of the engine acts in the motions.
    """

    original: CheckedModel
    folder: Path
    open_model: Callable[[str, Sequence[str], Settings, PolicyDrive | None], CheckedModel]
    verify: Callable[[CheckedModel, bool], VerifiedChange]
    find_time_left: Callable[[], float]
    describe: Callable[[RepairedModel], str]
    meets_fault: bool = False

    def repair_model(
        self,
        labels: tuple[RunLabel, ...],
        faults: Sequence[FileFault],
        failed_checks: tuple[str, ...] = (),
    ) -> RepairedModel:
        """Return the model with its file and its start repaired, as far as that helps."""
        certain = tuple(fault for fault in faults if fault.is_certain)
        model = RepairedModel(self.original, labels, faults=certain, failed_checks=failed_checks)
        if self.meets_fault:
            # All other repairs would run on wrong forces.
            model = self._avoid_engine_fault(model)
        for fault in faults:
            if fault.rule == COINCIDENT:
                model = self._try_repair(model, self._single_geoms(fault))
            elif fault.rule == MASKED_FALL:
                model = self._allow_contacts(model, fault)
            elif fault.stage == "file" and (fault.is_certain or model.word != "ok"):
                model = self._repair_by_lint(model, fault)
        if any(fault.is_of_start for fault in faults):
            return model
        if any(fault.stage == "file" for fault in model.faults):
            # No repair of its start changes that verdict.
            listed = {cause.sentence for cause in model.causes}
            more = (one for one in list_file_causes(model.faults) if one.sentence not in listed)
            return replace(model, causes=(*model.causes, *more))
        if model.word != "ok":
            model = self._part_links(model)
        known = [fault.sentence for fault in faults if fault.stage == "start"]
        model = self._move_start(model, next(iter(known), ""))
        return model if self.meets_fault else self._avoid_engine_fault(model)

    def repair_numerics(
        self, model: RepairedModel, faults: Sequence[FileFault], *, names_only: bool
    ) -> RepairedModel:
        """Return the model with lint's edits of faults of its step, as far as they help.

        If other fixes are verified for the same verdict, the edits only name their causes.
        """
        repaired = model
        for fault in faults:
            if fault.stage == "numerics" and not repaired.passes:
                repaired = self._repair_by_lint(repaired, fault)
        return replace(model, causes=repaired.causes) if names_only else repaired

    def _avoid_engine_fault(self, model: RepairedModel) -> RepairedModel:
        if model.word == "ok":
            return model
        source = (model.scene or self.original.scene).source
        for fault in list_workarounds(model.examined.motions[0].model, source):
            edits = ModelEdits(fault.settings)
            repair = Repair("engine", fault.sentence, fault.name, "", edits, keeps_model=True)
            tried = self._try_repair(model, repair)
            if len(tried.fixes) > len(model.fixes):
                return tried
            model = replace(model, rejected=tried.rejected)
        return model

    def _move_start(self, first: RepairedModel, known: str) -> RepairedModel:
        # The best start lets the robot stand; the next best is the nearest that limits allow.
        if first.word == "ok" and not known:
            return first
        examined, best = first.examined, None
        scene, motion = examined.scene.with_effects("all"), examined.motions[0]
        starts = list[MovedStart]()
        if known:
            starts += standing_starts(scene, examined.values, motion, off_limits=True)
        starts += moved_starts(scene, examined.values, motion)
        rejected = [*first.rejected]
        for start in starts:
            sentence, certain = known or start.sentence, bool(known)
            repair = Repair("start", sentence, start.name, start.apply, start.edits, certain)
            tried = self._try_repair(first, repair)
            rejected += tried.rejected[len(first.rejected) :]
            if len(tried.fixes) > len(first.fixes) and (
                best is None or _rank_verdict(tried.word) > _rank_verdict(best.word)
            ):
                best = tried
            if known and best is not None and best.word in PASSING_VERDICTS:
                break
        if best is not None:
            return best
        cause = (Cause(stage="start", sentence=known),) if known else ()
        return replace(first, causes=(*first.causes, *cause), rejected=tuple(rejected))

    def _repair_by_lint(self, model: RepairedModel, fault: FileFault) -> RepairedModel:
        # Later repairs are written into the files with these edits.
        folder = self.folder / fault.rule
        source = (model.scene or self.original.scene).source
        written = write_rule_edits(source, fault.rule, folder)
        if written is None:
            return replace(model, causes=(*model.causes, *list_file_causes([fault])))
        keeps_model = fault.stage == "numerics"
        repair = Repair(
            stage=fault.stage,
            sentence=fault.sentence,
            name=f"the edit of lint's rule {fault.rule}",
            apply="" if keeps_model else fault.rule,
            edits=ModelEdits(),
            is_certain=fault.is_certain,
            keeps_model=keeps_model,
            file=written,
            rule=fault.rule,
        )
        return self._try_repair(model, repair)

    def repair_grip(self, model: RepairedModel, cause: Cause) -> RepairedModel:
        """Return the model with the first fix that keeps the object of its keyframe in the hand."""
        for name, settings in _list_grip_settings(model.examined):
            edits = ModelEdits(settings)
            tried = self._try_repair(
                model, Repair(cause.stage, cause.sentence, name, GRIP, edits, is_certain=True)
            )
            if len(tried.fixes) > len(model.fixes):
                return tried
            model = replace(model, rejected=tried.rejected)
        return replace(model, causes=(*model.causes, cause))

    def join_grip(self, model: RepairedModel) -> RepairedModel:
        """Return the model with a rejected repair and a fix of its grip, if they pass together.

        Less squeeze, for example, lets an object creep, which alone is worse than as written.
        """
        if model.passes:
            return model
        for repair, examined in model.pending:
            # An unlimited jaw may throw its object away, so that only the repaired model holds it.
            try:
                fixes = [*_list_grip_settings(examined)]
            except SceneError:
                continue
            without = replace(
                model,
                causes=tuple(one for one in model.causes if one.sentence != repair.sentence),
                rejected=tuple(one for one in model.rejected if one.name != repair.name),
            )
            for name, settings in fixes:
                joined = repair._replace(
                    name=f"{repair.name}, with {name}",
                    apply=GRIP,
                    edits=join_edits([repair.edits, ModelEdits(settings)]),
                )
                tried = self._try_repair(without, joined)
                if len(tried.fixes) > len(model.fixes) or tried.causes != without.causes:
                    return tried
        return model

    def _part_links(self, model: RepairedModel) -> RepairedModel:
        overlaps = find_permanent_overlaps(model.examined.motions[0])
        if not overlaps:
            return model
        worst = max(overlaps, key=lambda overlap: overlap.depth)
        pair, more = " and ".join(worst.names), len(overlaps) - 1
        others = format_others(more, "pair")
        sentence = (
            f"{pair} overlap in every pose of the joints between them: by {1e3 * worst.depth:.3g} "
            f"mm at the start{others}, so their contact jams these joints"
        )
        name = f"no contacts of {pair}" + (
            f" and {more} more pair{'s' * (more > 1)}" if more else ""
        )
        edits = ModelEdits(excluded=tuple(overlap.names for overlap in overlaps))
        return self._try_repair(model, Repair("file", sentence, name, "exclude", edits))

    @printed_as_text()
    def repair_loop(
        self,
        model: RepairedModel,
        study: LoopStudy | None,
        report: ControlLoopReport | None,
        requested: Sequence[str],
    ) -> RepairedModel:
        """Return the model with a change that makes the loop of its policy hold, if one helps.

        A requested one comes first.
        """
        if study is None or report is None or report.holds:
            return model
        sentence, repairs = (
            loop_sentence(report),
            [*list_loop_repairs(study, report, self.original.scene.drive.drive)],
        )
        for repair in sorted(repairs, key=lambda one: one.apply not in requested):
            change = Repair(
                stage="numerics",
                sentence=sentence,
                name=repair.name,
                apply=repair.apply,
                edits=repair.edits,
                is_certain=True,
                drive=repair.drive,
                controller=repair.controller,
            )
            tried = self._try_repair(model, change)
            if tried.fixes != model.fixes:
                return tried
            model = replace(model, rejected=tried.rejected)
        return model

    def _allow_contacts(self, model: RepairedModel, fault: FileFault) -> RepairedModel:
        fall = find_masked_fall(self.original.motions[0])
        if fall is None:
            return model
        edits, name = ModelEdits({"contact": True}), "contacts on"
        if fall.widened_masks:
            edits = ModelEdits(widened_masks=fall.widened_masks)
            geoms = dict.fromkeys(geom for geom, _, _ in fall.widened_masks)
            name = f"contacts with {' and '.join(geoms)}"
        repair = Repair(
            "file", fault.sentence, name, "contacts", edits, is_certain=True, rule=fault.rule
        )
        return self._try_repair(model, repair)

    def _single_geoms(self, fault: FileFault) -> Repair:
        model = self.original.base.model
        doubled = [name_of(model, "geom", second) for _, second in find_coincident_geoms(model)]
        more = f" and {len(doubled) - 1} more" if len(doubled) > 1 else ""
        name, edits = f"no contacts of {doubled[0]}{more}", ModelEdits(masked=tuple(doubled))
        return Repair("file", fault.sentence, name, SINGLE, edits, is_certain=True, rule=fault.rule)

    def _try_repair(self, model: RepairedModel, repair: Repair) -> RepairedModel:
        # The model itself if it cannot be judged, or is no better.
        edits = join_edits([model.edits, repair.edits])
        fails = repair.stage == "file" or repair.is_certain
        known = Cause(stage=repair.stage, sentence=repair.sentence, fails=fails)
        of_file = repair.stage == "file" and repair.is_certain
        listed = replace(model, causes=(*model.causes, known)) if of_file else model
        chosen = self._choose_rows(model)
        if chosen is None:
            return listed
        scene = model.scene
        try:
            if repair.file is not None:
                scene = self.original.scenes.open(str(repair.file[0]))
            folder = str(len(model.causes)) + (repair.apply or repair.stage)
            written = self._write_repaired(scene, edits, folder)
            changed = self.open_model(written.reference, *chosen, repair.drive)
            labels = self._find_labels(changed)
        except (SceneError, OutputError):
            return listed
        # A written copy of a URDF has the faults that only its import shows, too.
        left = [fault for fault in model.faults if not repair.repairs_fault(fault)]
        task, known_rules = self.original.task, {fault.rule for fault in left}
        linted = lint_file(changed.scene.source, written.reference, task.start)
        left += [
            fault for fault in linted.faults if fault.is_certain and fault.rule not in known_rules
        ]
        repaired = replace(
            model, examined=changed, labels=labels, edits=edits, scene=scene, faults=tuple(left)
        )
        if not of_file and not is_better(model, repaired, repair):
            return model
        # An object that the original drops comes to rest elsewhere, as with another start.
        elsewhere = edits.fixes_start or (repair.apply == GRIP and not repair.rule)
        found = None if of_file else self.verify(changed, elsewhere)
        if found is not None and not found.passed:
            rejected = (*model.rejected, RejectedFix(name=repair.name, reason=found.sentence))
            pending = (*model.pending, PendingRepair(repair, changed))
            decides = repair.stage == "file" and _removes_complaints(model, repaired)
            causes = (*model.causes, known) if decides else model.causes
            return replace(model, causes=causes, rejected=rejected, pending=pending)
        removes = "verdict" if repaired.word in PASSING_VERDICTS else "cause"
        own_lines = repair.file[1] if repair.file else ()
        joins = repair.edits != ModelEdits()  # with settings besides the lines of its file
        fix = Fix(
            name=repair.name,
            changes_model=not repair.keeps_model,
            apply=repair.apply,
            removes=removes,
            settings={
                **repair.edits.settings,  # pyright: ignore[reportArgumentType] - settings
                **self._list_drive_changes(repair.drive),
            },
            changed_keyframes=edits.posed,
            moved_bodies=edits.placed,
            masked_geoms=edits.masked,
            opened_geoms=edits.widened_masks,
            position_servos=edits.servos,
            changed_controls=edits.steered,
            error=None,
            distance_to_reference=None,
            distance_before=None,
            time_ratio=None,
            lines=(*own_lines, *written.lines) if joins or not own_lines else own_lines,
            controller=repair.controller,
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

    def _list_drive_changes(self, drive: PolicyDrive | None) -> dict[str, str | float]:
        own = self.original.scene.drive.drive
        if drive is None or not isinstance(own, PolicyDrive):
            return {}
        known = own.model_dump()
        changed = {key: v for key, v in drive.model_dump().items() if v != known.get(key)}
        return {f"drive.{key}": value for key, value in changed.items()}

    def _choose_rows(self, model: RepairedModel) -> tuple[list[str], Settings] | None:
        # Rows of a repaired model's budget, and how it is measured: all that judge, or, if that
        # takes too long and the numerics fail, a first look at these. None if there is no time.
        motions = model.examined.motions
        rows = [row for row in list_rows() if row.kind in _JUDGING]
        quick = Settings(check=False, energy=False)
        step = steps_of(motions) * count_pace(motions)
        if count_evaluations(motions[0].model, Settings(), rows) * step <= self.find_time_left():
            return [row.name for row in rows], Settings()
        affords = count_evaluations(motions[0].model, quick) * step <= self.find_time_left()
        return ([], quick) if affords and model.word not in PASSING_VERDICTS else None

    def _write_repaired(self, scene: Scene | None, edits: ModelEdits, name: str) -> WrittenModel:
        original = self.original
        whole = replace(edits, settings={**original.values, **edits.settings})
        folder = self.folder / "written" / name
        return write_model((scene or original.scene).with_effects("all"), whole, folder)

    def _find_labels(self, changed: CheckedModel) -> tuple[RunLabel, ...]:
        task = changed.task
        runs = changed.run(_STORE, "With repaired causes", seeds=task.seeds, trace="none")
        return run_labels(task, [run.record for run in runs], changed.budget)

    def list_files(self, model: RepairedModel) -> RepairedFiles | None:
        """Return the repairs as fixes are written with them; None without any."""
        if not model.fixes:
            return None
        edits = replace(model.edits, settings={**self.original.values, **model.edits.settings})
        scene = (model.scene or self.original.scene).with_effects("all")
        return RepairedFiles(scene, edits, tuple(fix.apply for fix in model.fixes if fix.apply))


def _list_grip_settings(examined: CheckedModel) -> Iterator[tuple[str, dict[str, object]]]:
    # Names and settings of the fixes that keep the object of the keyframe in the hand.
    grip = judge_grip(GripRequest(examined.reference, keyframe=examined.task.start))
    catalogue = examined.scene.catalogue
    for fix in grip.fixes:
        axes = {name: catalogue.find_axis(name) for name in fix.options}
        settings = {
            name: axis.parse(fix.options[name]) if axis else fix.options[name]
            for name, axis in axes.items()
        }
        motions = examined.motions_of(examined.task, {**examined.values, **settings})
        if settings and not leaves_hand(motions[0], grip):
            yield fix.name, settings


def find_fall_through(examined: CheckedModel) -> Iterator[FileFault]:
    """Yield the fault of contacts that are switched off, so that a body falls out of the world."""
    fall = find_masked_fall(examined.motions[0])
    if fall is not None:
        yield FileFault(MASKED_FALL, fall.sentence)


def find_fallen_start(examined: CheckedModel) -> Iterator[FileFault]:
    """Yield the fault of a keyframe that a robot falls from, and stands in with one change."""
    scene, motion = examined.scene.with_effects("all"), examined.motions[0]
    for start in standing_starts(scene, examined.values, motion):
        yield FileFault("fallen-start", start.sentence, "start")
        return


def list_file_causes(faults: Sequence[FileFault]) -> Iterator[Cause]:
    """Yield the causes that a file has before any is repaired."""
    for fault in faults:
        if fault.is_certain:
            yield Cause(stage=fault.stage, sentence=fault.sentence)


def is_better(model: RepairedModel, repaired: RepairedModel, repair: Repair) -> bool:
    """Return whether a repair improves the verdict of a model.

    A start does if the word of its verdict is better; other repairs also if fewer of the complaints
    are left, and an edit of the file if none is. A known cause may leave a modeling choice to
    decide.
    """
    own, left = _rank_verdict(model.word), _rank_verdict(repaired.word)
    if repair.stage != "start" and repaired.complaints < model.complaints:
        return True
    if repair.stage == "file" and _removes_complaints(model, repaired):
        return True
    return left > own or (repair.is_certain and left >= min(own, _rank_verdict("depends")))


def _removes_complaints(model: RepairedModel, repaired: RepairedModel) -> bool:
    # Others of the repaired model were hidden: an object inside its jaws does not creep.
    return bool(model.complaints) and not model.complaints & repaired.complaints


def list_open_causes(model: RepairedModel) -> Iterator[Cause]:
    """Yield the causes that make a model fail whatever its runs say."""
    yield from list_file_causes(model.faults)
    for name in model.failed_checks:
        yield Cause(stage="file", sentence=f"check {name} fails")


def _rank_verdict(word: VerdictWord) -> int:
    return VERDICT_ORDER.index(word)


def add_lost_loop(model: RepairedModel, report: ControlLoopReport | None) -> RepairedModel:
    """Return a model with the loop of its policy among its causes, if that does not hold.

    Such a loop may end in an oscillation of full controls, which no label finds.
    """
    if report is None or report.holds:
        return model
    sentence = loop_sentence(report)
    if any(cause.sentence == sentence for cause in model.causes):
        return model
    lost = Cause(stage="numerics", sentence=sentence, fails=True)
    return replace(model, causes=(*model.causes, lost))
