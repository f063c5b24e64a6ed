"""Changes that pay: those that remove what a verdict names, as lines of the model's files."""

import copy
import math
import shutil
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Literal, NamedTuple

import mujoco

from contactlab.budget import Motion, Remedy, Trial, Verdict, error_budget, judge, remedies
from contactlab.budget.measuring import evaluations, pace, steps_of
from contactlab.budget.physical import field_changes
from contactlab.budget.remedies import (
    CANDIDATES,
    MARGIN,
    NO_EDITS,
    RUNGE_KUTTA,
    Candidate,
    candidates_against,
    changed_model,
    drifts,
    finer,
    further,
    harder,
    joined,
    of_fields,
    options_changed,
    without_margins,
)
from contactlab.budget.report import remedy_report
from contactlab.budget.verdict import Reason, Word
from contactlab.budget.windows import joint_name
from contactlab.errors import SceneError
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import WrittenModel, write_model
from contactlab.scene.scene import Scene
from contactlab.schema.examination import MOST_CHANGES, ModelChange, RunLabel
from contactlab.schema.task import Task
from contactlab.studies.examine.facts import facts
from contactlab.studies.examine.primitives import primitives
from contactlab.studies.examine.separated import separated
from contactlab.studies.examine.task_motions import Change, as_it_is
from contactlab.studies.session import Values

Removes = Literal["verdict", "labels", "overlap"]
_OF_MARGINS = ("contact_at_distance",)
_RUNS = 3  # a run, and one of half its step beside it
_FINEST = 64  # most steps in one of the run's that are tried
_HALF = "half the step"
_FINER_STEPS = (_HALF, "a quarter of the step", "an eighth of the step")
_OF_SOLVERS = ("solver_nonconvergence", "solver_inconsistent")
(_SOLVED,) = (one for one in CANDIDATES if one.name == "Newton with 100 iterations")
_OF_SLEEP = ("asleep_unsupported",)
(_AWAKE,) = (one for one in CANDIDATES if one.name == "no sleep")
_PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
_STIFF_FRICTION = "elliptic cones with impratio 10"
_OF_ENERGY = ("energy_injection", "energy_loss")
SOFT_ROWS = {
    "deep_penetration": ("contact softness",),
    "tunneling": ("contact softness",),
    "broken": ("contact softness",),
    "constraint_violated": ("limit softness", "equality softness"),
}
"""Labels of what is too soft, and the rows of the budget that its changes are of."""


def fresh(task: Task) -> Task:
    """Return a task whose seeds no change was chosen by."""
    count = max(task.seeds) + 1
    return task.model_copy(update={"seeds": tuple(seed + count for seed in task.seeds)})


def edits_of(change: ModelChange, scene: Scene) -> ModelEdits:
    """Return how a change that a report tells of is written into a scene's model."""
    axes = {name: scene.catalogue.find(name) for name in change.settings}
    return ModelEdits(
        {
            name: axis.parse(change.settings[name]) if axis else change.settings[name]
            for name, axis in axes.items()
        },
        excluded=change.excluded,
        freed=change.freed,
        fitted=change.fitted,
        posed=change.posed,
    )


Moved = Callable[[Values, Change, Path | None], Iterable[Sequence[Motion]]]
"""Returns motions with settings and a changed model, of the scene or of a file in its place."""


class Again(NamedTuple):
    """How a task is done again, on its seeds and on fresh ones.

    Attributes:
        moved: returns its motions.
        labelled: yields the labels of its first run with settings, then of all of them.
        labels: those of its runs as they are.
    """

    moved: Moved
    labelled: Callable[[Values], Iterable[Sequence[RunLabel]]] = lambda _: [()]
    labels: Sequence[RunLabel] = ()


class Changes:
    """What may mend a model, and what was found to."""

    def __init__(
        self,
        scene: Scene,
        values: Values,
        motions: Sequence[Motion],
        verdict: Verdict,
        trial: Trial,
        again: Again,
    ) -> None:
        """Try all that a verdict points to, until enough of it removes the verdict."""
        self._folder = Path(mkdtemp(prefix="contactlab-"))  # of models with other states
        weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        self._others = dict[str, Path]()
        self._scene, self._values = scene, values
        self._motions, self._verdict = motions, verdict
        self._again, self._limits = again, trial
        others = (
            *separated(scene, values, motions, verdict),
            *primitives(scene, values, motions, verdict),
        )
        physical = [*filter(self._can_begin, others)]
        self._candidates = (*candidates_against(motions, verdict), *physical)
        found = remedies(motions, verdict, candidates=self._candidates, trial=self._trial)
        ended = [remedy for remedy in found if remedy.ended]
        self.untried = [remedy.name for remedy in found if not remedy.ended]
        self.helping = self._by_labels([remedy for remedy in ended if remedy.removes])
        self.tried = [*self.helping, *(remedy for remedy in ended if not remedy.removes)]
        self.unlabelling = [] if self.helping else [*self._unlabelling()]
        known = {remedy.name for remedy in self.helping} | {*self.untried}
        self._parting = [
            candidate
            for candidate in physical
            if candidate.edits.parts and candidate.name not in known and self._parts(candidate)
        ]

    @property
    def _trial(self) -> Trial:
        """How changes are tried: made when asked for, since it refers to this object."""
        return replace(self._limits, moved=self._motions_of)

    def _by_labels(self, helping: Sequence[Remedy]) -> list[Remedy]:
        """Return what helps, led by a change that leaves no label either, if there is one.

        Where all leave some, it is the first at a finer step, or with what its labels call for.
        """
        if helping and (not self._again.labels or helping[0].edits.mends_start):
            return [*helping]
        base, left = None, self._again.labels
        for remedy in helping:
            candidate = self._named(remedy.name)
            if (labels := self._labels_with(remedy, candidate.rate)) is None:
                continue
            if not labels:
                return [remedy, *(other for other in helping if other is not remedy)]
            if base is None:
                base, left = candidate, labels
        for candidate in self._further(base, left) if base or not helping else ():
            trial = replace(self._trial, most=None)
            tried = remedies(self._motions, self._verdict, candidates=[candidate], trial=trial)
            if any(self._labels_with(one, candidate.rate) == () for one in tried if one.removes):
                self._candidates = (*self._candidates, candidate)
                return [*tried, *helping]
        return [*helping]

    def _labels_with(self, remedy: Remedy, rate: int) -> Sequence[RunLabel] | None:
        """Return the labels of both groups of seeds with a change.

        None where settings do not make it, or where there is no time for the runs, each beside one
        of half its step.
        """
        steps = 2 * _RUNS * rate * steps_of(self._motions)
        if remedy.edits.fitted or steps * pace(self._motions) > self._trial.left():
            return None
        *_, labels = self._again.labelled({**self._values, **remedy.edits.settings})
        return tuple(labels)

    def _named(self, name: str) -> Candidate:
        return next(candidate for candidate in self._candidates if candidate.name == name)

    def _further(self, base: Candidate | None, labels: Sequence[RunLabel]) -> Iterator[Candidate]:
        """Yield changes that go further than one that leaves labels, or than none."""
        verdict, word = self._verdict, self._verdict.word
        if base is None and word != "unresolved":
            return
        wanted: Word = "model" if word == "model" else "unresolved"
        physical = [
            replace(candidate, word=wanted)
            for candidate in candidates_against_labels(self._motions, verdict, labels)
            if candidate.physics
        ]
        if base is None:
            (half,) = (one for one in CANDIDATES if one.name == _HALF)
            yield from further(half)
            yield from (joined([finer(half, times), one]) for times in (2, 8) for one in physical)
            return
        kinds = {label.label for label in labels}
        if kinds & {*_OF_SOLVERS} and base is not _SOLVED:
            yield joined([base, _SOLVED])
        if not kinds <= {*SOFT_ROWS, *_OF_MARGINS}:
            yield from (finer(base, times) for times in (2, 4) if base.rate * times <= _FINEST)
        for candidate in physical:
            if candidate.accept == MARGIN:
                yield candidate
            yield joined([base, candidate])

    def _unlabelling(self) -> Iterator[Remedy]:
        """Yield the first changes of computation and of physics by which no run has a label."""
        if self._verdict.word not in ("sound", "model"):
            return
        kinds = set[bool]()
        candidates = candidates_against_labels(self._motions, self._verdict, self._again.labels)
        for candidate in candidates:
            if candidate.physics in kinds:
                continue
            if not self._affords(candidate.rate):
                self.untried.append(candidate.name)
                continue
            model = self._motions[0].model
            options = options_changed(model, changed_model(model, candidate))
            edits = replace(candidate.edits, settings={**options, **candidate.edits.settings})
            if any(self._again.labelled({**self._values, **edits.settings})):
                continue
            if all(self._is_no_worse(motions) for motions in self._motions_of(candidate)):
                kinds.add(candidate.physics)
                yield _untimed(candidate, self._verdict.word, edits, removes=True)

    def _motions_of(self, candidate: Candidate) -> Iterable[Sequence[Motion]]:
        """Return the task's motions of a changed model, which begin as the task does."""
        model = self._motions[0].model
        options = options_changed(model, changed_model(model, candidate))
        if not candidate.same_states:
            return self._again.moved({**self._values, **options}, as_it_is, self._other(candidate))

        def change(own: mujoco.MjModel) -> mujoco.MjModel:
            made = copy.copy(candidate.compiled or own)
            candidate.change(made)
            made.opt.timestep = own.opt.timestep
            return made

        return self._again.moved({**self._values, **options}, change, None)

    def _can_begin(self, candidate: Candidate) -> bool:
        """Return whether the changed model has states to begin in: its own need its file."""
        try:
            return candidate.same_states or self._other(candidate).is_file()
        except SceneError:
            return False

    def _other(self, candidate: Candidate) -> Path:
        """Return the file of a changed model whose states are others; it is written once."""
        if candidate.name not in self._others:
            folder = self._folder / str(len(self._others))
            self._others[candidate.name] = self._written(candidate.edits, folder, "").path
        return self._others[candidate.name]

    def told(self) -> tuple[ModelChange, ...]:
        """Return those that are told: at most three, all that are wanted, and what parts links."""
        shown = [
            remedy
            for place, remedy in enumerate(self.helping)
            if place < MOST_CHANGES or remedy.accept in self._trial.wanted
        ]
        parting = [
            _untimed(candidate, self._verdict.word, candidate.edits, removes=False)
            for candidate in self._parting
        ]
        found: dict[Removes, Sequence[Remedy]] = {
            "verdict": shown,
            "labels": self.unlabelling,
            "overlap": parting,
        }
        return tuple(self._change(one, what) for what, some in found.items() for one in some)

    def _parts(self, candidate: Candidate) -> bool:
        """Return whether a change leaves no overlap and no absurd force, and no worse verdict."""
        absurd = _absurd(self._motions)
        if not absurd:
            return False
        if not self._affords(candidate.rate):
            self.untried.append(candidate.name)
            return False
        return all(
            not absurd & _absurd(motions) and self._is_no_worse(motions)
            for motions in self._motions_of(candidate)
        )

    def _affords(self, rate: int) -> bool:
        """Return whether there is time for a budget with so many steps in one of the run's.

        It is measured on both groups of seeds.
        """
        model, steps = self._motions[0].model, 2 * rate * steps_of(self._motions)
        looks = evaluations(model, self._trial.settings, drifts=drifts(self._verdict))
        return looks * steps * pace(self._motions) <= self._trial.left()

    def _is_no_worse(self, motions: Sequence[Motion]) -> bool:
        settings = replace(self._trial.settings, places=False, priced=False)
        budget = error_budget(motions, rows=(), settings=settings, workers=self._trial.workers)
        word = judge(budget, self._verdict.within).word
        return word == "sound" or self._verdict.word in ("unresolved", "not resolved")

    def _change(self, remedy: Remedy, removes: Removes) -> ModelChange:
        lines, unwritten = tuple[str, ...](), ""
        with TemporaryDirectory(prefix="contactlab-") as folder:
            try:
                lines = self._written(remedy.edits, Path(folder) / "changed", "").lines
            except SceneError as error:
                unwritten = str(error).splitlines()[0]
        tried = remedy_report(remedy)
        return ModelChange(
            name=tried.name,
            physics=tried.physics,
            accept=remedy.accept,
            removes=removes,
            settings=tried.settings,
            excluded=remedy.edits.excluded,
            freed=remedy.edits.freed,
            fitted=remedy.edits.fitted,
            posed=remedy.edits.posed,
            share=tried.share,
            apart=tried.apart,
            before=tried.before,
            price=tried.price,
            lines=lines,
            unwritten=unwritten,
        )

    def _written(self, edits: ModelEdits, folder: Path, name: str) -> WrittenModel:
        own = {key: value for key, value in self._values.items() if key not in edits.settings}
        whole = replace(edits, settings={**own, **edits.settings})
        return write_model(self._scene, whole, folder, name)

    def write(self, file: Path) -> tuple[Path | None, str]:
        """Write the model with what is accepted, or else the first change of computation.

        Several are judged together first.

        Returns:
            where the model is, which may be in a folder beside others that it includes; None if it
            was not written.
            why not, or "".

        Raises:
            OutputError: the file cannot be written.
        """
        edits, reason = self._to_write()
        if reason:
            return None, reason
        try:
            return self._written(edits, file.parent, file.name).path, ""
        except SceneError as error:
            return None, str(error).splitlines()[0]

    def _to_write(self) -> tuple[ModelEdits, str]:
        """Return what is written, or why nothing is."""
        helping = [*self.helping, *self.unlabelling]
        numerical = [remedy for remedy in helping if not remedy.physics]
        wanted = {*self._trial.wanted}
        for remedy in self.unlabelling:
            if wanted == {remedy.accept}:
                return remedy.edits, ""
        if not self._trial.wanted:
            return (numerical[0].edits, "") if numerical else (NO_EDITS, self._why_none(helping))
        by_word = {candidate.accept: candidate for candidate in self._candidates}
        unknown = [word for word in self._trial.wanted if word not in by_word]
        if unknown:
            known = ", ".join(word for word in by_word if word) or "none"
            return NO_EDITS, f"no change is called {unknown[0]} here; those tried: {known}"
        accepted = [by_word[word] for word in dict.fromkeys(self._trial.wanted)]
        others = [one for one in self._candidates if one.name in {two.name for two in numerical}]
        trial = replace(self._trial, most=None, left=lambda: math.inf)
        for candidates in (accepted, *([*accepted, other] for other in others)):
            whole = joined(candidates)
            tried = remedies(self._motions, self._verdict, candidates=[whole], trial=trial)
            if tried and tried[0].removes:
                return tried[0].edits, ""
        if self._parts(whole := joined(accepted)):
            return whole.edits, ""
        return NO_EDITS, "what is accepted does not remove what the verdict names"

    def _why_none(self, helping: Sequence[Remedy]) -> str:
        """Return why no change of computation is written."""
        more = ", ".join(remedy.accept for remedy in helping)
        hint = f"; accept another model by --accept {more}" if more else ""
        if self._verdict.word == "sound" and not self._again.labels:
            return f"the model is sound as it is{hint}"
        return f"no change of how the model is computed removes what the verdict names{hint}"


def candidates_against_labels(
    motions: Sequence[Motion], verdict: Verdict, labels: Sequence[RunLabel]
) -> tuple[Candidate, ...]:
    """Return changes that may keep labels from runs, which are tried in their order.

    A solver that goes on where it was not done, and elliptic cones where forces differ and friction
    has pyramids, which cost little time, then finer steps. Then those that make another model:
    contacts that bear at no distance; stiffer contacts, limits and equalities of what labels name,
    and of all; servos that the step holds.
    """
    if not labels:
        return ()
    model, word, kinds = motions[0].model, verdict.word, {label.label for label in labels}
    computed = [candidate for candidate in CANDIDATES if candidate.name in _FINER_STEPS]
    pyramids = all(motion.model.opt.cone == _PYRAMIDAL for motion in motions)
    if pyramids and "step_dependent" in kinds:
        (elliptic,) = (one for one in CANDIDATES if one.name == _STIFF_FRICTION)
        computed.insert(0, elliptic)
    if kinds & {*_OF_SOLVERS}:
        computed.insert(0, _SOLVED)
    if kinds & {*_OF_SLEEP}:
        computed.insert(0, _AWAKE)
    if kinds & {*_OF_ENERGY} and all(RUNGE_KUTTA.new(motion.model) for motion in motions):
        computed.append(RUNGE_KUTTA)
    soft = tuple(_softness(model, verdict, labels))
    stiffer = field_changes(motions, Verdict("model", verdict.within, soft)) if soft else ()
    stiffer = (*stiffer, *harder(model, stiffer))
    driven = tuple(_of_joints(model, labels))
    slower = field_changes(motions, Verdict("unresolved", verdict.within, driven)) if driven else ()
    margins = without_margins(model) if kinds & {*_OF_MARGINS, *_OF_ENERGY} else ()
    return (
        *(replace(candidate, word=word) for candidate in computed),
        *(of_fields(change, word, nearer=False) for change in (*margins, *stiffer, *slower)),
    )


def _softness(
    model: mujoco.MjModel, verdict: Verdict, labels: Sequence[RunLabel]
) -> Iterator[Reason]:
    """Yield a reason for each row of the model that a label of softness is of, and its places."""
    shares = {reason.row: reason.share for reason in reversed(verdict.reasons)}
    for label in labels:
        for row in SOFT_ROWS.get(label.label, ()):
            for place in _places_of(model, label, row) or [""]:
                yield _reason("model", label, row, shares.get(row, math.inf), place)


def _places_of(model: mujoco.MjModel, label: RunLabel, row: str) -> list[str]:
    """Return the contact, or the joints with limits, that a label of softness is of, if known."""
    if row == "contact softness":
        bodies = ("world", *label.bodies)[-2:] if label.bodies else ()
        return [f"contact {' - '.join(bodies)}"] if bodies else []
    limited = [joint for joint in _joints_of(model, label) if model.jnt_limited[joint]]
    return [joint_name(model, joint) for joint in limited if row == "limit softness"]


def _of_joints(model: mujoco.MjModel, labels: Sequence[RunLabel]) -> Iterator[Reason]:
    """Yield a reason for each joint of a body that labels of numerics name."""
    for label in labels:
        if label.label in SOFT_ROWS or label.label in _OF_MARGINS:
            continue
        for joint in _joints_of(model, label):
            yield _reason("unresolved", label, "run", math.inf, joint_name(model, joint))


def _joints_of(model: mujoco.MjModel, label: RunLabel) -> Iterator[int]:
    """Yield the joints of the bodies that a label names."""
    for body in label.bodies:
        first, count = int(model.body(body).jntadr[0]), int(model.body(body).jntnum[0])
        yield from range(first, first + count)


def _reason(word: Word, label: RunLabel, row: str, share: float, place: str) -> Reason:
    body, time = next(iter(label.bodies), ""), label.time or 0.0
    return Reason(word, label.phase, row, share, body, place, time, label.reason)


def _untimed(candidate: Candidate, word: Word, edits: ModelEdits, *, removes: bool) -> Remedy:
    """Return a change that no share was measured of."""
    return Remedy(
        candidate.name,
        removes=removes,
        word=word,
        share=math.nan,
        price=None,
        edits=edits,
        accept=candidate.accept,
        apart=math.nan,
        before=math.nan,
    )


def _absurd(motions: Sequence[Motion]) -> set[str]:
    """Return the kinds of facts that say that links are in each other, or press absurdly."""
    found = {fact.kind for fact in facts(motions, [0.0] * len(motions))}
    return {kind for kind in found if kind in ("overlap", "force")}
