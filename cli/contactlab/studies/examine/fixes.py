"""Finds fixes: changes that remove the cause of a verdict, as lines of the model's files."""

import copy
import math
import shutil
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import mkdtemp
from typing import Literal, NamedTuple

import mujoco

from contactlab.budget import (
    Motion,
    Trial,
    TriedFix,
    Verdict,
    error_budget,
    judge,
    try_fixes,
)
from contactlab.budget.counted_time import count_pace
from contactlab.budget.field_changes import field_changes
from contactlab.budget.fixes import (
    candidates_against,
    changed_model,
    has_drift,
    join_candidates,
    list_further_candidates,
    options_changed,
    raise_impedance,
    refine_candidate,
    without_margins,
)
from contactlab.budget.measuring import count_evaluations, steps_of
from contactlab.budget.readings import Origin
from contactlab.budget.report import fix_report
from contactlab.budget.verdict import VerdictWord, build_reason
from contactlab.budget.windows import joint_name
from contactlab.errors import SceneError
from contactlab.modifications.catalogue import (
    find_part_fix,
    find_softness_rows,
    is_numerical_label,
    list_candidates,
)
from contactlab.modifications.contacts import MARGIN
from contactlab.modifications.modification import ANY_LABEL, NO_EDITS, Candidate
from contactlab.modifications.numerics import CONVERGED_SOLVER, HALF_STEP, RUN
from contactlab.scene.model_draft import ModelEdits, join_edits
from contactlab.scene.model_edits import set_timestep
from contactlab.scene.model_writer import WrittenModel, write_model
from contactlab.scene.scene import Scene
from contactlab.schema.drive import PolicyDrive
from contactlab.schema.error_budget import BudgetReason
from contactlab.schema.examination import MOST_FIXES, Fix, RunLabel
from contactlab.studies.examine.facts import list_facts
from contactlab.studies.examine.primitive_fixes import list_primitives
from contactlab.studies.examine.start_fixes import separate_links
from contactlab.tasks.session import Values
from contactlab.tasks.task_motions import Change, as_it_is
from contactlab.temporary_folders import temporary_root

Removes = Literal["verdict", "labels", "overlap", "cause"]


def edits_of(fix: Fix, scene: Scene) -> ModelEdits:
    """Return the edits of a reported fix to a scene's model."""
    of_model = [name for name in fix.settings if not name.startswith("drive.")]
    axes = {name: scene.catalogue.find_axis(name) for name in of_model}
    return ModelEdits(
        {
            name: axis.parse(fix.settings[name]) if axis else fix.settings[name]
            for name, axis in axes.items()
        },
        excluded=fix.excluded_pairs,
        freed=fix.added_free_joints,
        fitted=fix.replaced_meshes,
        posed=fix.changed_keyframes,
        placed=fix.moved_bodies,
        masked=fix.masked_geoms,
        widened_masks=fix.opened_geoms,
        servos=fix.position_servos,
        steered=fix.changed_controls,
    )


MotionLister = Callable[[Values, Change, Path | None], Iterable[Sequence[Motion]]]
"""Returns motions with settings and a changed model, of the scene or of a file."""


class TaskRepeats(NamedTuple):
    """How a task is repeated, on its seeds and on new ones.

    Attributes:
        list_motions: returns its motions.
        labelled: yields the labels of its first run with settings, or of the file of a model with
            another start, then of all runs.
        labels: labels of the runs as written.
        finds_harm: returns whether the loads of a verification reject a fix.
    """

    list_motions: MotionLister
    labelled: Callable[[Values, Path | None], Iterable[Sequence[RunLabel]]] = lambda _, __: [()]
    labels: Sequence[RunLabel] = ()
    finds_harm: Callable[["FixSearch", Candidate, ModelEdits], bool] = lambda _, __, ___: False


class RepairedFiles(NamedTuple):
    """The files of a model with its first causes repaired.

    Attributes:
        scene: of the original files.
        edits: the repairs.
        apply: names of the repairs for `--apply`.
    """

    scene: Scene
    edits: ModelEdits
    apply: tuple[str, ...]

    def why_not_written(self, requested: Sequence[str]) -> str:
        """Return why the repairs are not written: a changed model is written by request only."""
        lacking = [word for word in self.apply if word not in requested]
        words = "".join(f" --apply {word}" for word in lacking)
        return f"the first fix changes the model; add{words}" if lacking else ""


class FixSearch:
    """Searches fixes of a model."""

    def __init__(
        self,
        scene: Scene,
        values: Values,
        motions: Sequence[Motion],
        verdict: Verdict,
        trial: Trial,
        repeats: TaskRepeats,
        repaired: RepairedFiles | None = None,
    ) -> None:
        """Try the candidates against a verdict until enough of them remove it.

        With `repaired` files, `scene` is of these. Fixes are written into the original files, with
        the repairs.
        """
        self._repaired = repaired
        self._folder = Path(mkdtemp(dir=temporary_root()))  # of models with other states
        weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        self._others = dict[str, Path]()
        self._written = dict[str, tuple[ModelEdits, WrittenModel | SceneError]]()
        self._scene, self._values = scene, values
        self._motions, self._verdict = motions, verdict
        self._repeats, self._limits = repeats, trial
        # Among fixes that change the model, those of the start are tried first: other faults may
        # follow from it.
        starts = [*filter(self._can_begin, separate_links(scene, values, motions, verdict))]
        shapes = [*filter(self._can_begin, list_primitives(scene, values, motions, verdict))]
        physical = [*starts, *shapes]
        against = candidates_against(motions, verdict)
        if isinstance(scene.drive.drive, PolicyDrive):
            against = [*filter(self._keeps_integrator, against)]
        self._candidates = (*starts, *against, *shapes)
        self.label_trials, self.not_tried, self._went_further = 0, list[str](), False
        self._dropped = set[str]()
        self.without_labels = list[TriedFix]()
        first_fixes = try_fixes(
            motions, verdict, candidates=self._candidates, trial=self._current_trial
        )
        ended = [fix for fix in first_fixes if fix.is_complete]
        self.not_tried += [fix.name for fix in first_fixes if not fix.is_complete]
        self.helping = self._by_labels([fix for fix in ended if fix.removes])
        self.tried = [*self.helping, *(fix for fix in ended if not fix.removes)]
        harmful = any(fix.harms for fix in ended)
        if not self.helping and not harmful:
            against = candidates_against_labels(motions, verdict, repeats.labels)
            self.without_labels = [*self._without_labels(against)]
        helping = (*self.helping, *self.without_labels)
        known_names = {fix.name for fix in helping} | {*self.not_tried}
        self._parting = [
            candidate
            for candidate in physical
            if candidate.edits.fixes_start
            and candidate.name not in known_names
            and self._parts_bodies(candidate)
        ]

    def _keeps_integrator(self, candidate: Candidate) -> bool:
        # RK4 is more accurate for replayed controls; in the loop of a policy it holds no more.
        model = self._motions[0].model
        changed = changed_model(model, candidate)
        return changed.opt.integrator in (
            model.opt.integrator,
            mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
        )

    @property
    def _current_trial(self) -> Trial:
        """How candidates are tried; made on demand, since it refers to this object."""
        harms = partial(self._repeats.finds_harm, self)
        return replace(self._limits, list_motions=self._motions_of, finds_harm=harms)

    def _by_labels(self, helping: Sequence[TriedFix]) -> list[TriedFix]:
        """Return the fixes, led by one that leaves no label, if there is one.

        If all leave labels, it is the first one at a finer step, or joined with a fix of labels.
        Without that, a modeling choice has no fix: the labels are the failure.
        """
        if helping and (not self._repeats.labels or helping[0].edits.fixes_start):
            return [*helping]
        base, base_labels = None, self._repeats.labels
        for fix in helping:
            candidate = self._find_candidate(fix.name)
            if (labels := self._labels_with(fix, candidate.rate)) is None:
                continue
            if not labels:
                return [fix, *(other for other in helping if other is not fix)]
            if base is None:
                base, base_labels = candidate, labels
        further_fixes = self._try_further(base, base_labels) if base or not helping else []
        return [*further_fixes, *(helping if self._verdict.word != "depends" else ())]

    def _try_further(
        self, base: Candidate | None, labels: Sequence[RunLabel]
    ) -> Sequence[TriedFix]:
        # The first that removes the verdict and leaves no label.
        self._went_further |= base is None
        for candidate in self._list_further(base, labels):
            trial = replace(self._current_trial, most=None)
            tried_fixes = try_fixes(
                self._motions, self._verdict, candidates=[candidate], trial=trial
            )
            self.not_tried += [one.name for one in tried_fixes if not one.is_complete]
            if any(
                self._labels_with(one, candidate.rate) == () for one in tried_fixes if one.removes
            ):
                self._candidates = (*self._candidates, candidate)
                return tried_fixes
        return []

    def search_further(self) -> bool:
        """Return whether a fix beyond the usual ones helps, after these were dropped."""
        # A fix that includes a dropped one was left out for it, and may do no harm.
        wider = [one for one in self._candidates if self._dropped.intersection(one.includes)]
        self._dropped.clear()
        tried_names = {fix.name for fix in self.tried}
        if wider := [one for one in wider if one.name not in tried_names]:
            trial = self._current_trial
            wider_fixes = try_fixes(self._motions, self._verdict, candidates=wider, trial=trial)
            self.not_tried += [fix.name for fix in wider_fixes if not fix.is_complete]
            self.helping = [fix for fix in wider_fixes if fix.removes]
            self.tried = [*self.tried, *(fix for fix in wider_fixes if fix.is_complete)]
            if self.helping:
                return True
        if self._went_further:
            return False
        self.helping = [*self._try_further(None, self._repeats.labels)]
        self.tried = [*self.helping, *self.tried]
        return bool(self.helping)

    def _labels_with(self, fix: TriedFix, rate: int) -> Sequence[RunLabel] | None:
        """Return the labels of both groups of seeds with a fix.

        None if the fix is not one of settings, or if there is no time for the runs, each with a
        second one of half its step.
        """
        runs = 3  # a run, and one with half its step, which has twice the steps
        steps = 2 * runs * rate * steps_of(self._motions)
        if (
            fix.edits.fitted
            or steps * count_pace(self._motions) > self._current_trial.find_time_left()
        ):
            return None
        *_, labels = self._repeats.labelled({**self._values, **fix.edits.settings}, None)
        return tuple(labels)

    def _find_candidate(self, name: str) -> Candidate:
        return next(candidate for candidate in self._candidates if candidate.name == name)

    def _list_further(
        self, base: Candidate | None, labels: Sequence[RunLabel]
    ) -> Iterator[Candidate]:
        """Yield candidates that go further than a fix that leaves labels, or than none."""
        verdict, word = self._verdict, self._verdict.word
        if base is None and word != "inaccurate":
            return
        verdict_word: VerdictWord = "depends" if word == "depends" else "inaccurate"
        physical = [
            replace(candidate, word=verdict_word)
            for candidate in candidates_against_labels(self._motions, verdict, labels)
            if candidate.changes_model
        ]
        if base is None:
            yield from list_further_candidates()
            for times in (2, 8):
                yield from (
                    join_candidates([refine_candidate(HALF_STEP, times), one]) for one in physical
                )
            return
        kinds = {label.label for label in labels}
        if kinds & {*CONVERGED_SOLVER.labels} and base is not CONVERGED_SOLVER:
            yield join_candidates([base, CONVERGED_SOLVER])
        if any(map(is_numerical_label, kinds)):
            finest = 64  # most steps per step of the run that are tried
            yield from (
                refine_candidate(base, times) for times in (2, 4) if base.rate * times <= finest
            )
        for candidate in physical:
            if candidate.apply == MARGIN:
                yield candidate
            yield join_candidates([base, candidate])

    def _without_labels(self, candidates: Sequence[Candidate]) -> Iterator[TriedFix]:
        """Yield the first fix of each kind (same model, other model) that leaves no label."""
        if self._verdict.word not in ("ok", "depends") or not self._repeats.labels:
            return
        kinds = set[bool]()
        for candidate in candidates:
            if candidate.changes_model in kinds:
                continue
            if not self._can_afford(candidate.rate):
                self.not_tried.append(candidate.name)
                continue
            model = self._motions[0].model
            options = options_changed(model, changed_model(model, candidate))
            edits = replace(candidate.edits, settings={**options, **candidate.edits.settings})
            self.label_trials += 1
            file = None if candidate.same_states else self._write_other(candidate)
            if any(self._repeats.labelled({**self._values, **edits.settings}, file)):
                continue
            if all(self._is_no_worse(motions) for motions in self._motions_of(candidate)):
                kinds.add(candidate.changes_model)
                yield _make_untimed(candidate, self._verdict.word, edits, removes=True)

    def _motions_of(self, candidate: Candidate) -> Iterable[Sequence[Motion]]:
        """Return the motions of a changed model under the task."""
        model = self._motions[0].model
        options = options_changed(model, changed_model(model, candidate))
        if not candidate.same_states:
            return self._repeats.list_motions(
                {**self._values, **options}, as_it_is, self._write_other(candidate)
            )

        def change(own: mujoco.MjModel) -> mujoco.MjModel:
            changed = copy.copy(candidate.compiled or own)
            candidate.change(changed)
            set_timestep(changed, own.opt.timestep)
            return changed

        return self._repeats.list_motions({**self._values, **options}, change, None)

    def _can_begin(self, candidate: Candidate) -> bool:
        """Return whether the changed model has states to begin in."""
        try:
            return candidate.same_states or self._write_other(candidate).is_file()
        except SceneError:
            return False

    def _write_other(self, candidate: Candidate) -> Path:
        """Return the file of a changed model with other states; it is written once."""
        if candidate.name not in self._others:
            folder = self._folder / str(len(self._others))
            self._others[candidate.name] = self.write_edits(candidate.edits, folder).path
        return self._others[candidate.name]

    def reported_fixes(self) -> tuple[Fix, ...]:
        """Return at most three fixes, all requested ones, and those that separate bodies."""
        of_verdict = [
            fix
            for place, fix in enumerate(self.helping)
            if place < MOST_FIXES or fix.apply in self._current_trial.requested
        ]
        parting = [
            _make_untimed(candidate, self._verdict.word, candidate.edits, removes=False)
            for candidate in self._parting
        ]
        fixes_by_effect: dict[Removes, Sequence[TriedFix]] = {
            "verdict": of_verdict,
            "labels": self.without_labels,
            "overlap": parting,
        }
        return tuple(
            self._report_fix(one, what) for what, some in fixes_by_effect.items() for one in some
        )

    def find_edits(self, name: str) -> ModelEdits:
        """Return the edits of a reported fix, with those of the repairs before it."""
        all_fixes = (*self.helping, *self.without_labels)
        edits_by_name = {fix.name: fix.edits for fix in all_fixes}
        edits_by_name |= {candidate.name: candidate.edits for candidate in self._parting}
        return self.whole_edits(edits_by_name[name])

    def changes_model(self, name: str) -> bool:
        """Return whether a fix makes another model; several fixes together do."""
        all_fixes = (*self.helping, *self.without_labels)
        return next((fix.changes_model for fix in all_fixes if fix.name == name), True)

    def drop_fix(self, name: str) -> None:
        """Report a fix no longer, and do not write it."""
        self._dropped.add(name)
        self.helping = [fix for fix in self.helping if fix.name != name]
        self.without_labels = [fix for fix in self.without_labels if fix.name != name]
        self._parting = [candidate for candidate in self._parting if candidate.name != name]

    def _parts_bodies(self, candidate: Candidate) -> bool:
        """Return whether a fix leaves no overlap, no extreme force and no worse verdict."""
        absurd = _start_faults(self._motions)
        if not absurd:
            return False
        if not self._can_afford(candidate.rate):
            self.not_tried.append(candidate.name)
            return False
        return all(
            not absurd & _start_faults(motions) and self._is_no_worse(motions)
            for motions in self._motions_of(candidate)
        )

    def _can_afford(self, rate: int) -> bool:
        """Return whether there is time for a budget with `rate` steps per step of the run.

        It is measured on both groups of seeds.
        """
        model, steps = self._motions[0].model, 2 * rate * steps_of(self._motions)
        looks = count_evaluations(
            model, self._current_trial.settings, drifts=has_drift(self._verdict)
        )
        return looks * steps * count_pace(self._motions) <= self._current_trial.find_time_left()

    def _is_no_worse(self, motions: Sequence[Motion]) -> bool:
        settings = replace(self._current_trial.settings, places=False, measures_time=False)
        budget = error_budget(
            motions, rows=(), settings=settings, workers=self._current_trial.workers
        )
        word = judge(budget, self._verdict.tolerance).word
        return word == "ok" or self._verdict.word in ("inaccurate", "undecided")

    def _report_fix(self, fix: TriedFix, removes: Removes) -> Fix:
        lines, no_patch_reason = tuple[str, ...](), ""
        try:
            lines = self.write_once(fix.name, fix.edits).lines
        except SceneError as error:
            no_patch_reason = str(error).splitlines()[0]
        budget_fix, edits = fix_report(fix), self.whole_edits(fix.edits)
        return Fix(
            name=budget_fix.name,
            changes_model=budget_fix.changes_model,
            apply=fix.apply,
            removes=removes,
            settings=budget_fix.settings,
            excluded_pairs=edits.excluded,
            added_free_joints=edits.freed,
            replaced_meshes=edits.fitted,
            changed_keyframes=edits.posed,
            moved_bodies=edits.placed,
            masked_geoms=edits.masked,
            opened_geoms=edits.widened_masks,
            position_servos=edits.servos,
            changed_controls=edits.steered,
            error=budget_fix.error,
            distance_to_reference=budget_fix.distance_to_reference,
            distance_before=budget_fix.distance_before,
            time_ratio=budget_fix.time_ratio,
            lines=lines,
            no_patch_reason=no_patch_reason,
        )

    def write_once(self, name: str, edits: ModelEdits) -> WrittenModel:
        """Return the written model with a fix, which is kept as long as this search.

        Raises:
            SceneError: it cannot be written.
        """
        known_edits, result = self._written.get(name, (None, None))
        if result is None or known_edits != edits:
            try:
                folder = Path(mkdtemp(dir=self._folder)) / "changed"
                result = self.write_edits(edits, folder)
            except SceneError as error:
                result = error
            self._written[name] = edits, result
        if isinstance(result, SceneError):
            raise result
        return result

    def write_edits(self, edits: ModelEdits, folder: Path, name: str = "") -> WrittenModel:
        """Write the model with edits, and with the settings of the examination."""
        whole = self.whole_edits(edits)
        own = {key: value for key, value in self._values.items() if key not in whole.settings}
        scene = self._repaired.scene if self._repaired else self._scene
        whole_edits = replace(whole, settings={**own, **whole.settings})
        return write_model(scene, whole_edits, folder, name)

    def whole_edits(self, edits: ModelEdits) -> ModelEdits:
        """Return the edits of a fix with those of the repairs before it."""
        return join_edits([self._repaired.edits, edits]) if self._repaired else edits

    def choose_edits(self) -> tuple[str, ModelEdits, str]:
        """Return the name and edits of the fix to write, or why there is none.

        It is the first that keeps the model, or the requested ones, judged together.
        """
        helping = [*self.helping, *self.without_labels]
        numerical = [fix for fix in helping if not fix.changes_model]
        requested = {*self._current_trial.requested}
        if self._repaired is not None:
            requested -= {*self._repaired.apply}
            reason = self._repaired.why_not_written(self._current_trial.requested)
            if reason or not (requested or helping):
                return " and ".join(self._repaired.apply), self.whole_edits(NO_EDITS), reason
        chosen = [fix for fix in self.without_labels if requested == {fix.apply}]
        if not requested:
            chosen = numerical
        if chosen:
            return chosen[0].name, chosen[0].edits, ""
        reason = self._unknown_request() if requested else self._why_none(helping)
        if reason:
            return "", NO_EDITS, reason
        by_word = {candidate.apply: candidate for candidate in self._candidates}
        accepted = [
            by_word[word]
            for word in dict.fromkeys(self._current_trial.requested)
            if word in requested
        ]
        others = [one for one in self._candidates if one.name in {two.name for two in numerical}]
        trial = replace(self._current_trial, most=None, find_time_left=lambda: math.inf)
        for candidates in (accepted, *([*accepted, other] for other in others)):
            whole = join_candidates(candidates)
            tried_fixes = try_fixes(self._motions, self._verdict, candidates=[whole], trial=trial)
            if tried_fixes and tried_fixes[0].removes:
                return tried_fixes[0].name, tried_fixes[0].edits, ""
        if self._parts_bodies(whole := join_candidates(accepted)):
            return whole.name, whole.edits, ""
        return "", NO_EDITS, "the applied fixes do not remove the cause of the verdict"

    def _unknown_request(self) -> str:
        words = [candidate.apply for candidate in self._candidates if candidate.apply]
        words += self._repaired.apply if self._repaired else ()
        unknown = [word for word in self._current_trial.requested if word not in words]
        known_words = ", ".join(words) or "none"
        return f"no fix is called {unknown[0]}; write one of: {known_words}" if unknown else ""

    def _why_none(self, helping: Sequence[TriedFix]) -> str:
        """Return why no fix is written that keeps the model."""
        more = ", ".join(fix.apply for fix in helping)
        hint = f"; a fix that changes the model is written with --apply {more}" if more else ""
        if self._verdict.word == "ok" and not self._repeats.labels:
            return f"no fix is needed{hint}"
        return f"no fix that keeps the model removes the cause of the verdict{hint}"


def candidates_against_labels(
    motions: Sequence[Motion], verdict: Verdict, labels: Sequence[RunLabel]
) -> tuple[Candidate, ...]:
    """Return candidates that may remove labels, in the order of their trials.

    First a solver with more iterations, and elliptic cones if forces differ and friction has
    pyramids, since they cost little time; then finer steps. Then candidates that make another
    model: no contact margins; stiffer contacts, limits and equalities of the parts that labels
    name, and of all; servos that the step can hold.
    """
    if not labels:
        return ()
    model, word, kinds = motions[0].model, verdict.word, {label.label for label in labels}
    computed = [
        candidate
        for candidate in list_candidates()
        if kinds & {*candidate.labels} or ANY_LABEL in candidate.labels
        if all(candidate.label_applies(motion.model) for motion in motions)
    ]
    soft = tuple(_list_softness_reasons(model, verdict, labels))
    stiffer = field_changes(motions, Verdict("depends", verdict.tolerance, soft)) if soft else ()
    driven = tuple(_of_joints(model, labels))
    slower = (
        field_changes(motions, Verdict("inaccurate", verdict.tolerance, driven)) if driven else ()
    )
    margins = without_margins(model) if kinds & {*find_part_fix(MARGIN).labels} else ()
    physical = (*margins, *stiffer, *raise_impedance(model, stiffer), *slower)
    return (
        *(replace(candidate, word=word) for candidate in computed),
        *(
            replace(each, word=word, rows=(), exercised="", must_come_nearer=False)
            for each in physical
        ),
    )


def _list_softness_reasons(
    model: mujoco.MjModel, verdict: Verdict, labels: Sequence[RunLabel]
) -> Iterator[BudgetReason]:
    """Yield a reason for each modeling choice that a label of softness concerns, and its places."""
    shares = {reason.row: reason.error for reason in reversed(verdict.reasons)}
    for label in labels:
        for row in find_softness_rows(label.label):
            for place in _places_of(model, label, row) or [""]:
                yield _build_reason("depends", label, row, shares.get(row, math.inf), place)


def _places_of(model: mujoco.MjModel, label: RunLabel, row: str) -> list[str]:
    """Return the contact, or the joints with limits, that a label of softness concerns."""
    if row == "contact softness":
        bodies = ("world", *label.bodies)[-2:] if label.bodies else ()
        return [f"contact {' - '.join(bodies)}"] if bodies else []
    limited = [joint for joint in _joints_of(model, label) if model.jnt_limited[joint]]
    return [joint_name(model, joint) for joint in limited if row == "limit softness"]


def _of_joints(model: mujoco.MjModel, labels: Sequence[RunLabel]) -> Iterator[BudgetReason]:
    """Yield a reason for each joint of a body that numerical labels name."""
    for label in labels:
        if not is_numerical_label(label.label):
            continue
        for joint in _joints_of(model, label):
            yield _build_reason("inaccurate", label, RUN.name, math.inf, joint_name(model, joint))


def _joints_of(model: mujoco.MjModel, label: RunLabel) -> Iterator[int]:
    """Yield the joints of the bodies that a label names."""
    for body in label.bodies:
        first, count = int(model.body(body).jntadr[0]), int(model.body(body).jntnum[0])
        yield from range(first, first + count)


def _build_reason(
    word: VerdictWord, label: RunLabel, row: str, share: float, place: str
) -> BudgetReason:
    where = Origin(next(iter(label.bodies), ""), place, label.time or 0.0)
    return build_reason(word, label.phase, row, share, where, label.reason)


def _make_untimed(
    candidate: Candidate, word: VerdictWord, edits: ModelEdits, *, removes: bool
) -> TriedFix:
    """Return a fix without a measured error."""
    return TriedFix(
        candidate.name,
        removes=removes,
        word=word,
        error=math.nan,
        time_ratio=None,
        edits=edits,
        apply=candidate.apply,
        distance=math.nan,
        distance_before=math.nan,
    )


def _start_faults(motions: Sequence[Motion]) -> set[str]:
    """Return the kinds of facts about overlaps at the start and extreme forces."""
    fact_kinds = {fact.kind for fact in list_facts(motions, [0.0] * len(motions))}
    return {kind for kind in fact_kinds if kind in ("overlap", "force")}
