"""What is answered: written, judged by the judge of `contactlab MODEL`, on seeds nobody has seen.

What fails there is not told. The next best takes its place, and, before the time or the tries are
over, the safest that is known.
"""

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory

import mujoco

from contactlab.budget import ErrorBudget, Motion, Settings, error_budget, judge
from contactlab.budget.measuring import evaluations
from contactlab.errors import SceneError
from contactlab.judge.wording import plural
from contactlab.scene.model_names import geom_word
from contactlab.scene.model_writer import WrittenModel, write_model
from contactlab.schema.task import Task
from contactlab.schema.tune_report import MODEL, Aim, Judged, Verified
from contactlab.studies.check.checked_model import CheckedModel
from contactlab.studies.examine.changes import fresh
from contactlab.studies.examine.examination import ExamineRequest, open_model
from contactlab.studies.search.allowed_time import AllowedTime
from contactlab.studies.search.choice import INTEGRATOR, Choice, Key, described, differing
from contactlab.studies.search.levers import Unsearched
from contactlab.studies.search.searching import (
    SAME,
    SAVES,
    Bound,
    Measure,
    Search,
    Tried,
    share_of,
)
from contactlab.studies.search.subject import Subject, first_seeds
from contactlab.studies.search.tune_request import TuneRequest
from contactlab.studies.search.unused_pairs import pairs_within
from contactlab.studies.search.wording import (
    UNJUDGED,
    error_text,
    finite,
    is_faster,
    price_text,
)
from contactlab.studies.search.yardstick import Apart, Yardsticks
from contactlab.studies.session import Session
from contactlab.studies.task_verdict import run_labels

_JUDGED = 30  # times that a verdict simulates the task: references, their check and RK4, itself
_JUDGING = 0.1  # of the time allowed, for what the judge says of the model as written
_TIMED = 12  # times that whole runs are timed, of two seeds: of a choice, and of the model twice
_COMPILED = 5  # times that a verdict compiles the model: to write, compare, open and run it
_LABELLED = 0.8  # s of CPU time that runs of a model, written and as it is, take to be labelled
_LATE = 0.1  # of the time allowed, that the first verdict of an answer may end after it
_MOST_TRIES, _MOST_MEASURED = 8, 25
"""Choices that are judged, and whose errors are looked at, on fresh seeds."""
_WORTH_A_PROCESS = 0.3  # s that a task takes: what is shorter is over before a process has begun
_MUCH_LESS = 0.6
_SAFEST = 0.5  # of the time that is left, for what is safest
_VERDICTS = 0.5  # of the time that is left, for verdicts: other work may slow them down
_SETTINGS = Settings(places=False, excess=False)  # of a verdict
_RK4, _STAGES = int(mujoco.mjtIntegrator.mjINT_RK4), 4


@dataclass(frozen=True)
class Wanted:
    """An answer that is wanted.

    Attributes:
        bound: of its error.
        folder: where the model is written.
        sound: whether it has to be sound; else it may be what the model as written is, too.
    """

    bound: Bound
    folder: str
    sound: bool = True


@dataclass(frozen=True)
class Answer:
    """A choice whose model was written, and held on fresh seeds."""

    tried: Tried
    written: WrittenModel
    verified: Verified


@dataclass(frozen=True)
class Below:
    """What a choice has to be after those that failed: of a smaller error, or of shorter steps.

    Attributes:
        error: so small, it may have any step that did not fail.
        multiple: in fine steps; so short, it may have any error that the bound allows.
        failed: steps that failed, by integrator; no longer one of that is tried.
    """

    error: float = math.inf
    multiple: float = 0.0
    failed: Mapping[object, int] = field(default_factory=dict[object, int])

    def has(self, tried: Tried) -> bool:
        """Return whether something lies below."""
        if tried.choice.multiple >= self.failed.get(_integrator(tried), math.inf):
            return False
        return share_of(tried) <= self.error or tried.choice.multiple <= self.multiple

    def without(self, tried: Tried, part: float) -> "Below":
        """Return what has to be after something else failed, of which a part may hold."""
        step = tried.choice.multiple
        name = _integrator(tried)
        failed = {**self.failed, name: min(step, self.failed.get(name, step))}
        return Below(part * share_of(tried), part * step, failed)


def _integrator(tried: Tried) -> object:
    return tried.choice.settings.get(INTEGRATOR)


@dataclass(frozen=True)
class _Judgement:
    """What the judge says of numerics: word, largest share, shares of seeds there, and reason."""

    word: str
    share: float
    low: float
    high: float
    why: str


class Answers:
    """Writes what was found, and judges it.

    Attributes:
        kept: what failed, or was not judged, and why.
        failed: what failed on fresh seeds.
    """

    def __init__(
        self,
        request: TuneRequest,
        session: Session,
        subject: Subject,
        search: Search,
        aim: Aim,
        allowed: AllowedTime,
    ) -> None:
        """Take what was searched."""
        self._request, self._session = request, session
        self._subject, self._search, self._aim = subject, search, aim
        self._allowed = allowed
        self.kept = list[Unsearched]()
        self.failed = set[Key]()
        self._said_now = dict[tuple[int, ...], _Judgement]()
        self._seed_took = _JUDGED * subject.one_pass
        self._labels_now = dict[tuple[int, ...], set[str]]()

    @property
    def _examined(self) -> CheckedModel:
        return self._subject.examined

    @property
    def known(self) -> Tried:
        """The model as written."""
        return self._search.tried[self._search.now.key]

    def takes(self, tried: Tried) -> float:
        """Return how long it takes to write, judge and time a choice on few seeds, about [s]."""
        own, timed = 2 * self._work(tried) * self._seed_took, _TIMED * self._subject.one_pass
        return self._allowed.takes(self._written + own + timed + self._begun)

    @property
    def to_judge(self) -> float:
        """The same of the model as written [s]."""
        return self.takes(self.known)

    @property
    def _written(self) -> float:
        """CPU time that a model takes to be written, compared, opened and labelled, about [s]."""
        return _COMPILED * self._subject.compiling + _LABELLED

    @property
    def _begun(self) -> float:
        """CPU time of what the first verdict needs of a fresh seed, about [s].

        It is the fine motion that errors are held to, and a verdict on the model as written; both
        are kept.
        """
        if "_yards" in vars(self):
            return 0.0
        return self._subject.yards.finer * self._subject.one_pass + self._seed_took

    def of(self, wanted: Wanted, later: int = 0) -> Answer | None:
        """Write what is best until one holds on fresh seeds; None if none is better than now.

        Once one failed, the rest of the time is for so many later answers as well.
        """
        below, done = Below(), {self.known.choice.key}
        for number in range(_MOST_TRIES):
            late = -later * self.to_judge if number else _LATE * self._allowed.seconds
            if self._is_late(wanted, self._allowed.takes(self._written + self._begun) - late):
                break
            last = number > 0 and (
                number == _MOST_TRIES - 1 or self._allowed.left < 2 * self.to_judge
            )
            measured = self._within(wanted, done, below, late, last=last)
            if measured is None:
                break
            tried, error = measured
            try:
                written = self._write(tried, wanted.folder)
            except SceneError as refused:
                self._fail(tried, str(refused).splitlines()[0])
                continue
            found = self._judged(tried, error, written, wanted)
            if found.holds:
                return Answer(tried, written, found)
            self._fail(tried, f"on fresh seeds: {found.sentence}")
            # What is not sound, or labelled, may be so by its step, whatever its error.
            limits = [self._examined.task.within]
            if not wanted.sound:
                limits += [said.high for said in self._said_now.values()]
            part = part_within(found.share, max(limits))
            below = below.without(tried, part)
        self.drop(wanted)
        return None

    def _is_late(self, wanted: Wanted, takes: float) -> bool:
        """Return whether too little time is left for what takes so long [s], and tell."""
        if late := self._allowed.left < takes:
            self.kept.append(Unsearched(wanted.folder, UNJUDGED))
        return late

    def _fail(self, tried: Tried, reason: str) -> None:
        self.failed.add(tried.choice.key)
        self.kept.append(Unsearched(self._name(tried), reason))

    def _work(self, tried: Tried) -> float:
        """Return how long a verdict takes of a choice over one of the model as written, about."""
        own, other = (
            work_of(self._search.space.made(one.choice)) / one.choice.multiple
            for one in (self.known, tried)
        )
        return other / own

    def drop(self, wanted: Wanted) -> None:
        """Remove what was written, and tell of what may be faster, but for noise."""
        rmtree(self._session.folder / wanted.folder, ignore_errors=True)
        if self._search.dearest is not None or share_of(self.known) > wanted.bound.limit:
            return
        for tried in self._search.ranked(wanted.bound):
            if tried.price and tried.price.ratio < SAVES and not self._saves(tried):
                twin = self.known.price
                assert twin
                reason = (
                    f"{price_text(tried.price)} of the time, not to be told from as written, "
                    f"{price_text(twin)}"
                )
                told = Unsearched(self._name(tried), reason)
                self.kept += [] if told in self.kept else [told]
                break

    def _within(
        self, wanted: Wanted, done: set[Key], below: Below, late: float, *, last: bool
    ) -> tuple[Tried, Apart] | None:
        """Return the best that lies below, whose error on fresh seeds is within the limit.

        None if there is none, or no time to judge it, which may end so late [s].

        An error is measured in a small part of the time that a verdict takes. The last is safe, if
        anything is.
        """
        first = True
        while len(done) < _MOST_MEASURED:
            last = last or (not first and self._allowed.left < 2 * self.to_judge)
            ways = [partial(self._next, below=below), self._safest]
            found = (way(done, wanted.bound) for way in (ways[::-1] if last else ways))
            tried = next(filter(None, found), None)
            if tried is None or self._is_late(wanted, self.takes(tried) - late):
                return None
            done.add(tried.choice.key)
            made = self._search.space.made(tried.choice)
            error = self._measure.apart(made, tried.choice.multiple)
            why = self._excess(error, wanted)
            if not why:
                return tried, error
            if first:
                self._fail(tried, f"on fresh seeds: {why}")
            self.failed.add(tried.choice.key)
            first = False
        return None

    def _name(self, tried: Tried) -> str:
        return described(self.settings(tried.choice)) or "without what changes no state"

    def is_better(self, tried: Tried, bound: Bound) -> bool:
        """Return whether something serves a bound better than the model as written."""
        known = self.known
        assert tried.error
        assert tried.price
        assert known.error
        if self._search.dearest is not None:
            if self._search.dearest < 1:
                return True
            return tried.error.share < SAVES * known.error.share
        return known.error.share > bound.limit or self._saves(tried)

    def _saves(self, tried: Tried) -> bool:
        """Return whether something takes less time than the model as written, beyond noise."""
        price, twin = tried.price, self.known.price
        assert price
        assert twin
        return price.ratio < SAVES and is_faster(price, twin)

    def _next(self, done: set[Key], bound: Bound, below: Below) -> Tried | None:
        """Return the best that was not verified yet and lies below: known, or at a shorter step."""
        search = self._search

        def fits(one: Tried) -> bool:
            new = one.choice.key not in done
            keeps = search.dearest is not None or share_of(one) <= bound.accepted
            return new and keeps and (below.has(one) or self._is_no_worse(one, bound))

        ranked = search.ranked(bound)
        good = (one for one in ranked if fits(one) and self.is_better(one, bound))
        known = next(good, None)
        if search.dearest is not None or not ranked or known is ranked[0]:
            return known
        dearest = known.price.ratio if known and known.price else math.inf
        if share_of(self.known) <= bound.limit:
            dearest = min(dearest, 1.0)
        best = ranked[0]
        assert best.price
        once = best.price.ratio * best.choice.multiple
        near = [(about, one.choice) for about, one in search.likely(bound)]
        near += [(once / choice.multiple, choice) for choice in search.shorter(best)]
        for about, choice in sorted(near, key=lambda pair: pair[0]):
            if about >= dearest or self._allowed.left < 0:
                break
            if fits(search.measured(choice)) and self.is_better(search.added(choice), bound):
                return search.added(choice)
        return known

    def _is_no_worse(self, tried: Tried, bound: Bound) -> bool:
        """Return whether something is as accurate as the model as written, at no longer steps.

        What becomes of longer ones tells nothing of it, if that model keeps the bound.
        """
        now, short = share_of(self.known), tried.choice.multiple <= self.known.choice.multiple
        return now <= bound.accepted and short and share_of(tried) <= SAME * now

    def _safest(self, done: set[Key], bound: Bound) -> Tried | None:
        """Return the cheapest that is as accurate as the model as written, if that is enough."""
        known = self.known
        assert known.error
        if self._search.dearest is not None or known.error.share > bound.limit:
            return None
        left = max(0.0, self._allowed.left - self.to_judge)
        for tried in self._search.safest(time.monotonic() + _SAFEST * left):
            new = tried.choice.key not in done
            if new and share_of(tried) <= bound.accepted and self.is_better(tried, bound):
                return tried
        return None

    def settings(self, choice: Choice) -> dict[str, object]:
        """Return what a choice sets, its step among it."""
        finer, step = self._subject.yards.finer, self._subject.yards.step
        found = differing(choice.settings, self._subject.model)
        if choice.multiple == finer:
            return found
        return {"timestep": float(f"{choice.multiple * step:.12g}"), **found}

    def _write(self, tried: Tried, folder: str) -> WrittenModel:
        choice = tried.choice
        edits = replace(self._subject.edits_of(choice.cuts), settings=self.settings(choice))
        return write_model(self._examined.scene, edits, self._session.folder / folder, MODEL)

    @cached_property
    def task(self) -> Task:
        """The task of seeds that no choice was made by, as many as the search had."""
        task = fresh(self._examined.task)
        if self._request.at is not None:
            task = task.model_copy(update={"watched": ()})
        return task.model_copy(update={"seeds": task.seeds[: self._subject.seeds]})

    @cached_property
    def motions(self) -> list[Motion]:
        """The task from fresh seeds."""
        return self._examined.motions_of(self.task)

    @cached_property
    def _judging(self) -> list[Motion]:
        """Fresh motions of as many seeds as the time allows to judge."""
        seeds = self._affordable(1.0, self._subject.seeds, len(self._search.bounds))
        return [first_seeds(motion, seeds) for motion in self.motions]

    def _affordable(self, work: float, most: int, answers: int = 1) -> int:
        """Return how many seeds each of several answers can be judged on, of so many at most."""
        left = max(0.0, self._allowed.left - self._allowed.takes(self._written))
        takes = self._allowed.takes(2 * work * self._seed_took + self._begun)
        return min(most, max(1, int(_VERDICTS * left / answers / takes)))

    @cached_property
    def _yards(self) -> Yardsticks:
        return Yardsticks.of(self._judging, self._subject.yards.finer, self._subject.threads)

    @cached_property
    def _measure(self) -> Measure:
        return self._subject.measure(self._yards, self._judging)

    @cached_property
    def _now(self) -> Apart:
        """Error of the model as written on fresh seeds."""
        return self._measure.apart(self._subject.model, self._subject.yards.finer)

    def _excess(self, error: Apart, wanted: Wanted) -> str:
        """Return why an error on fresh seeds is too large, or ""."""
        limit = self._limit_of(wanted)
        if self._search.dearest is not None or error.share <= limit:
            return ""
        return f"{self._text(error)} in {error.body}, limit {error_text(limit, self._aim.unit)}"

    def _judged(
        self, tried: Tried, error: Apart, written: WrittenModel, wanted: Wanted
    ) -> Verified:
        """Judge a written model, whose error is known, on seeds that no choice was made by."""
        self._session.notify(f"verifying {self._name(tried)}")
        request = ExamineRequest(written.reference, task=self._request.task, sections=("budget",))
        examined = open_model(request, self._session)
        work = self._work(tried)
        seeds = self.task.seeds[: self._affordable(work, self._judging[0].seeds)]
        task = self.task.model_copy(update={"seeds": seeds})
        judged, said = self._worst_of(examined, task, work)
        timely = self._search.dearest is not None
        holds, why = True, "sound, and within the limit"
        if said.word != "sound":
            holds = not wanted.sound and self._is_as_now(judged, said)
            why = f"{said.word}, as the model as written: {said.why}" if holds else said.why
        labels, unseen = self._new_labels(examined, task) if holds else ([], "")
        why += unseen
        if labels:
            holds, why = False, f"labelled {' and '.join(labels)}, as the model as written is not"
        if holds and "apart" in tried.choice.cuts and (touched := self._touched()):
            holds, why = False, f"{touched} touch, which stayed apart before"
        return Verified(
            seeds=seeds,
            holds=holds,
            keeps_aim=holds and (timely or error.share <= max(self._aim.limit, self._aim_now)),
            error=finite(error.share),
            now=finite(self._now.share),
            word=said.word,
            share=finite(said.share),
            labels=tuple(labels),
            sentence=why,
        )

    def _limit_of(self, wanted: Wanted) -> float:
        """Return the largest error on fresh seeds of what is wanted.

        What keeps a bound in the search as the model as written does is as good on these seeds.
        """
        own = self.known.error
        if own is not None and own.share <= wanted.bound.limit:
            return max(self._aim.limit, SAME * self._now.share)
        return wanted.bound.limit

    @property
    def _aim_now(self) -> float:
        """The error on fresh seeds of a model that kept the aim on those of the search."""
        own = self.known.error
        return SAME * self._now.share if own and own.share <= self._aim.limit else 0.0

    def _text(self, error: Apart) -> str:
        return error_text(error.share, self._aim.unit)

    def _worst_of(self, examined: CheckedModel, task: Task, work: float) -> tuple[Task, _Judgement]:
        """Return what the judge says on fresh seeds, or, if that is sound, on the search's.

        Those are what `contactlab FILE` judges by.
        """
        found = self._said_of(examined, task, work)
        if found.word != "sound":
            return task, found
        own = self._own_task(len(task.seeds))
        return own, self._said_of(examined, own, work)

    def _own_task(self, seeds: int) -> Task:
        """Return the task of the first seeds of the search."""
        task = self._examined.task
        return task.model_copy(update={"seeds": task.seeds[:seeds]})

    @cached_property
    def sound_now(self) -> bool:
        """Whether the judge calls the model as written sound, on all seeds that it is asked of."""
        seeds = self._judging[0].seeds
        unseen = self.task.model_copy(update={"seeds": self.task.seeds[:seeds]})
        return all(self._now_on(task).word == "sound" for task in (self._own_task(seeds), unseen))

    def judge_now(self) -> None:
        """Ask the judge of the model as written, of as many seeds as a tenth of the time allows."""
        task = self._examined.task
        takes = self._allowed.takes(self._seed_took)
        seeds = min(len(task.seeds), int(_JUDGING * self._request.max_time / takes))
        if seeds:
            self._now_on(self._own_task(seeds))

    def judged_now(self) -> Judged | None:
        """Return what the judge says of the model as written, of the most seeds that it knows."""
        task = self._examined.task
        known = [seeds for seeds in self._said_now if seeds == task.seeds[: len(seeds)]]
        if not known:
            return None
        seeds = max(known, key=len)
        said = self._said_now[seeds]
        return Judged(seeds=seeds, word=said.word, share=finite(said.share))

    def _is_as_now(self, task: Task, said: _Judgement) -> bool:
        """Return whether the judge says of the model as written what it says of another.

        The least share over that one's seeds is at most the largest over its own: what moves freely
        from the same starts goes other ways, and has another mean.
        """
        now = self._now_on(task)
        return now.word == said.word and said.low <= now.high

    def _now_on(self, task: Task) -> _Judgement:
        """Return what the judge says of the model as written, asked once of the same seeds."""
        if task.seeds not in self._said_now:
            self._said_now[task.seeds] = self._said_of(self._examined, task)
        return self._said_now[task.seeds]

    def _said_of(self, examined: CheckedModel, task: Task, work: float = 1.0) -> _Judgement:
        motions, begin = examined.motions_of(task), time.process_time()
        budget = error_budget(motions, rows=(), settings=_SETTINGS, workers=self._subject.threads)
        if work >= 1:  # of long steps, most is beside them
            self._seed_took = (time.process_time() - begin) / len(task.seeds) / work
        verdict = judge(budget, task.within)
        reason = verdict.reasons[0].sentence if verdict.reasons else "sound"
        return _Judgement(verdict.word, budget.share, *_spread(budget), reason)

    def _new_labels(self, examined: CheckedModel, task: Task) -> tuple[list[str], str]:
        """Return the labels of a written model's runs that those of the model as written have not.

        On fresh seeds, and on the task's own, of which `contactlab FILE` says its labels: on as
        many as there is time for. The second text says of how many of them none was looked for.
        """
        begin = time.monotonic()
        found = self._labels(examined, task)
        took = max(time.monotonic() - begin, 1e-6) / len(task.seeds)
        if new := found and found - self._now_labels(task):
            return sorted(new), ""
        own = self._examined.task.model_copy(update={"watched": task.watched})
        count = min(len(own.seeds), max(0, int(self._allowed.left / took)))
        if count:
            own = own.model_copy(update={"seeds": own.seeds[:count]})
            found = self._labels(examined, own)
            if new := found and found - self._now_labels(own):
                return sorted(new), ""
        if unseen := len(self._examined.task.seeds) - count:
            return [], f"; of {plural(unseen, 'seed')} of the task no time was left to see labels"
        return [], ""

    def _now_labels(self, task: Task) -> set[str]:
        """Return what runs of the model as written are labelled, made once of the same seeds."""
        if task.seeds not in self._labels_now:
            self._labels_now[task.seeds] = self._labels(self._examined, task)
        return self._labels_now[task.seeds]

    def _labels(self, examined: CheckedModel, task: Task) -> set[str]:
        """Return what the runs of a task are labelled."""
        with TemporaryDirectory(prefix="contactlab-") as folder:
            workers = self._session.workers if self._subject.one_pass > _WORTH_A_PROCESS else 0
            session = replace(self._session, folder=Path(folder), workers=workers)
            alone = replace(examined, session=session)
            runs = alone.run("labels", "Judged on fresh seeds", seeds=task.seeds)
            return {each.label for each in run_labels(task, [run.record for run in runs])}

    def _touched(self) -> str:
        """Return the first pair that touches on fresh seeds and stayed apart before, or ""."""
        model = self._subject.own_model
        runs = [part.positions for part in self._yards.parts]
        near, pairs = pairs_within(model, runs, 0.0), self._subject.pairs_apart
        pair = min(pairs if near is None else pairs & near, default=None)
        return " and ".join(geom_word(model, geom) for geom in pair) if pair else ""


def part_within(share: float | None, limit: float) -> float:
    """Return which part of a step, or of an error, may hold where the whole was not sound.

    What the judge sees is of first order in the step. Where it says no share, or not that alone is
    too large, a part is tried in any case.
    """
    return min(_MUCH_LESS, limit / share) if share else _MUCH_LESS


def work_of(model: mujoco.MjModel) -> float:
    """Return about how often a verdict evaluates a model's forces for one of its steps."""
    stages = _STAGES if model.opt.integrator == _RK4 else 1
    return stages * evaluations(model, _SETTINGS)


def _spread(budget: ErrorBudget) -> tuple[float, float]:
    """Return the least and largest share over seeds, of the worst phase."""
    seeds = max(budget.phases, key=lambda phase: phase.run.share).run.seeds
    return float(seeds.min()), float(seeds.max())
