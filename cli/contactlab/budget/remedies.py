"""What removes what a budget finds: changes of settings, each tried by a budget of its own."""

import copy
import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.budget.error_budget import SETTINGS
from contactlab.budget.measuring import PhaseMeasure, Settings, evaluations, pace, steps_of
from contactlab.budget.motion import Motion
from contactlab.budget.nearness import FINEST, Rival, nearness
from contactlab.budget.physical import (
    PARTS_OF_A_STEP,
    FieldChange,
    FieldValue,
    field_changes,
)
from contactlab.budget.prices import Price, prices
from contactlab.budget.readings import ErrorBudget
from contactlab.budget.rows import (
    ROWS,
    go_on,
    has_no_flex,
    raises_time_constants,
    shortest_time_constant,
    used,
)
from contactlab.budget.showing import shown_rows
from contactlab.budget.verdict import Reason, Verdict, Word, judge
from contactlab.budget.windows import replay
from contactlab.mjcf import OPTIONS
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_edits import FIELD_KINDS, FLAGS, read_flag, read_option
from contactlab.scene.model_names import name_of

_EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
_IMPLICITFAST = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
_IMPLICIT = int(mujoco.mjtIntegrator.mjINT_IMPLICIT)
_ELLIPTIC = int(mujoco.mjtCone.mjCONE_ELLIPTIC)
_SLEEP = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))
_FINER = 64  # most steps in one of the run's that are tried
_COARSE = 2  # steps in one of the run's that are tried whatever else helps
_ALIKE = 1.1  # ratio of costs that are equal
_SAME = 1e-6  # relative, of shares of motions that differ by rounding
_HARDEST = 0.9999  # the largest impedance that MuJoCo allows
_SOLREFS = (
    "geom_solref",
    "pair_solref",
    "jnt_solref",
    "dof_solref",
    "eq_solref",
    "tendon_solref_lim",
    "tendon_solref_fri",
)
_SAFE = 0.5  # part of the tolerance that a change is within, with which it is not at its edge
NO_EDITS = ModelEdits()
MARGIN = "margin"
"""Word of the change by which contacts bear at no distance."""


@dataclass(frozen=True)
class Candidate:
    """A change of a model.

    Attributes:
        name: as a sentence has it: "half the step removes it".
        word: the verdict that it is against.
        change: of a copy of the model.
        rate: how many of its steps make one of the run's.
        rows: of the model, which it is worth trying against; any if empty.
        new: whether it changes a model at all.
        exercised: a row that the task must exercise; any or none if empty.
        accept: of what makes another model, not another computation of the same one, the word that
            accepts it.
        edits: of what makes another model, how it is written.
        compiled: of what no copy of a model can have: the changed model.
        nearer: whether it has to come nearer to the motion as it is at its finest step.
        within: names of changes that it makes too: where one of them is enough, it is not tried.
    """

    name: str
    word: Word
    change: Callable[[mujoco.MjModel], None]
    rate: int = 1
    rows: Sequence[str] = ()
    new: Callable[[mujoco.MjModel], bool] = lambda _model: True
    exercised: str = ""
    accept: str = ""
    edits: ModelEdits = NO_EDITS
    compiled: mujoco.MjModel | None = None
    nearer: bool = True
    within: Sequence[str] = ()

    @property
    def physics(self) -> bool:
        """Whether it makes another model."""
        return bool(self.accept)

    @property
    def same_states(self) -> bool:
        """Whether the changed model can begin in the states of the one that it is of."""
        return not (self.edits.freed or self.edits.posed)


@dataclass(frozen=True)
class Remedy:
    """A change that was tried.

    Attributes:
        name: of the change.
        removes: whether nothing is left of the kind of verdict that it was tried against.
        word: the verdict on the changed model; that on the model as it is, where the change comes
            no nearer to what is meant and was tried no further.
        share: of the row that it was tried against, in the worst phase; NaN if it is not exercised.
        price: its time over that of the model as it is; None where it removes nothing, or where no
            state of the one is one of the other.
        edits: all that it changes.
        accept: as the candidate's.
        apart: share by which it is apart from the finest motion of the model, or, against a row of
            the model, of the model with that row's change; NaN where it has other states.
        before: the same of the model as it is.
        ended: whether it was tried to its end; not where the time for trials ran out before.
        safely: whether it removes the verdict under half of the tolerance, too.
    """

    name: str
    removes: bool
    word: Word
    share: float
    price: Price | None
    edits: ModelEdits
    accept: str
    apart: float
    before: float
    ended: bool = True
    safely: bool = False

    @property
    def physics(self) -> bool:
        """Whether it makes another model."""
        return bool(self.accept)


def _nothing(_model: mujoco.MjModel) -> None:
    pass


def _integrator(kind: int) -> Callable[[mujoco.MjModel], None]:
    def change(model: mujoco.MjModel) -> None:
        model.opt.integrator = kind

    return change


def _is_not(kind: int) -> Callable[[mujoco.MjModel], bool]:
    """Return whether a model would have another integrator, which some refuse for flexes."""
    return lambda model: int(model.opt.integrator) != kind and has_no_flex(model)


def _awake(model: mujoco.MjModel) -> None:
    model.opt.enableflags &= ~_SLEEP


def _noslip(model: mujoco.MjModel) -> None:
    model.opt.noslip_iterations = 10


def _stiff_friction(model: mujoco.MjModel) -> None:
    model.opt.cone = _ELLIPTIC
    model.opt.impratio = 10


def _both(model: mujoco.MjModel) -> None:
    _stiff_friction(model)
    _noslip(model)


RUNGE_KUTTA = Candidate("RK4", "unresolved", _integrator(_RK4), new=_is_not(_RK4))
CANDIDATES: tuple[Candidate, ...] = (
    Candidate(
        "no sleep",
        "unresolved",
        _awake,
        new=lambda model: bool(model.opt.enableflags & _SLEEP),
        nearer=False,  # windows begin awake, and so do not show what sleep takes
    ),
    Candidate("Newton with 100 iterations", "unresolved", go_on, exercised="solver"),
    Candidate("implicitfast", "unresolved", _integrator(_IMPLICITFAST), new=_is_not(_IMPLICITFAST)),
    Candidate("Euler", "unresolved", _integrator(_EULER), new=_is_not(_EULER)),
    Candidate("half the step", "unresolved", _nothing, 2),
    Candidate(
        "implicitfast at half the step",
        "unresolved",
        _integrator(_IMPLICITFAST),
        2,
        new=_is_not(_IMPLICITFAST),
        within=("implicitfast", "half the step"),
    ),
    RUNGE_KUTTA,
    Candidate("a quarter of the step", "unresolved", _nothing, 4),
    Candidate("an eighth of the step", "unresolved", _nothing, 8),
    Candidate("elliptic cones with impratio 10", "model", _stiff_friction),
    Candidate(
        "elliptic cones with impratio 10, and noslip",
        "model",
        _both,
        new=has_no_flex,
        within=("elliptic cones with impratio 10",),
    ),
    Candidate("noslip with 10 iterations", "model", _noslip, rows=("noslip",), new=has_no_flex),
)


def candidates_against(motions: Sequence[Motion], verdict: Verdict) -> tuple[Candidate, ...]:
    """Return changes that may help: of computation first, then of the fields of named parts."""
    word: Word = "model" if verdict.word == "model" else "unresolved"
    model, changes = motions[0].model, field_changes(motions, verdict)
    hard = harder(model, changes) if word == "model" else ()
    held = _held_constants(model) if word == "unresolved" and raises_time_constants(model) else ()
    # A contact that bears before its geoms touch is softer than its solref says.
    margins = without_margins(model) if word == "model" else ()
    # Softness of several rows is nearer to none of them.
    physical = [of_fields(change, word, nearer=word == "unresolved") for change in changes]
    return (
        *CANDIDATES,
        *_finer(model, verdict),
        *(
            replace(
                of_fields(change, word, nearer=False),
                rows=("contact softness",),
                exercised="margin",
            )
            for change in margins
        ),
        *physical,
        *(of_fields(change, word, nearer=False) for change in hard),
        *(replace(of_fields(change, word, nearer=False), exercised="refsafe") for change in held),
    )


def of_fields(change: FieldChange, word: Word, *, nearer: bool) -> Candidate:
    """Return a change of fields as one that may be tried."""
    return Candidate(
        change.phrase,
        word,
        change.make,
        change.rate,
        accept=change.word,
        edits=ModelEdits({value.axis: value.value for value in change.values}),
        within=change.after,
        nearer=nearer,
    )


def without_margins(model: mujoco.MjModel) -> Iterator[FieldChange]:
    """Yield the change by which no contact bears before its geoms touch."""
    values = [
        FieldValue(f"{kind}_{part}", (row,), f"{kind}_{part}[{name_of(model, kind, row)}]", 0.0)
        for kind in ("geom", "pair")
        for part in ("margin", "gap")
        for row in map(int, np.flatnonzero(getattr(model, f"{kind}_{part}")))
    ]
    if values:
        yield FieldChange(MARGIN, "no margin of any contact", tuple(values))


def _held_constants(model: mujoco.MjModel) -> Iterator[FieldChange]:
    """Yield the time constants that the step can hold, two of it, in place of shorter ones.

    With refsafe the run has them already, and finer steps another model: this one is what moves.
    """
    least = 2 * float(model.opt.timestep)
    values = [
        FieldValue(field, (row,), _axis(model, field, row), (least, float(solref[row, 1])))
        for field in _SOLREFS
        for solref in [getattr(model, field)]
        for short in [used(model, field) & (solref[:, 0] > 0) & (solref[:, 0] < least)]
        for row in map(int, np.flatnonzero(short))
    ]
    if values:
        field, _, name = values[0].axis.removesuffix("]").partition("[")
        kind = FIELD_KINDS[field.partition("_")[0]]
        part = name if name.startswith(f"{kind}[") else f"{kind} {name}"
        more = f" and {len(values) - 1} more" if len(values) > 1 else ""
        phrase = f"solref {least:g}, two steps, of {part}{more}"
        yield FieldChange("solref-step", phrase, tuple(values))


def _axis(model: mujoco.MjModel, field: str, row: int) -> str:
    index = int(model.dof_jntid[row]) if field.startswith("dof_") else row
    return f"{field}[{name_of(model, FIELD_KINDS[field.partition('_')[0]], index)}]"


def harder(model: mujoco.MjModel, stiffer: Sequence[FieldChange]) -> Iterator[FieldChange]:
    """Yield the impedance that a light part needs under a heavy load, alone and with each solref.

    Under a force f a constraint gives by what goes with (1 - d) / d A f, A being the inverse
    inertia of what it is of alone: where that bears a thousand times its weight, it is d that has
    to come near to 1.
    """
    alone = {
        change.word: FieldChange(
            change.word.replace("solref", "solimp"),
            f"solimp {_HARDEST:g} of {change.phrase.partition(' of ')[2].partition(' at ')[0]}",
            tuple(_hard(model, value) for value in change.values),
        )
        for change in stiffer
        if change.word in ("solref", "solref-all")
    }
    yield from alone.values()
    for change in stiffer:
        hard = alone.get("solref-all" if change.word.startswith("solref-all") else "solref")
        if hard is not None:
            yield FieldChange(
                f"{hard.word}-{change.word}",
                f"{hard.phrase} and {change.phrase.partition(' of ')[0]}",
                (*hard.values, *change.values),
                change.rate,
                (hard.phrase,),
            )


def _hard(model: mujoco.MjModel, value: FieldValue) -> FieldValue:
    """Return the hardest solimp of what a solref is of."""
    field, axis = (name.replace("solref", "solimp") for name in (value.field, value.axis))
    own = getattr(model, field)[value.place].tolist()
    return FieldValue(field, value.place, axis, (_HARDEST, _HARDEST, *own[2:]))


def _finer(model: mujoco.MjModel, verdict: Verdict) -> Iterator[Candidate]:
    """Yield the step that is called for where an eighth is too long.

    Of time constants that refsafe raises it is half of the shortest; else what a share calls for,
    which goes with the step.
    """
    shares = [abs(reason.share) for reason in verdict.reasons if reason.word == "unresolved"]
    needed = max(filter(math.isfinite, shares), default=0.0) / verdict.within
    if raises_time_constants(model):
        needed = 2 * float(model.opt.timestep) / shortest_time_constant(model)
    if verdict.word == "unresolved" and FINEST < needed <= _FINER:
        rate = math.ceil(needed)
        yield Candidate(f"1/{rate} of the step", "unresolved", _nothing, rate)


def further(half: Candidate) -> Iterator[Candidate]:
    """Yield changes of computation for where none of the usual ones is enough, cheapest first.

    Gyroscopic forces are explicit in implicitfast as in Euler; `implicit` has their derivatives.
    """
    yield Candidate("implicit", "unresolved", _integrator(_IMPLICIT), new=_is_not(_IMPLICIT))
    yield finer(RUNGE_KUTTA, 4)
    yield from (finer(half, times) for times in (8, 16))
    yield finer(RUNGE_KUTTA, 16)
    yield finer(half, 32)


def finer(candidate: Candidate, times: int) -> Candidate:
    """Return a change at so many times as many steps."""
    rate = candidate.rate * times
    step = f"{PARTS_OF_A_STEP.get(rate, f'1/{rate} of')} the step"
    alone = candidate.change is _nothing and candidate.edits == NO_EDITS
    name = step if alone else f"{candidate.name.partition(' at ')[0]} at {step}"
    return replace(candidate, name=name, rate=rate, within=())


def joined(candidates: Sequence[Candidate]) -> Candidate:
    """Return the change that makes several, one after the other."""

    def change(model: mujoco.MjModel) -> None:
        for candidate in candidates:
            candidate.change(model)

    return Candidate(
        " and ".join(candidate.name for candidate in candidates),
        candidates[0].word,
        change,
        rate=max(candidate.rate for candidate in candidates),
        accept=" ".join(candidate.accept for candidate in candidates if candidate.accept),
        edits=ModelEdits(
            {name: own for one in candidates for name, own in one.edits.settings.items()},
            excluded=tuple(pair for one in candidates for pair in one.edits.excluded),
            freed=tuple(body for one in candidates for body in one.edits.freed),
            fitted=tuple(geom for one in candidates for geom in one.edits.fitted),
            posed=tuple(key for one in candidates for key in one.edits.posed),
        ),
        compiled=next((one.compiled for one in candidates if one.compiled), None),
        nearer=all(candidate.nearer for candidate in candidates),
    )


@dataclass(frozen=True)
class Trial:
    """How changes are tried.

    Attributes:
        settings: how budgets are measured.
        moved: motions of the changed model, in groups that are judged by themselves, such as those
            of other seeds; the worst counts. By default the same starts and inputs.
        most: so many changes that remove a verdict are enough; all are tried if None.
        wanted: words of changes that are tried even then.
        workers: threads; one for each processor if None.
        left: returns how much CPU trials may still take [s]. A change whose trial would take more
            is not begun, or not ended; one that is wanted always is.
    """

    settings: Settings = SETTINGS
    moved: Callable[[Candidate], Iterable[Sequence[Motion]]] | None = None
    most: int | None = None
    wanted: Sequence[str] = ()
    workers: int | None = None
    left: Callable[[], float] = lambda: math.inf


TRIAL = Trial()


def remedies(
    motions: Sequence[Motion],
    verdict: Verdict,
    *,
    candidates: Sequence[Candidate] | None = None,
    trial: Trial = TRIAL,
) -> tuple[Remedy, ...]:
    """Try changes against a verdict; those that remove it come first, the cheapest leading.

    A change removes a verdict if a budget of the changed model, over the same inputs and phases,
    gives neither the same word nor a worse one, and if from the same states it comes nearer to the
    model's motion at its finest step than the model as it is, to within the tolerance if it is to
    compute the same model; against a row of the model, to the finest motion with that row's change.
    What does not come nearer is judged no further.

    Not tried is what moves the model as it moves without, or with a change that was tried; what
    makes a change that is enough alone, and more; a finer step where a coarser one removes the
    verdict under half of the tolerance, too, or that links in each other no longer touch; other
    softness where another computation of the same model removes the verdict.
    """
    if verdict.word == "sound":
        return ()
    word: Word = "model" if verdict.word == "model" else "unresolved"
    rows = sorted({reason.row for reason in verdict.reasons if reason.word == "model"})
    if candidates is None:
        candidates = candidates_against(motions, verdict)
    possible = sorted(
        (one for one in candidates if _is_possible(one, word, rows, motions)),
        key=lambda one: (one.rate > _COARSE, one.physics, one.rate),
    )
    if not possible:
        return ()
    judged = _Judged(motions, verdict, word, rows if word == "model" else (), trial, pace(motions))
    comparable = [candidate for candidate in possible if candidate.same_states]
    if (compared := judged.compared(comparable)) is None:
        return tuple(judged.not_ended(candidate) for candidate in possible)
    before, apart_of = compared
    tried, moved = list[Remedy](), [(1, before)]
    while possible:
        candidate = possible.pop(0)
        own = apart_of.get(candidate.name, math.nan)
        if candidate.accept and candidate.accept in trial.wanted:
            untimed = judged._replace(trial=replace(trial, left=TRIAL.left))
            tried.append(untimed.remedy(candidate, before, own))
            continue
        removing = [remedy for remedy in tried if remedy.removes]
        safely = any(remedy.safely for remedy in removing)
        enough = trial.most is not None and len(removing) >= trial.most and safely
        alike = _is_alike(candidate, own, moved)
        if enough or alike or _is_idle(candidate, word, removing):
            continue
        moved.append((candidate.rate, own))
        tried.append(judged.remedy(candidate, before, own))
        possible.sort(key=partial(_waits_for_finer, candidate, tried[-1], word))
    return tuple(sorted(tried, key=by_use))


def _waits_for_finer(candidate: Candidate, found: Remedy, word: Word, other: Candidate) -> bool:
    """Return whether another change waits: what a step does not hold, it does not hold stiffer."""
    unheld = word == "model" and candidate.physics and found.word == "unresolved"
    return unheld and other.physics and other.rate <= candidate.rate


def _is_alike(candidate: Candidate, apart: float, moved: Sequence[tuple[int, float]]) -> bool:
    """Return whether a change moves the model as another of the same step does."""
    compared = candidate.nearer and not candidate.physics
    return compared and any(
        candidate.rate == rate and math.isclose(apart, each, rel_tol=_SAME)
        for rate, each in moved
        if math.isfinite(each)
    )


def _is_idle(candidate: Candidate, word: Word, removing: Sequence[Remedy]) -> bool:
    """Return whether nobody would make a change beside those that remove the verdict."""
    computed = [remedy for remedy in removing if not remedy.physics]
    parted = any(remedy.edits.mends_start for remedy in removing)
    return (
        any(remedy.name in candidate.within and remedy.safely for remedy in removing)
        or (candidate.rate > _COARSE and (any(one.safely for one in computed) or parted))
        or (candidate.physics and word == "model" and bool(computed))
    )


def by_use(remedy: Remedy) -> tuple[bool, bool, bool, bool, float]:
    """Return the place of a remedy: what removes, computes the same model, and is cheap, is first.

    Where a start that no joint, contact or equality allows is the cause, what mends it comes before
    what computes the jam otherwise, and what leaves less than half of the tolerance before what is
    at its edge. Costs within a tenth are equal: the clock tells no more. What was tried first is
    simpler.
    """
    cost = round(math.log(remedy.price.ratio, _ALIKE)) if remedy.price else math.inf
    mends_start = remedy.edits.mends_start
    return not remedy.removes, not mends_start, remedy.physics, not remedy.safely, cost


def _is_possible(
    candidate: Candidate, word: Word, rows: Sequence[str], motions: Sequence[Motion]
) -> bool:
    if candidate.word != word or (candidate.rows and not {*candidate.rows} & {*rows}):
        return False
    if not all(candidate.new(motion.model) for motion in motions):
        return False
    return not candidate.exercised or _exercised(candidate.exercised, motions)


class _Judged(NamedTuple):
    """What changes are judged by."""

    motions: Sequence[Motion]
    verdict: Verdict
    word: Word
    rows: Sequence[str]
    trial: Trial
    pace: float  # CPU of a step of the model [s]

    @property
    def _settings(self) -> Settings:
        workers = self.trial.workers or os.cpu_count() or 1
        return replace(self.trial.settings, places=False, priced=False, workers=workers)

    @property
    def _phases(self) -> set[str]:
        """Those in which something is wrong."""
        return {reason.phase for reason in self.verdict.reasons}

    @property
    def _wrong(self) -> list[Motion]:
        """Motions of the phases in which something is wrong."""
        return [motion for motion in self.motions if motion.name in self._phases]

    def _affords(self, steps: float) -> bool:
        """Return whether there is time for so many steps of the model."""
        return steps * self.pace <= self.trial.left()

    def not_ended(self, candidate: Candidate) -> Remedy:
        """Return a change that there was no time to try."""
        word, edits, accept, nothing = (
            self.verdict.word,
            candidate.edits,
            candidate.accept,
            math.nan,
        )
        return Remedy(
            candidate.name, False, word, nothing, None, edits, accept, nothing, nothing, False
        )

    def compared(self, candidates: Sequence[Candidate]) -> tuple[float, dict[str, float]] | None:
        """Return how far the model is from what is meant, and changed ones by name.

        The last are left out for which there is no time. None if there is none at all.
        """
        some = [*candidates]
        while (apart := self.nearness(some)) is None:
            if not some:
                return None
            some.pop()
        before, *others = apart
        return before, {one.name: own for one, own in zip(some, others, strict=True)}

    def nearness(self, candidates: Sequence[Candidate]) -> list[float] | None:
        """Return how far the model is from what is meant, then each changed one, at worst.

        None if there is no time for it, and nothing is wanted.
        """
        finest = max(FINEST, *(candidate.rate for candidate in candidates), 1)
        rates = 2 * finest + 1 + sum(candidate.rate for candidate in candidates)
        if not self.trial.wanted and not self._affords(rates * steps_of(self._wrong)):
            return None
        found = np.zeros(1 + len(candidates))
        for motion in self._wrong:
            rivals = [Rival(motion.model)]
            rivals += [Rival(changed_model(motion.model, one), one.rate) for one in candidates]
            target = partial(self._meant, own=motion.model)
            apart = nearness(
                motion,
                rivals,
                settings=self._settings,
                target=target,
                finest=finest,
            )
            found = np.maximum(found, apart)
        return found.tolist()

    def _meant(self, model: mujoco.MjModel, own: mujoco.MjModel) -> None:
        """Change the finest motion's model into what it is meant to be, in place."""
        if self.word != "model":
            return
        (row,) = (row for row in ROWS if row.name == self.verdict.reasons[0].row)
        for change in (row.both, row.changes[0]):
            if change is not None:
                change(model, own)

    def remedy(self, candidate: Candidate, before: float, apart: float) -> Remedy:
        """Judge a change: by the phases in which something is wrong, by all, and by fresh seeds."""
        if candidate.nearer and candidate.same_states and math.isnan(apart):
            return self.not_ended(candidate)  # no time was left to compare it
        row = self.verdict.reasons[0].row if self.word == "model" else "run"
        enough = before if candidate.physics else min(before, self.verdict.within)
        word, shares, removes, safely = self.verdict.word, list[float](), False, True
        if not candidate.nearer or math.isinf(before) or apart < enough:
            steps = steps_of(self.motions) * candidate.rate * (2 if self.trial.moved else 1)
            for motions in self._parts(candidate):
                measured = self._budget(motions, steps)
                if measured is None:
                    return self.not_ended(candidate)
                steps -= steps_of(motions)
                budget, found = measured
                worst = budget.worst(row)
                shares += [worst[1].share] if worst and worst[1].exercised else []
                word, removes = found.word, self._removes(found)
                safely &= self._removes(judge(budget, _SAFE * self.verdict.within))
                if not removes:
                    break
        # A row that the changed model no longer has leaves what it is apart from it.
        share = max(shares, default=apart if candidate.nearer else math.nan)
        first = self.motions[0]
        options = options_changed(first.model, changed_model(first.model, candidate))
        edits = replace(candidate.edits, settings={**options, **candidate.edits.settings})
        timed = removes and candidate.same_states
        price = _price(first, candidate, self._settings) if timed else None
        return Remedy(
            name=candidate.name,
            removes=removes,
            word=word,
            share=share,
            price=price,
            edits=edits,
            accept=candidate.accept,
            apart=apart,
            before=before,
            safely=removes and safely,
        )

    def _parts(self, candidate: Candidate) -> Iterator[Sequence[Motion]]:
        """Yield motions of a changed model, those first in whose phases something is wrong."""
        moved = self.trial.moved or self._same
        for place, group in enumerate(moved(candidate)):
            if place:
                yield group
                continue
            named = [motion for motion in group if motion.name in self._phases]
            others = [motion for motion in group if motion.name not in self._phases]
            yield from filter(None, (named, others))

    def _same(self, candidate: Candidate) -> Iterator[Sequence[Motion]]:
        yield [changed(motion, candidate) for motion in self.motions]

    def _removes(self, found: Verdict) -> bool:
        return found.word == "sound" or (self.word == "unresolved" and found.word == "model")

    def _budget(
        self, motions: Sequence[Motion], steps: float
    ) -> tuple[ErrorBudget, Verdict] | None:
        """Return the budget of a changed model; of one seed or at h/4 alone where that is clear.

        A share is the mean of its seeds', so that one of S decides where it alone is S times too
        large. In the limit of fine steps it is at least half of that at h/4. None if there is no
        time for it, or for that of all `steps` that have to be judged before the change is proved.
        """
        within, settings = self.verdict.within, self._settings
        quick = replace(settings, check=False, energy=False)
        first = [
            replace(motion, starts=motion.starts[:1], inputs=motion.inputs[:1])
            for motion in motions
        ]
        seeds, model = max(motion.seeds for motion in motions), motions[0].model
        rows = [row for row in ROWS if row.name in self.rows]
        phases, begun = list[PhaseMeasure](), [None for _ in motions]
        for some, most in ((first, 2 * seeds), (motions, 2)):
            looks = evaluations(model, quick, rows) * steps_of(some)
            if not self._affords(looks):
                return None
            begun = [phase.looked for phase in phases] or begun
            phases.clear()  # so that those of one seed end before others begin
            phases += [
                PhaseMeasure(motion, rows, settings, begun=looked)
                for motion, looked in zip(some, begun, strict=True)
            ]
            budget = ErrorBudget(tuple(phase.first_look() for phase in phases))
            found = budget, judge(budget, most * within)
            if not self._removes(found[1]):
                return found
        whole = evaluations(model, settings, rows, drifts=drifts(self.verdict))
        if not self._affords(whole * steps - looks):
            return None
        budget = ErrorBudget(tuple(phase.budget() for phase in phases))
        return budget, judge(budget, within)


def drifts(verdict: Verdict) -> bool:
    """Return whether a verdict names what a run's energy does."""
    return any(reason.row == "energy" for reason in verdict.reasons)


def options_changed(model: mujoco.MjModel, changed: mujoco.MjModel) -> dict[str, object]:
    """Return the options and flags of a changed model that differ from those of another."""
    values = {name: read_option(changed, name) for name in OPTIONS}
    options = {name: value for name, value in values.items() if value != read_option(model, name)}
    flags = {name: read_flag(changed, name) for name in FLAGS}
    return options | {name: on for name, on in flags.items() if on != read_flag(model, name)}


def _exercised(name: str, motions: Sequence[Motion]) -> bool:
    (row,) = (row for row in ROWS if row.name == name)
    return any(row.uses(motion.model) and shown_rows(motion, [row]) for motion in motions)


def changed_model(model: mujoco.MjModel, candidate: Candidate) -> mujoco.MjModel:
    """Return a changed copy of a model."""
    made = copy.copy(candidate.compiled or model)
    candidate.change(made)
    made.opt.timestep = model.opt.timestep / candidate.rate
    return made


def changed(motion: Motion, candidate: Candidate) -> Motion:
    """Return a motion of the changed model, its inputs held at the run's rate."""
    model = changed_model(motion.model, candidate)
    return replace(motion, model=model, inputs=motion.inputs.repeat(candidate.rate, axis=1))


def _price(motion: Motion, candidate: Candidate, settings: Settings) -> Price | None:
    run, made = replay(motion, settings.window, 1), partial(changed_model, motion.model, candidate)
    return prices(motion, run, {candidate.name: (made, candidate.rate)}).get(candidate.name)


def sentence(reason: Reason, tried: Sequence[Remedy]) -> str:
    """Return a reason with what removes it, and its price."""
    found = [remedy for remedy in tried if remedy.removes]
    if not found:
        names = ", ".join(remedy.name for remedy in tried)
        return f"{reason.sentence}; none removes it of {names}" if names else reason.sentence
    price = found[0].price
    cost = f", at {price.ratio:.2g} times the cost" if price else ""
    return f"{reason.sentence}; {found[0].name} removes it{cost}"
