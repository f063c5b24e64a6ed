"""From a model to the settings to use: the aim, the search, the written model, fresh seeds."""

import copy
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from shutil import rmtree

import mujoco

from contactlab.budget import Motion
from contactlab.errors import ExpectationError
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_edits import FLAGS, read_flag, read_option
from contactlab.scene.mujoco_versions import VERSION
from contactlab.schema.error_budget import BudgetPrice
from contactlab.schema.evidence import Setting
from contactlab.schema.tune_report import (
    FOLDER,
    FOLDER_AS_NOW,
    FOLDER_OF_AIM,
    REPORT,
    Aim,
    AimKind,
    Changed,
    FewerVertices,
    Kept,
    Line,
    OtherAnswer,
    Point,
    StayedApart,
    TuneReport,
)
from contactlab.store.table_layout import as_written
from contactlab.studies.examine.changes import fresh
from contactlab.studies.examine.examination import ExamineRequest, open_model
from contactlab.studies.search.allowed_time import AllowedTime
from contactlab.studies.search.answers import Answer, Answers, Wanted
from contactlab.studies.search.choice import differing
from contactlab.studies.search.clock import Clock
from contactlab.studies.search.exercise import joined_seeds
from contactlab.studies.search.forward import Growth, growth_of, joined_phases
from contactlab.studies.search.levers import integrators_of, levers_of, may_sleep
from contactlab.studies.search.searching import SAVES, Bound, Search, Space, Tried
from contactlab.studies.search.subject import OFFERED_APART, SEARCHING, Subject
from contactlab.studies.search.tune_request import TuneRequest, refuse_contradictions
from contactlab.studies.search.wording import finite, sentence_of
from contactlab.studies.session import Session

_LONGEST = 0.04  # s: steps of a window's length
_TIMING = 0.3  # of the time that is left, to time what is answered
_SEARCHED = 0.3  # of the time that is left, for a search at least, if a verdict may take the rest
_LOOKED = 0.1  # of it, in any case
_TURNS_APART = 5
_MORE_SEEDS = 6  # times as many seeds as the search has, for the clock, where seeds differ
_MUCH = 0.8  # ratio of times above which it is told what there is to save


def run(request: TuneRequest, session: Session, begin: float | None = None) -> TuneReport:
    """Search for the settings that meet an aim, write the model with them, and verify it.

    The folder receives `tune.json`, and the model if something is recommended. The time allowed
    began at `begin` on the clock of `time.monotonic`, by default now.

    Raises:
        SceneError: there is no such model, it does not compile, or nothing is called as watched.
        SweepFileError: the tolerance is no share, or options contradict each other.
        EngineError: nothing moves, or MuJoCo is not what simulates.
        ExpectationError: a forward error is asked for of a chaotic motion.
        OutputError: the folder cannot be written, or has another model's results.
    """
    allowed = AllowedTime(time.monotonic() if begin is None else begin, request.max_time)
    refuse_contradictions(request)
    session = replace(session, folder=session.folder.resolve())
    examined = open_model(
        ExamineRequest(request.model, task=request.task, sections=("budget",)), session
    )
    session.claim("tune", request.model)
    session.notify(f"tuning {request.model}: {examined.task.line}")
    subject = Subject(request, examined, max(1, session.workers), allowed)
    report = Study(request, session, subject, allowed).report()
    session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


class Study:
    """One model that is tuned."""

    def __init__(
        self,
        request: TuneRequest,
        session: Session,
        subject: Subject,
        allowed: AllowedTime,
    ) -> None:
        """Set up the search."""
        self._request, self._session, self._subject = request, session, subject
        self._allowed = allowed
        self._growth: Growth | None = None
        self._aim = self._aim_of()
        self._clock = Clock(subject.yards, subject.model)
        motions = subject.motions
        levers, kept = levers_of(subject.own_model, motions)
        self._kept = [*subject.kept, *kept]
        space = Space(
            subject.models,
            subject.start,
            subject.yards.finer,
            max(subject.yards.finer, round(_LONGEST / subject.yards.step)),
            levers,
            integrators_of(subject.own_model),
            subject.hulled,
            sleeps=may_sleep(subject.own_model),
        )
        measure = subject.measure(subject.yards, motions)
        search = Search(space, measure, self._clock, (), self._dearest(), math.inf)
        known = Tried(search.now, measure.apart(subject.model, search.now.multiple))
        self._wanted = self._all_wanted(known)
        search.tried[search.now.key] = known
        search.bounds = tuple(wanted.bound for wanted in self._wanted)
        self._search = search
        self._answers = Answers(request, session, subject, search, self._aim, allowed)

    def _aim_of(self) -> Aim:
        request, subject, unit = self._request, self._subject, "1"
        kind: AimKind = "uncertainty" if request.error is None else "error"
        if request.real_time is not None:
            kind = "real time"
        if request.at is not None:
            kind = "watched"
            self._growth = growth_of(joined_phases(subject.motions), subject.threads)
            if self._growth.chaotic:
                raise ExpectationError(
                    f"{request.model}: no forward error can be asked for, the motion is "
                    f"{self._growth.sentence}; leave --at out: the error budget has no such limit"
                )
            unit = subject.watched[0].unit
        uncertain = subject.uncertain
        by = "" if uncertain is None else f"{uncertain.body}, {uncertain.phase}"
        return Aim(
            kind=kind,
            limit=subject.limit,
            unit=unit,
            within=subject.examined.task.within,
            uncertain=uncertain.share if uncertain else None,
            uncertain_by=by,
            real_time=request.real_time,
            watched=tuple(request.watched) if request.at else (),
            at=request.at,
            growth=self._growth.sentence if self._growth else "",
        )

    def _dearest(self) -> float | None:
        if self._request.real_time is None:
            return None
        return 1 / (self._request.real_time * self._clock.base_seconds)

    def _all_wanted(self, known: Tried) -> list[Wanted]:
        """Return the answers that are wanted, in the order in which they are searched for.

        Where the model as written keeps the aim, one: the fastest that keeps it. Where it misses
        that, the fastest that is as accurate as now, too, which costs no more than now; and where
        it is beyond the tolerance, the fastest within that.
        """
        assert known.error
        aim, now = Bound.of(self._aim.limit), known.error.share
        if now <= aim.limit or self._request.real_time is not None:
            return [Wanted(aim.or_as_now(now), FOLDER)]
        as_now = Bound.as_now(now)
        if self._aim.kind != "uncertainty":
            return [Wanted(as_now, FOLDER_AS_NOW, sound=False), Wanted(aim, FOLDER)]
        within = Bound.of(self._aim.within)
        if now <= within.limit:
            return [Wanted(as_now, FOLDER), Wanted(aim, FOLDER_OF_AIM)]
        found = [Wanted(as_now, FOLDER_AS_NOW, sound=False), Wanted(within, FOLDER)]
        return [*found, Wanted(aim, FOLDER_OF_AIM)] if aim.limit < within.limit else found

    def report(self) -> TuneReport:
        """Search, write and verify what is found, and tell."""
        search, answers = self._search, self._answers
        answers.judge_now()
        search.deadline = self._end_of_search()
        search.run()
        known = answers.known
        if known.error is None or known.price is None:
            raise ExpectationError(
                f"{self._request.model}: {self._request.max_time:g} s are too short to measure the "
                "model as written; give more with --max-time"
            )
        for folder in (FOLDER, FOLDER_AS_NOW, FOLDER_OF_AIM):
            rmtree(self._session.folder / folder, ignore_errors=True)
        best, as_now, to_aim = self._answered()
        keeps = best is not None and best.verified.keeps_aim
        met = keeps or to_aim is not None or self._is_met(known)
        nearest = None if met else search.nearest(self._aim.limit, answers.failed)
        made = [answer for answer in (best, to_aim, as_now) if answer]
        used = any("unused" in answer.tried.choice.cuts for answer in made)
        edits = self._subject.exact if used else ModelEdits()
        report = TuneReport(
            model=self._request.model,
            scene_hash=self._subject.examined.scene.hash,
            mujoco=VERSION,
            task=self._subject.examined.task,
            aim=self._aim,
            sentence="",
            met=met,
            now=self._point(known),
            judged=answers.judged_now(),
            recommended=self._point(best.tried) if best else None,
            to_aim=self._other(to_aim),
            stayed_apart=self._stayed_apart([answer.tried for answer in made]),
            fewer_vertices=self._fewer_vertices(made),
            nearest=self._point(nearest) if nearest else None,
            binds=self._binds(nearest) if nearest else "",
            bare=self._bare(best.tried if best else None, as_now.tried if as_now else None),
            as_accurate=self._other(as_now),
            real_time=1 / self._clock.base_seconds,
            fine_step=self._subject.yards.step,
            points=tuple(self._point(one) for one in search.tried.values() if one.error),
            changes=tuple(self._changes(best.tried)) if best else (),
            masked=edits.masked,
            excluded=edits.excluded,
            sensors=edits.sensors,
            flags=edits.unflagged,
            kept=tuple(
                Kept(name=one.name, reason=one.reason) for one in (*self._kept, *answers.kept)
            ),
            verified=best.verified if best else None,
            file=self._file(best) if best else None,
            lines=tuple(Line(**vars(change)) for change in best.written.changes) if best else (),
            ended=search.ended,
            seconds=time.monotonic() - self._allowed.begin,
        )
        return report.model_copy(update={"sentence": sentence_of(report)})

    def _end_of_search(self) -> float:
        """Return when the search ends, on the clock of `time.monotonic`: verdicts are to follow."""
        allowed, one = self._allowed, self._answers.to_judge
        left, own = allowed.left, allowed.begin + SEARCHING * allowed.seconds
        least = max(min(_SEARCHED * left, left - one), _LOOKED * left)
        return min(own, time.monotonic() + max(least, left - len(self._wanted) * one))

    def _answered(self) -> tuple[Answer | None, Answer | None, Answer | None]:
        """Return what is recommended, what is as accurate as now, and what keeps the aim beside."""
        by_folder = {wanted.folder: wanted for wanted in self._wanted}
        best = self._answer(by_folder[FOLDER], len(self._wanted) - 1)
        as_now = to_aim = None
        own = by_folder.get(FOLDER_AS_NOW)
        late = self._allowed.left < self._answers.to_judge
        if own is None and best is None and not late and not self._answers.sound_now:
            own = Wanted(by_folder[FOLDER].bound, FOLDER_AS_NOW, sound=False)
        aim = None if best and best.verified.keeps_aim else by_folder.get(FOLDER_OF_AIM)
        if own and not (best and self._is_as_good(best.tried, own.bound)):
            as_now = self._answer(own, later=1 if aim else 0)
        if aim:
            to_aim = self._answer(aim)
        return best, as_now, to_aim

    def _answer(self, wanted: Wanted, later: int = 0) -> Answer | None:
        """Return the best that holds, timed until that is claimed; None if that is no better.

        So many answers come later.
        """
        found = self._answers.of(wanted, later)
        if found:
            self._time_closely(found.tried)
            if not self._answers.is_better(found.tried, wanted.bound):
                self._answers.drop(wanted)
                return None
        return found

    def _is_as_good(self, tried: Tried, bound: Bound) -> bool:
        """Return whether something costs no more than what keeps another bound."""
        other = next(iter(self._search.ranked(bound)), None)
        assert tried.price
        return other is None or (
            other.price is not None and tried.price.ratio <= other.price.ratio / SAVES
        )

    def _is_met(self, known: Tried) -> bool:
        assert known.error
        if self._search.dearest is not None:
            return self._search.dearest >= 1
        return known.error.share <= self._aim.limit

    def _time_closely(self, tried: Tried) -> None:
        """Time a choice on whole runs, beside the model as written, which is timed once more."""
        both = [self._answers.known, tried]
        models = [(self._search.space.made(one.choice), one.choice.multiple) for one in both]
        until = time.monotonic() + _TIMING * self._allowed.left
        prices = self._clock.whole(models, self._timed_tasks(), until)
        for one, price in zip(both, prices, strict=True):
            one.price = price

    def _timed_tasks(self) -> Iterator[Sequence[Motion]]:
        """Yield the task by seeds of the search and fresh ones, then again and again by others."""
        own, unseen = self._subject.motions, self._answers.motions
        yield [joined_seeds(*pair) for pair in zip(own, unseen, strict=True)]
        task = self._answers.task
        for _ in range(_MORE_SEEDS):
            task = fresh(task)
            yield self._subject.examined.motions_of(task)

    def _file(self, answer: Answer) -> str:
        return str(answer.written.path.relative_to(self._session.folder))

    def _other(self, answer: Answer | None) -> OtherAnswer | None:
        return answer and OtherAnswer(
            point=self._point(answer.tried),
            changes=tuple(self._changes(answer.tried)),
            verified=answer.verified,
            file=self._file(answer),
        )

    def _stayed_apart(self, made: Sequence[Tried]) -> StayedApart | None:
        """Return what stayed apart, and what leaving it out saves of the first that was made."""
        asked, price = self._request.apart is not None, None
        subject = self._subject
        if not asked and self._allowed.left < 0:
            return None
        sparser = subject.sparser()
        if sparser is None or (asked and not any("apart" in one.choice.cuts for one in made)):
            return None
        if not asked:
            choice = made[0].choice if made else self._search.now
            before = self._search.space.made(choice)
            own, without = self._clock.prices(
                [(each, choice.multiple) for each in (before, choice.made(sparser))], _TURNS_APART
            )
            price = BudgetPrice(
                ratio=without.ratio / own.ratio,
                low=without.low / own.ratio,
                high=without.high / own.ratio,
            )
        return StayedApart(
            margin=self._request.apart or OFFERED_APART,
            geoms=subject.apart.masked,
            bodies=subject.apart.excluded,
            left_out=asked,
            price=price,
        )

    def _fewer_vertices(self, made: Sequence[Answer]) -> FewerVertices | None:
        if not any("hulls" in answer.tried.choice.cuts for answer in made):
            return None
        assert self._request.hulls is not None
        return FewerVertices(within=self._request.hulls, meshes=dict(self._subject.hull_vertices))

    def _binds(self, nearest: Tried) -> str:
        """Say which body, when, and which row keeps the aim from being met."""
        error = nearest.error
        assert error
        if self._search.dearest is not None:
            return "nothing that was tried is fast enough"
        where = f"{error.body} at {error.time:.2f} s of {error.phase}"
        if self._allowed.left < 0:
            return where
        row = "the timestep"
        made = self._search.space.made(nearest.choice)
        made.opt.iterations, made.opt.tolerance = max(100, made.opt.iterations), 1e-12
        made.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
        done = self._search.measure.apart(made, nearest.choice.multiple)
        if done.share < 0.5 * error.share:
            row = "the solver"
        return f"{where}, by {row}"

    def _bare(self, *made: Tried | None) -> BudgetPrice | None:
        """Time the model without constraints, unless something that was made saves a fifth."""
        saving = [one.price and one.price.ratio < _MUCH for one in made if one]
        if any(saving) or self._search.dearest is not None or self._allowed.left < 0:
            return None
        now = self._search.now
        own = self._search.space.made(now)
        bare = copy.copy(own)
        bare.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        price = self._clock.compared((bare, now.multiple), (own, now.multiple), _TURNS_APART)
        return BudgetPrice(ratio=price.ratio, low=price.low, high=price.high)

    def _changes(self, chosen: Tried) -> Iterator[Changed]:
        model = self._subject.model
        for name, after in self._answers.settings(chosen.choice).items():
            before: object
            if name in FLAGS:
                before = read_flag(model, name)
            elif "[" in name:
                geom = name.partition("[")[2].removesuffix("]")
                before = int(model.geom(geom).condim[0])
            else:
                before = read_option(model, name)
            yield Changed(name=name, before=as_written(before), after=as_written(after))

    def _point(self, tried: Tried) -> Point:
        error, price, choice = tried.error, tried.price, tried.choice
        assert error
        own = differing(choice.settings, self._subject.model)
        settings: dict[str, Setting] = {name: as_written(value) for name, value in own.items()}
        return Point(
            settings=settings,
            timestep=float(f"{choice.multiple * self._subject.yards.step:.12g}"),
            lighter="unused" in choice.cuts,
            apart="apart" in choice.cuts,
            hulls="hulls" in choice.cuts,
            error=finite(error.share),
            low=finite(error.low),
            high=finite(error.high),
            body=error.body,
            phase=error.phase,
            time=finite(error.time),
            price=price and BudgetPrice(ratio=price.ratio, low=price.low, high=price.high),
        )
