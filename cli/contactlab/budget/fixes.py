"""Tries fixes of a reported error: each candidate is evaluated with its own error budget."""

import copy
import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.budget.counted_time import count_pace, count_step_seconds, sample_states
from contactlab.budget.error_budget import SETTINGS
from contactlab.budget.exercised_rows import exercised_rows
from contactlab.budget.field_changes import (
    PARTS_OF_A_STEP,
    build_candidate,
    field_changes,
)
from contactlab.budget.measuring import PhaseMeasure, Settings, count_evaluations, steps_of
from contactlab.budget.motion import Motion
from contactlab.budget.readings import ErrorBudget
from contactlab.budget.reference_distance import FINEST, ChangedModel, distances_to_reference
from contactlab.budget.restarts import refine_motion
from contactlab.budget.time_ratios import measure_time_ratios
from contactlab.budget.verdict import Verdict, VerdictWord, judge
from contactlab.budget.windows import replay_motion
from contactlab.mjcf import OPTIONS
from contactlab.modifications.catalogue import (
    find_part_fix,
    find_row,
    list_candidates,
    list_rows,
)
from contactlab.modifications.contacts import MARGIN
from contactlab.modifications.model_predicates import (
    find_shortest_time_constant,
    find_used_rows,
    raises_time_constants,
)
from contactlab.modifications.modification import (
    NO_EDITS,
    Candidate,
    FieldValue,
    leave_unchanged,
)
from contactlab.modifications.numerics import HALF_STEP, RUN, RUNGE_KUTTA
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.scene.model_draft import ModelEdits, join_edits
from contactlab.scene.model_edits import (
    FIELD_KINDS,
    FLAG_NAMES,
    read_flag,
    read_option,
    set_timestep,
)
from contactlab.scene.model_names import name_of
from contactlab.schema.error_budget import BudgetReason
from contactlab.schema.time_ratio import TimeRatio, cost_class

_ALWAYS_TRIED_RATE = 2  # steps per step of the run that are tried even if another fix helps
_MAX_IMPEDANCE = 0.9999  # the largest impedance that MuJoCo allows
_SAFE_SHARE = 0.5  # a fix below this share of the tolerance is not at its edge


@dataclass(frozen=True)
class TriedFix:
    """A fix that was tried.

    Attributes:
        name: of the fix.
        removes: whether it removes the kind of verdict that it was tried against.
        word: the verdict on the changed model; that on the model as written, if the fix comes no
            nearer to the reference and was not judged further.
        error: of the row that it was tried against, in the worst phase; NaN if not exercised.
        time_ratio: its time over that of the model as written; None if it removes nothing, or if
            the two models have different states.
        edits: all edits.
        apply: as the candidate's.
        distance: from the finest motion of the model, or, against a modeling choice, of the model
            with the choice changed, as a share; NaN if it has other states.
        distance_before: the same of the model as written.
        is_complete: whether the trial was finished; False if its time ran out.
        safely: whether it removes the verdict under half of the tolerance, too.
        harms: whether a load rejects it. It removes the verdict at a first look, and was not judged
            further.
        cost: counted time over that of the model as written, which ranks fixes; infinite if it
            removes nothing or has other states.
    """

    name: str
    removes: bool
    word: VerdictWord
    error: float
    time_ratio: TimeRatio | None
    edits: ModelEdits
    apply: str
    distance: float
    distance_before: float
    is_complete: bool = True
    safely: bool = False
    harms: bool = False
    cost: float = math.inf

    @property
    def changes_model(self) -> bool:
        """Whether it makes another model."""
        return bool(self.apply)


def candidates_against(motions: Sequence[Motion], verdict: Verdict) -> tuple[Candidate, ...]:
    """Return candidates: first changes of the computation, then of fields of named parts."""
    model, changes = motions[0].model, field_changes(motions, verdict)
    usual = (*list_candidates(), *_refine_further(model, verdict))
    if verdict.word == "depends":
        return (*usual, *without_margins(model), *changes, *raise_impedance(model, changes))
    held_constants = _held_constants(model) if raises_time_constants(model) else ()
    return (*usual, *changes, *held_constants)


def without_margins(model: mujoco.MjModel) -> Iterator[Candidate]:
    """Yield the change that removes the margins of all contacts."""
    fix = find_part_fix(MARGIN)
    values = [
        FieldValue(field, (row,), f"{field}[{name_of(model, kind, row)}]", 0.0)
        for field in fix.fields
        for kind in [FIELD_KINDS[field.partition("_")[0]]]
        for row in map(int, np.flatnonzero(getattr(model, field)))
    ]
    if values:
        candidate = build_candidate("no margin of any contact", fix.apply, values, word="depends")
        yield replace(candidate, rows=fix.rows, exercised=fix.exercised)


def _held_constants(model: mujoco.MjModel) -> Iterator[Candidate]:
    """Yield time constants of two steps in place of shorter ones.

    With refsafe the run has them already, and finer steps make another model.
    """
    least, fix = 2 * float(model.opt.timestep), find_part_fix("solref-step")
    values = [
        FieldValue(field, (row,), _name_axis(model, field, row), (least, float(solref[row, 1])))
        for field in fix.fields
        for solref in [getattr(model, field)]
        for short in [find_used_rows(model, field) & (solref[:, 0] > 0) & (solref[:, 0] < least)]
        for row in map(int, np.flatnonzero(short))
    ]
    if values:
        field, _, name = values[0].axis.removesuffix("]").partition("[")
        kind = FIELD_KINDS[field.partition("_")[0]]
        part = name if name.startswith(f"{kind}[") else f"{kind} {name}"
        more = f" and {len(values) - 1} more" if len(values) > 1 else ""
        phrase = f"solref {least:g}, two steps, of {part}{more}"
        candidate = build_candidate(phrase, fix.apply, values)
        yield replace(candidate, exercised=fix.exercised, must_come_nearer=False)


def _name_axis(model: mujoco.MjModel, field: str, row: int) -> str:
    index = int(model.dof_jntid[row]) if field.startswith("dof_") else row
    return f"{field}[{name_of(model, FIELD_KINDS[field.partition('_')[0]], index)}]"


def raise_impedance(model: mujoco.MjModel, stiffer: Sequence[Candidate]) -> Iterator[Candidate]:
    """Yield the impedance that a light part needs under a heavy load, alone and with each solref.

    Under a force f a constraint yields in proportion to (1 - d) / d A f, with the inverse inertia A
    of the part alone. If the part carries a thousand times its weight, d has to come near to 1.
    """
    alone = {
        change.apply: build_candidate(
            f"solimp {_MAX_IMPEDANCE:g} of {_parts_of(change)}",
            change.apply.replace("solref", "solimp"),
            [_hardest_solimp(model, value) for value in change.values],
            word="depends",
        )
        for change in stiffer
        if change.apply in ("solref", "solref-all")
    }
    yield from alone.values()
    for change in stiffer:
        hard = alone.get("solref-all" if change.apply.startswith("solref-all") else "solref")
        if hard is not None:
            both = build_candidate(
                f"{hard.name} and {change.name.partition(' of ')[0]}",
                f"{hard.apply}-{change.apply}",
                [*hard.values, *change.values],
                word="depends",
                rate=change.rate,
            )
            yield replace(both, includes=(hard.name,))


def _parts_of(change: Candidate) -> str:
    return change.name.partition(" of ")[2].partition(" at ")[0]


def _hardest_solimp(model: mujoco.MjModel, value: FieldValue) -> FieldValue:
    field, axis = (name.replace("solref", "solimp") for name in (value.field, value.axis))
    own = getattr(model, field)[value.place].tolist()
    return FieldValue(field, value.place, axis, (_MAX_IMPEDANCE, _MAX_IMPEDANCE, *own[2:]))


def _refine_further(model: mujoco.MjModel, verdict: Verdict) -> Iterator[Candidate]:
    """Yield a step below an eighth of the run's, if one is needed.

    If refsafe raises time constants, it is half of the shortest. Otherwise the error is taken to be
    proportional to the step.
    """
    shares = [abs(reason.error) for reason in verdict.reasons if reason.verdict == "inaccurate"]
    needed = max(filter(math.isfinite, shares), default=0.0) / verdict.tolerance
    if raises_time_constants(model):
        needed = 2 * float(model.opt.timestep) / find_shortest_time_constant(model)
    most_refined = 64  # steps per step of the run
    if verdict.word == "inaccurate" and FINEST < needed <= most_refined:
        rate = math.ceil(needed)
        yield Candidate(f"1/{rate} of the step", "inaccurate", rate=rate)


def list_further_candidates() -> Iterator[Candidate]:
    """Yield further changes of the computation, cheapest first, if the usual ones fail."""
    yield from list_candidates("further")
    yield refine_candidate(RUNGE_KUTTA, 4)
    yield from (refine_candidate(HALF_STEP, times) for times in (8, 16))
    yield refine_candidate(RUNGE_KUTTA, 16)
    yield refine_candidate(HALF_STEP, 32)


def refine_candidate(candidate: Candidate, times: int) -> Candidate:
    """Return a candidate with `times` as many steps."""
    rate = candidate.rate * times
    step = f"{PARTS_OF_A_STEP.get(rate, f'1/{rate} of')} the step"
    alone = candidate.change is leave_unchanged and candidate.edits == NO_EDITS
    name = step if alone else f"{candidate.name.partition(' at ')[0]} at {step}"
    return replace(candidate, name=name, rate=rate, includes=())


def join_candidates(candidates: Sequence[Candidate]) -> Candidate:
    """Return the candidate that makes several changes, one after the other."""

    def change(model: mujoco.MjModel) -> None:
        for candidate in candidates:
            candidate.change(model)

    return Candidate(
        " and ".join(candidate.name for candidate in candidates),
        candidates[0].word,
        change,
        rate=max(candidate.rate for candidate in candidates),
        apply=" ".join(candidate.apply for candidate in candidates if candidate.apply),
        edits=join_edits([candidate.edits for candidate in candidates]),
        compiled=next((one.compiled for one in candidates if one.compiled), None),
        must_come_nearer=all(candidate.must_come_nearer for candidate in candidates),
    )


@dataclass(frozen=True)
class Trial:
    """How candidates are tried.

    Attributes:
        settings: how budgets are measured.
        list_motions: motions of the changed model, in groups that are judged alone, such as those
            of other seeds; the worst counts. By default the same starts and inputs.
        most: number of fixes that are enough; all candidates are tried if None.
        requested: `--apply` names of candidates that are tried in any case.
        workers: threads; one for each processor if None.
        find_time_left: returns the counted time that trials may still take [s]. A trial that would
            take more is skipped or cut short, unless it was requested.
        finds_harm: returns whether the loads of a verification reject a candidate with its edits.
    """

    settings: Settings = SETTINGS
    list_motions: Callable[[Candidate], Iterable[Sequence[Motion]]] | None = None
    most: int | None = None
    requested: Sequence[str] = ()
    workers: int | None = None
    find_time_left: Callable[[], float] = lambda: math.inf
    finds_harm: Callable[[Candidate, ModelEdits], bool] = lambda _candidate, _edits: False


TRIAL = Trial()


def try_fixes(
    motions: Sequence[Motion],
    verdict: Verdict,
    *,
    candidates: Sequence[Candidate] | None = None,
    trial: Trial = TRIAL,
) -> tuple[TriedFix, ...]:
    """Try candidates against a verdict; fixes that remove it come first, the cheapest leading.

    A fix removes a verdict if a budget of the changed model, over the same inputs and phases, gives
    neither the same word nor a worse one. From the same states it also has to come nearer to the
    model's motion at its finest step than the model as written; to within the tolerance, if it
    computes the same model. Against a modeling choice, the finest motion has the choice changed. A
    candidate that does not come nearer is not judged further.

    A candidate is not tried if it moves the model as the model as written, or another candidate,
    does; if it includes a fix that is enough alone, or one that comes at least as near to the
    reference; if it has a finer step than a fix that removes the verdict under half of the
    tolerance, or than one that separates overlapping links; or if it
    changes softness where another computation of the same model removes the verdict. A fix that a
    load rejects counts as one that removes the verdict, but not as one that is enough alone; after
    `trial.most` of them none is tried.
    """
    if verdict.word == "ok":
        return ()
    word: VerdictWord = "depends" if verdict.word == "depends" else "inaccurate"
    rows = sorted({reason.row for reason in verdict.reasons if reason.verdict == "depends"})
    if candidates is None:
        candidates = candidates_against(motions, verdict)
    possible = sorted(
        (one for one in candidates if _is_possible(one, word, rows, motions)),
        key=lambda one: (one.rate > _ALWAYS_TRIED_RATE, one.changes_model, one.rate),
    )
    if not possible:
        return ()
    fix_judge = _FixJudge(
        motions, verdict, word, rows if word == "depends" else (), trial, count_pace(motions)
    )
    comparable = [candidate for candidate in possible if candidate.same_states]
    if (compared := fix_judge.compare_candidates(comparable)) is None:
        return tuple(fix_judge.not_ended(candidate) for candidate in possible)
    before, apart_of = compared
    tried_fixes, moved = list[TriedFix](), [(1, before)]
    while possible:
        candidate = possible.pop(0)
        own = apart_of.get(candidate.name, math.nan)
        if candidate.apply and candidate.apply in trial.requested:
            alone = replace(trial, find_time_left=TRIAL.find_time_left, finds_harm=TRIAL.finds_harm)
            tried_fixes.append(fix_judge._replace(trial=alone).judge_fix(candidate, before, own))
            continue
        removing = [fix for fix in tried_fixes if fix.removes or fix.harms]
        safely = any(fix.safely for fix in removing)
        harmful = sum(fix.harms for fix in tried_fixes)
        most = math.inf if trial.most is None else trial.most
        enough = harmful >= most or (len(removing) >= most and safely)
        alike = _is_alike(candidate, own, moved)
        if enough or alike or _is_redundant(candidate, own, word, removing):
            continue
        moved.append((candidate.rate, own))
        tried_fixes.append(fix_judge.judge_fix(candidate, before, own))
        possible.sort(key=partial(_waits_for_finer, candidate, tried_fixes[-1], word))
    return tuple(sorted(tried_fixes, key=fix_rank))


def _waits_for_finer(
    candidate: Candidate, tried_fix: TriedFix, word: VerdictWord, other: Candidate
) -> bool:
    """Return whether a candidate is tried later, since stiffer parts need a finer step."""
    unheld = word == "depends" and candidate.changes_model and tried_fix.word == "inaccurate"
    return unheld and other.changes_model and other.rate <= candidate.rate


def _is_alike(candidate: Candidate, apart: float, moved: Sequence[tuple[int, float]]) -> bool:
    """Return whether a candidate moves the model as another one with the same step does."""
    compared = candidate.must_come_nearer and not candidate.changes_model
    return compared and any(
        candidate.rate == rate and math.isclose(apart, each, rel_tol=COARSE_ROUNDING)
        for rate, each in moved
        if math.isfinite(each)
    )


def _is_redundant(
    candidate: Candidate, apart: float, word: VerdictWord, removing: Sequence[TriedFix]
) -> bool:
    """Return whether a candidate is redundant next to the fixes that remove the verdict."""
    computed = [fix for fix in removing if not fix.changes_model]
    parted = any(fix.edits.fixes_start for fix in removing)
    included = [fix for fix in removing if fix.name in candidate.includes]
    return (
        any(fix.safely or (fix.removes and apart >= fix.distance) for fix in included)
        or (candidate.rate > _ALWAYS_TRIED_RATE and (any(one.safely for one in computed) or parted))
        or (candidate.changes_model and word == "depends" and bool(computed))
    )


def fix_rank(fix: TriedFix) -> tuple[bool, bool, bool, bool, float]:
    """Return the sort key of a fix: removing, of the start, same model, safe, cheap.

    A fix of an impossible start comes before one that computes the jam differently. A fix that
    leaves less than half of the tolerance comes before one at its edge. Costs within a tenth are
    equal. A fix that was tried earlier is simpler.
    """
    mends_start = fix.edits.fixes_start
    return (
        not fix.removes,
        not mends_start,
        fix.changes_model,
        not fix.safely,
        cost_class(fix.cost),
    )


def _is_possible(
    candidate: Candidate, word: VerdictWord, rows: Sequence[str], motions: Sequence[Motion]
) -> bool:
    if candidate.word != word or (candidate.rows and not {*candidate.rows} & {*rows}):
        return False
    if not all(candidate.applies(motion.model) for motion in motions):
        return False
    if not candidate.exercised:
        return True
    row = find_row(candidate.exercised)
    return any(row.applies(motion.model) and exercised_rows(motion, [row]) for motion in motions)


class _FixJudge(NamedTuple):
    """Judges candidates against a verdict."""

    motions: Sequence[Motion]
    verdict: Verdict
    word: VerdictWord
    rows: Sequence[str]
    trial: Trial
    pace: float  # counted time of a step of the model [s]

    @property
    def _trial_settings(self) -> Settings:
        workers = self.trial.workers or os.cpu_count() or 1
        return replace(self.trial.settings, places=False, measures_time=False, workers=workers)

    @property
    def _quick_settings(self) -> Settings:
        return replace(self._trial_settings, check=False, energy=False)

    @property
    def _failed_phases(self) -> set[str]:
        """Phases that failed."""
        return {reason.phase for reason in self.verdict.reasons}

    @property
    def _failed_motions(self) -> list[Motion]:
        """Motions in phases that failed."""
        return [motion for motion in self.motions if motion.name in self._failed_phases]

    def _can_afford(self, steps: float) -> bool:
        """Return whether there is time for a number of steps of the model."""
        return steps * self.pace <= self.trial.find_time_left()

    def not_ended(self, candidate: Candidate) -> TriedFix:
        """Return a fix whose trial ran out of time."""
        word, edits, accept, nothing = (
            self.verdict.word,
            candidate.edits,
            candidate.apply,
            math.nan,
        )
        return TriedFix(
            candidate.name, False, word, nothing, None, edits, accept, nothing, nothing, False
        )

    def compare_candidates(
        self, candidates: Sequence[Candidate]
    ) -> tuple[float, dict[str, float]] | None:
        """Return the distances to the reference: of the model, and of candidates by name.

        The last candidates are left out if there is no time for them. None if there is no time at
        all.
        """
        some = [*candidates]
        while (apart := self.distances_to_reference(some)) is None:
            if not some:
                return None
            some.pop()
        before, *others = apart
        return before, {one.name: own for one, own in zip(some, others, strict=True)}

    def distances_to_reference(self, candidates: Sequence[Candidate]) -> list[float] | None:
        """Return the largest distance of the model, then of each candidate.

        None if there is no time for it, and no candidate was requested.
        """
        finest = max(FINEST, *(candidate.rate for candidate in candidates), 1)
        rates = 2 * finest + 1 + sum(candidate.rate for candidate in candidates)
        if not self.trial.requested and not self._can_afford(
            rates * steps_of(self._failed_motions)
        ):
            return None
        largest = np.zeros(1 + len(candidates))
        for motion in self._failed_motions:
            rivals = [ChangedModel(motion.model)]
            rivals += [
                ChangedModel(changed_model(motion.model, one), one.rate) for one in candidates
            ]
            target = partial(self._make_reference, own=motion.model)
            apart = distances_to_reference(
                motion,
                rivals,
                settings=self._trial_settings,
                target=target,
                finest=finest,
            )
            largest = np.maximum(largest, apart)
        return largest.tolist()

    def _make_reference(self, model: mujoco.MjModel, own: mujoco.MjModel) -> None:
        """Change the model of the finest motion into the reference, in place."""
        if self.word != "depends":
            return
        row = find_row(self.verdict.reasons[0].row)
        for change in (row.both, row.changes[0]):
            if change is not None:
                change(model, own)

    def judge_fix(self, candidate: Candidate, before: float, apart: float) -> TriedFix:
        """Judge a candidate: by the phases that failed, by all phases, and by new seeds.

        Against a modeling choice, a first look at the phases that failed is followed by the loads
        of a verification. They reject most of the changes that move a model otherwise, and take a
        tenth of the steps of a whole budget. If the task's own seeds leave half of the tolerance,
        new seeds, which are equal draws, repeat no check of their energy by RK4; nor of their
        reference, if only a modeling choice is in question.
        """
        if candidate.must_come_nearer and candidate.same_states and math.isnan(apart):
            return self.not_ended(candidate)  # no time was left to compare it
        row = self.verdict.reasons[0].row if self.word == "depends" else RUN.name
        enough = before if candidate.changes_model else min(before, self.verdict.tolerance)
        word, shares, removes, safely = self.verdict.word, list[float](), False, True
        first, harms, sound = self.motions[0], False, True
        repeated = replace(self._trial_settings, check=self.word != "depends", energy=False)
        options = options_changed(first.model, changed_model(first.model, candidate))
        edits = replace(candidate.edits, settings={**options, **candidate.edits.settings})
        if not candidate.must_come_nearer or math.isinf(before) or apart < enough:
            steps = steps_of(self.motions) * candidate.rate * (2 if self.trial.list_motions else 1)
            for place, (motions, is_new) in enumerate(self._change_motions_by_group(candidate)):
                settings = repeated if is_new and sound else self._trial_settings
                looked = self._look_first(motions, settings)
                if looked is None:
                    return self.not_ended(candidate)
                phases, budget, new_verdict = looked
                removes, screened = (
                    self._removes_verdict(new_verdict),
                    self.word == "depends" and not place,
                )
                harms = removes and screened and self.trial.finds_harm(candidate, edits)
                if removes and not harms:
                    measurement = self._budget_of(phases, motions, steps)
                    if measurement is None:
                        return self.not_ended(candidate)
                    budget, new_verdict = measurement
                    numerics = ErrorBudget(tuple(replace(each, rows=()) for each in budget.phases))
                    half = _SAFE_SHARE * self.verdict.tolerance
                    sound &= judge(numerics, half).word == "ok"
                steps -= steps_of(motions)
                worst = budget.worst(row)
                shares += [worst[1].error] if worst and worst[1].exercised else []
                word, removes = new_verdict.word, self._removes_verdict(new_verdict)
                safely &= self._removes_verdict(judge(budget, _SAFE_SHARE * self.verdict.tolerance))
                if not removes or harms:
                    break
        # If the changed model no longer has the row, its distance to the reference remains.
        share = max(shares, default=apart if candidate.must_come_nearer else math.nan)
        ratio, cost = None, math.inf
        if removes and not harms and candidate.same_states:
            make_model = partial(changed_model, first.model, candidate)
            run = replay_motion(first, self._trial_settings.window, 1)
            timed = {candidate.name: (make_model, candidate.rate)}
            ratio = measure_time_ratios(first, run, timed).get(candidate.name)
            states = sample_states(first)
            own = count_step_seconds(first, first.model, states)
            cost = candidate.rate * count_step_seconds(first, make_model(), states) / own
        return TriedFix(
            name=candidate.name,
            removes=removes and not harms,
            word=word,
            error=share,
            time_ratio=ratio,
            edits=edits,
            apply=candidate.apply,
            distance=apart,
            distance_before=before,
            safely=removes and safely and not harms,
            harms=harms,
            cost=cost,
        )

    def _change_motions_by_group(
        self, candidate: Candidate
    ) -> Iterator[tuple[Sequence[Motion], bool]]:
        """Yield motions of a changed model, and whether they have new seeds.

        Phases that failed come first.
        """
        moved = self.trial.list_motions or self._change_motions
        for place, group in enumerate(moved(candidate)):
            if place:
                yield group, True
                continue
            failed_motions = [motion for motion in group if motion.name in self._failed_phases]
            others = [motion for motion in group if motion.name not in self._failed_phases]
            yield from ((some, False) for some in (failed_motions, others) if some)

    def _change_motions(self, candidate: Candidate) -> Iterator[Sequence[Motion]]:
        yield [change_motion(motion, candidate) for motion in self.motions]

    def _removes_verdict(self, new_verdict: Verdict) -> bool:
        return new_verdict.word == "ok" or (
            self.word == "inaccurate" and new_verdict.word == "depends"
        )

    def _look_first(
        self, motions: Sequence[Motion], settings: Settings
    ) -> tuple[list[PhaseMeasure], ErrorBudget, Verdict] | None:
        """Return a first budget of a changed model at h/4; of one seed if that is decisive.

        The settings are those of the whole budget that may follow.

        An error is the mean over S seeds, so one seed decides if it alone is S times too large. In
        the limit of fine steps an error is at least half of that at h/4. None if there is no time
        for it.
        """
        within = self.verdict.tolerance
        first = [
            replace(motion, starts=motion.starts[:1], inputs=motion.inputs[:1])
            for motion in motions
        ]
        seeds, model = max(motion.seeds for motion in motions), motions[0].model
        rows = [row for row in list_rows() if row.name in self.rows]
        phases, begun = list[PhaseMeasure](), [None for _ in motions]
        budget, verdict = ErrorBudget(()), self.verdict
        for some, most in ((first, 2 * seeds), (motions, 2)):
            if not self._can_afford(
                count_evaluations(model, self._quick_settings, rows) * steps_of(some)
            ):
                return None
            begun = [phase.first_pass for phase in phases] or begun
            phases.clear()  # so that those of one seed end before others begin
            phases += [
                PhaseMeasure(motion, rows, settings, begun=looked)
                for motion, looked in zip(some, begun, strict=True)
            ]
            budget = ErrorBudget(tuple(phase.first_look() for phase in phases))
            verdict = judge(budget, most * within)
            if not self._removes_verdict(verdict):
                break
        return phases, budget, verdict

    def _budget_of(
        self, phases: Sequence[PhaseMeasure], motions: Sequence[Motion], steps: float
    ) -> tuple[ErrorBudget, Verdict] | None:
        """Return the budget of a changed model after a first look at its phases.

        None if there is no time for all `steps` that have to be judged before the fix is proved.
        """
        model = motions[0].model
        rows = [row for row in list_rows() if row.name in self.rows]
        whole = (
            count_evaluations(model, self._trial_settings, rows, drifts=has_drift(self.verdict))
            * steps
        )
        if not self._can_afford(
            whole - count_evaluations(model, self._quick_settings, rows) * steps_of(motions)
        ):
            return None
        budget = ErrorBudget(tuple(phase.measure_budget() for phase in phases))
        return budget, judge(budget, self.verdict.tolerance)


def has_drift(verdict: Verdict) -> bool:
    """Return whether a verdict has an energy drift among its reasons."""
    return any(reason.row == "energy" for reason in verdict.reasons)


def options_changed(model: mujoco.MjModel, changed: mujoco.MjModel) -> dict[str, object]:
    """Return the options and flags of a changed model that differ from those of another."""
    values = {name: read_option(changed, name) for name in OPTIONS}
    options = {name: value for name, value in values.items() if value != read_option(model, name)}
    flags = {name: read_flag(changed, name) for name in FLAG_NAMES}
    return options | {name: on for name, on in flags.items() if on != read_flag(model, name)}


def changed_model(model: mujoco.MjModel, candidate: Candidate) -> mujoco.MjModel:
    """Return a changed copy of a model."""
    changed_copy = copy.copy(candidate.compiled or model)
    candidate.change(changed_copy)
    set_timestep(changed_copy, model.opt.timestep / candidate.rate)
    return changed_copy


def change_motion(motion: Motion, candidate: Candidate) -> Motion:
    """Return a motion of the changed model, its inputs held at the run's rate."""
    model = changed_model(motion.model, candidate)
    return refine_motion(motion, model, candidate.rate)


def describe_reason(reason: BudgetReason, tried_fixes: Sequence[TriedFix]) -> str:
    """Return a reason with the fix that removes it, and its time ratio."""
    removing = [fix for fix in tried_fixes if fix.removes]
    if not removing:
        names = ", ".join(fix.name for fix in tried_fixes)
        return f"{reason.sentence}; not removed by: {names}" if names else reason.sentence
    ratio = removing[0].time_ratio
    cost = f" (x{ratio.ratio:.2f} time)" if ratio else ""
    return f"{reason.sentence}; fix: {removing[0].name}{cost}"
