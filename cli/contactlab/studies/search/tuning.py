"""From a model to the settings to use: the aim, the search, the written model, fresh seeds."""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory

import mujoco

from contactlab.budget import Motion, Settings, error_budget, judge
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.windows import replay
from contactlab.errors import EngineError, ExpectationError, SceneError, SweepFileError
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.printable import percent
from contactlab.scene.model_draft import CompiledFiles, ModelEdits, edit_spec
from contactlab.scene.model_edits import FLAGS, read_flag, read_option
from contactlab.scene.model_names import name_of
from contactlab.scene.model_writer import WrittenModel, write_model
from contactlab.scene.mujoco_versions import VERSION
from contactlab.scene.unreachable import GeomPair, filtered_pairs
from contactlab.schema.error_budget import BudgetPrice
from contactlab.schema.evidence import Setting
from contactlab.schema.task import Task
from contactlab.schema.tune_report import (
    FOLDER,
    FOLDER_OF_AIM,
    MODEL,
    REPORT,
    Aim,
    AimKind,
    Changed,
    Kept,
    Line,
    Point,
    StayedApart,
    ToAim,
    TuneReport,
    Verified,
)
from contactlab.store.table_layout import as_written
from contactlab.studies.check.checked_model import CheckedModel
from contactlab.studies.examine.changes import fresh
from contactlab.studies.examine.examination import ExamineRequest, open_model
from contactlab.studies.search.choice import Choice, described
from contactlab.studies.search.clock import Clock
from contactlab.studies.search.exercise import doubled, joined_seeds, positions_of, tilted
from contactlab.studies.search.forward import (
    ForwardError,
    Growth,
    Watched,
    When,
    growth_of,
    joined_phases,
)
from contactlab.studies.search.levers import Unsearched, integrators_of, levers_of
from contactlab.studies.search.searching import SAME, SAVES, Bound, Measure, Search, Space, Tried
from contactlab.studies.search.unused_pairs import (
    left_out,
    pairs_within,
    sensors_of,
    untouched_geoms,
)
from contactlab.studies.search.yardstick import Apart, Yardsticks
from contactlab.studies.session import Session
from contactlab.studies.task_verdict import run_labels

LEAST_AIM = 0.01
"""The error that is small enough for any model, as a share."""
_SEARCHING = 0.6  # of the time allowed; the rest is for files, fresh seeds and the clock
OFFERED_APART = 0.05
"""m: a distance of which is told what leaving out collisions would save."""
_FINER = (2, 4, 8, 16)
_RESOLVED = 0.2  # share of the limit that the fine motion's own error may have
_LONGEST = 0.04  # s: steps of a window's length
_PASSES = 80  # times that a search simulates the task, about
_JUDGED = 60  # times that two verdicts simulate it: references, their check and RK4, and itself
_OPENINGS = 3  # times that a written model is compiled, compared and opened, in openings of the own
_SPARSEST = 4  # at least one in so many windows is looked at
_MOST_TRIES, _CLOSELY = 5, 2
_LESS, _MUCH_LESS = 0.95, 0.6
_TIMING = 0.3  # of the time that is left, for the clock
_TURNS_APART = 5


@dataclass(frozen=True)
class TuneRequest:
    """Which model to tune, and for what.

    Attributes:
        model: a scene, its folder, a model file, or a robot.
        task: what replaces parts of the model's own; of its limits, only the tolerance.
        error: largest error: a share, or of what is watched in its unit; None for what the model is
            uncertain by.
        real_time: the most accurate settings at so many times real time are wanted instead.
        watched: bodies, sites and sensors whose forward error counts.
        at: when that is looked at; None for the error budget.
        max_time: wall time that it may take [s].
        drop_sensors: whether sensors may go, since nobody reads them.
        apart: distance [m]: collisions of what stayed so far apart in all that was run may go.
    """

    model: str
    task: TaskOptions = AS_INFERRED
    error: float | None = None
    real_time: float | None = None
    watched: Sequence[str] = ()
    at: When | None = None
    max_time: float = 120.0
    drop_sensors: bool = False
    apart: float | None = None


def run(request: TuneRequest, session: Session) -> TuneReport:
    """Search for the settings that meet an aim, write the model with them, and verify it.

    The folder receives `tune.json`, and the model if something is recommended.

    Raises:
        SceneError: there is no such model, it does not compile, or nothing is called as watched.
        SweepFileError: the tolerance is no share, or options contradict each other.
        EngineError: nothing moves, or MuJoCo is not what simulates.
        ExpectationError: a forward error is asked for of a chaotic motion.
        OutputError: the folder cannot be written, or has another model's results.
    """
    begin = time.monotonic()
    refuse_contradictions(request)
    session = replace(session, folder=session.folder.resolve())
    examined = open_model(
        ExamineRequest(request.model, task=request.task, sections=("budget",)), session
    )
    session.claim("tune", request.model)
    study = Study(request, session, examined, begin)
    report = study.report()
    session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


def refuse_contradictions(request: TuneRequest) -> None:
    """Refuse options of which one would be ignored."""
    refuse_metrics(request.task)
    if request.real_time is not None and request.error is not None:
        raise SweepFileError("--real-time asks for the least error; leave --error out")
    if request.at is not None and not request.watched:
        raise SweepFileError("--at needs what is watched: --watch BODY, SITE or SENSOR")
    if request.at is not None and request.error is None:
        raise SweepFileError("--at needs the largest forward error: --error 1e-5")
    if request.at is None and request.error is not None and not 0 < request.error < 1:
        raise SweepFileError(
            f"--error {request.error:g} is no share of the real forces; write 2%, or what is "
            "watched and when: --watch hand --at end --error 1e-5"
        )


def refuse_metrics(task: TaskOptions) -> None:
    """Refuse tolerances of metrics, which the error budget would not heed."""
    if task.limits:
        name = next(iter(task.limits))
        raise SweepFileError(
            f"--within {name}=: settings are judged by the error budget; write a share, "
            "--within 5%, or weigh metrics with a sweep: contactlab tradeoff SWEEP"
        )


class Study:
    """One model that is tuned."""

    def __init__(
        self, request: TuneRequest, session: Session, examined: CheckedModel, begin: float
    ) -> None:
        """Measure how long the model takes, what it is uncertain by, and what changes no state."""
        self._request, self._session, self._examined = request, session, examined
        self._begin, self._deadline = begin, begin + request.max_time
        self._opening = time.monotonic() - begin
        self._threads = max(1, session.workers)
        session.notify(f"tuning {request.model}: {examined.task.line}")
        task = examined.task
        if request.at is not None:
            task = task.model_copy(update={"watched": ()})
        self._motions = self._affordable(examined.motions_of(task))
        self._growth: Growth | None = None
        self._model = self._compiled(ModelEdits())
        self._kept = list[Unsearched]()
        self._yards, uncertain = self._resolved()
        self._aim = self._aim_of(uncertain)
        self._edits, lighter = self._without_what_is_unused()
        self._clock = Clock(self._yards, self._model)
        levers, kept = levers_of(self._motions[0].model, self._motions)
        self._kept += kept
        self._apart = ModelEdits()
        self._watched_pairs = self._pairs_apart(request.apart or OFFERED_APART)
        sparser = self._sparser() if request.apart else None
        space = Space(
            self._model,
            lighter,
            sparser,
            self._yards.finer,
            max(self._yards.finer, round(_LONGEST / self._yards.step)),
            levers,
            integrators_of(self._motions[0].model),
        )
        measure, now = self._measure(), Choice({}, self._yards.finer)
        known = Tried(now, measure.apart(self._model, now.multiple))
        deadline = min(begin + _SEARCHING * request.max_time, self._deadline - self._to_judge())
        self._bounds = self._bounds_of(known)
        self._search = Search(
            space, measure, self._clock, self._bounds, self._dearest(), deadline, {now.key: known}
        )

    def _bounds_of(self, known: Tried) -> list[Bound]:
        """Return what the error has to keep; both, where the model as written misses the aim."""
        assert known.error
        asked, now = Bound.of(self._aim.limit), known.error.share
        as_now = asked.or_as_now(now, self._aim.within if self._aim.unit == "1" else now)
        if now <= asked.limit:
            return [as_now]
        return [as_now, asked] if self._aim.kind == "uncertainty" else [asked]

    def _to_judge(self) -> float:
        """Return how long it takes to write a model and judge it on one seed, about [s]."""
        return (self._yards.finer + _JUDGED) * self._pass + _OPENINGS * self._opening

    def _affordable(self, motions: Sequence[Motion]) -> list[Motion]:
        """Return motions of as many seeds as the time allows to simulate, all windows or fewer."""
        begin = time.monotonic()
        for motion in motions:
            replay(motion, 1.0, self._threads)
        self._pass = (time.monotonic() - begin) / motions[0].seeds
        allowed = _SEARCHING * self._request.max_time / _PASSES
        seeds = min(motions[0].seeds, max(1, int(_SPARSEST * allowed / self._pass)))
        self._every = min(_SPARSEST, max(1, math.ceil(seeds * self._pass / allowed)))
        return [
            replace(motion, starts=motion.starts[:seeds], inputs=motion.inputs[:seeds])
            for motion in motions
        ]

    @property
    def _seeds(self) -> int:
        return self._motions[0].seeds

    def _compiled(self, edits: ModelEdits) -> mujoco.MjModel:
        """Return the model of the scene's files, without what records runs."""
        scene = self._examined.scene.with_effects("all")
        values = self._examined.values
        files = CompiledFiles.of(scene, scene.source, values, lambda spec: edit_spec(spec, edits))
        size = mujoco.mj_stateSize(files.model, INTEGRATION)
        own = self._motions[0].model
        if size != mujoco.mj_stateSize(own, INTEGRATION):
            return own
        return files.model

    def _resolved(self) -> tuple[Yardsticks, Apart | None]:
        """Return yardsticks that are fine enough, and what the model is uncertain by."""
        coarse = Yardsticks.of(self._motions, 1, self._threads, self._every)
        own = self._motions[0].model
        if not coarse.known:
            finest = Yardsticks.of(self._motions, 8, self._threads, self._every)
            if not finest.known:
                raise EngineError(
                    f"{self._request.model}: MuJoCo gives up even at an eighth of the timestep; "
                    f"contactlab {self._request.model} says why"
                )
            return finest, finest.uncertain()
        uncertain = coarse.uncertain()
        limit = self._limit(uncertain)
        if self._request.at is not None or self._request.real_time is not None:
            limit = LEAST_AIM
        # Between one and two steps lies what one step is from the limit, in first order.
        first = coarse.parts[0].apart(own, 2) if len(coarse.parts) == 1 else coarse.apart(own, 2)
        needed = first.share / (_RESOLVED * limit)
        cost = self._pass * self._seeds
        allowed = 0.15 * self._request.max_time / max(cost, 1e-6)
        finer = next((rate for rate in _FINER if rate >= needed), _FINER[-1])
        finer = max(rate for rate in _FINER if rate <= max(_FINER[0], min(finer, allowed)))
        fine = Yardsticks.of(self._motions, finer, self._threads, self._every)
        return (fine, uncertain) if fine.known else (coarse, uncertain)

    def _limit(self, uncertain: Apart | None) -> float:
        within = self._examined.task.within
        if self._request.error is not None:
            return self._request.error if self._request.at else min(self._request.error, within)
        return min(within, max(LEAST_AIM, uncertain.share if uncertain else 0.0))

    def _aim_of(self, uncertain: Apart | None) -> Aim:
        request, unit = self._request, "1"
        kind: AimKind = "uncertainty" if request.error is None else "error"
        if request.real_time is not None:
            kind = "real time"
        if request.at is not None:
            kind = "watched"
            self._growth = growth_of(joined_phases(self._motions), self._threads)
            if self._growth.chaotic:
                raise ExpectationError(
                    f"{request.model}: no forward error can be asked for, the motion is "
                    f"{self._growth.sentence}; leave --at out: the error budget has no such limit"
                )
            unit = self._watched[0].unit
        by = "" if uncertain is None else f"{uncertain.body}, {uncertain.phase}"
        return Aim(
            kind=kind,
            limit=self._limit(uncertain),
            unit=unit,
            within=self._examined.task.within,
            uncertain=uncertain.share if uncertain else None,
            uncertain_by=by,
            real_time=request.real_time,
            watched=tuple(request.watched) if request.at else (),
            at=request.at,
            growth=self._growth.sentence if self._growth else "",
        )

    @cached_property
    def _watched(self) -> list[Watched]:
        return [Watched.of(self._model, name) for name in self._request.watched]

    def _measure(self) -> Measure:
        request = self._request
        if request.at is None:
            return self._yards
        return ForwardError(
            self._motions, self._yards.finer, self._watched, request.at, self._threads
        )

    def _dearest(self) -> float | None:
        if self._request.real_time is None:
            return None
        return 1 / (self._request.real_time * self._clock.base_seconds)

    def _without_what_is_unused(self) -> tuple[ModelEdits, mujoco.MjModel | None]:
        """Return what changes no state, and the model without it: it moves bit for bit the same."""
        model, scene = self._model, self._examined.scene
        runs = [part.positions for part in self._yards.parts]
        edits = untouched_geoms(model, runs)
        flags = unread_flags(scene.source.model)
        self._model = with_flags(model, flags)
        edits = replace(edits, unflagged=flags)
        if self._request.drop_sensors:
            edits = replace(edits, sensors=sensors_of(model))
        elif sensors_of(model):
            reason = "your code may read them; --drop-sensors leaves them out"
            self._kept.append(Unsearched("sensors", reason))
        if edits == ModelEdits():
            return edits, None
        try:
            lighter = self._compiled(edits)
        except SceneError as error:
            self._kept.append(Unsearched("collisions that cannot be", str(error).splitlines()[0]))
            return ModelEdits(), None
        for motion in self._motions:
            length = motion.steps * float(motion.model.opt.timestep)
            one, two = (
                replay(replace(motion, model=each), length, self._threads).kept
                for each in (motion.model, lighter)
            )
            if one.tobytes() != two.tobytes():
                self._kept.append(Unsearched("collisions that cannot be", "the motion differs"))
                return ModelEdits(), None
        return edits, lighter

    def _pairs_apart(self, distance: float) -> frozenset[GeomPair]:
        """Return pairs of geoms that never came so near [m], and remember what leaves them out."""
        model = self._motions[0].model
        moved = [*map(tilted, self._motions), *map(doubled, self._motions)]
        runs = [part.positions for part in self._yards.parts]
        near = pairs_within(model, [*runs, *positions_of(moved, self._threads)], distance)
        if near is None:
            return frozenset()
        pairs = filtered_pairs(model)
        found = frozenset(pair for pair in pairs if pair not in near)
        edits = left_out(model, pairs, found)
        # What is proved stands first, and is told apart from this.
        proved = {*self._edits.masked}, {*self._edits.excluded}
        self._apart = ModelEdits(
            masked=tuple(geom for geom in edits.masked if geom not in proved[0]),
            excluded=tuple(pair for pair in edits.excluded if pair not in proved[1]),
        )
        return found

    def _sparser(self) -> mujoco.MjModel | None:
        """Return the model without collisions of what stayed apart, or None."""
        if not (self._apart.masked or self._apart.excluded):
            return None
        try:
            return self._compiled(self._edits_of(light=True, apart=True))
        except SceneError as error:
            self._kept.append(Unsearched("what stayed apart", str(error).splitlines()[0]))
            self._apart = ModelEdits()
            return None

    def _edits_of(self, *, light: bool, apart: bool) -> ModelEdits:
        edits = self._edits if light else ModelEdits()
        if apart:
            edits = replace(
                edits,
                masked=(*edits.masked, *self._apart.masked),
                excluded=(*edits.excluded, *self._apart.excluded),
            )
        return edits

    def _stayed_apart(self, made: Sequence[Tried]) -> StayedApart | None:
        """Return what stayed apart, and what leaving it out saves of the first that was made."""
        asked, price = self._request.apart is not None, None
        choice = made[0].choice if made else self._search.now
        sparser = self._search.space.sparser if asked else self._sparser()
        if sparser is None or (asked and not any(one.choice.apart for one in made)):
            return None
        if not asked:
            if time.monotonic() > self._deadline:
                return None
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
            geoms=self._apart.masked,
            bodies=self._apart.excluded,
            left_out=asked,
            price=price,
        )

    def report(self) -> TuneReport:
        """Search, write and verify what is found, and tell."""
        search = self._search
        search.run()
        known = search.tried[search.now.key]
        if known.error is None or known.price is None:
            raise ExpectationError(
                f"{self._request.model}: {self._request.max_time:g} s are too short to measure the "
                "model as written; give more with --max-time"
            )
        self._timed_closely(known)
        best, *stricter = self._bounds
        rmtree(self._session.folder / FOLDER_OF_AIM, ignore_errors=True)
        chosen, written, verified = self._verified(known, best, FOLDER)
        kept, to_aim = None, None
        keeps = verified is not None and verified.keeps_aim
        if stricter and not keeps:
            kept, to_aim = self._to_aim(known, stricter[0])
        met = keeps or to_aim is not None or self._is_met(known)
        point = self._point(chosen) if chosen else None
        nearest = None if met else search.nearest()
        binds = self._binds(nearest) if nearest else ""
        made = [one for one in (chosen, kept) if one]
        edits = self._edits if any(one.choice.light for one in made) else ModelEdits()
        return TuneReport(
            model=self._request.model,
            scene_hash=self._examined.scene.hash,
            mujoco=VERSION,
            task=self._examined.task,
            aim=self._aim,
            sentence=self._sentence(known, chosen, verified, nearest, binds, to_aim),
            met=met,
            now=self._point(known),
            recommended=point,
            to_aim=to_aim,
            stayed_apart=self._stayed_apart(made),
            nearest=self._point(nearest) if nearest else None,
            binds=binds,
            as_accurate=self._as_accurate(known, chosen),
            real_time=1 / self._clock.base_seconds,
            fine_step=self._yards.step,
            points=tuple(self._point(one) for one in search.tried.values() if one.error),
            changes=tuple(self._changes(chosen)) if chosen else (),
            masked=edits.masked,
            excluded=edits.excluded,
            sensors=edits.sensors,
            flags=edits.unflagged,
            kept=tuple(Kept(name=one.name, reason=one.reason) for one in self._kept),
            verified=verified,
            file=str(written.path.relative_to(self._session.folder)) if written else None,
            lines=tuple(Line(**vars(change)) for change in written.changes) if written else (),
            ended=search.ended,
            seconds=time.monotonic() - self._begin,
        )

    def _is_met(self, known: Tried) -> bool:
        assert known.error
        if self._search.dearest is not None:
            return self._search.dearest >= 1
        return known.error.share <= self._aim.limit

    def _to_aim(self, known: Tried, bound: Bound) -> tuple[Tried | None, ToAim | None]:
        """Return the fastest that keeps the aim, which the model as written misses."""
        tried, written, verified = self._verified(known, bound, FOLDER_OF_AIM)
        if not (tried and written and verified):
            return None, None
        return tried, ToAim(
            point=self._point(tried),
            changes=tuple(self._changes(tried)),
            verified=verified,
            file=str(written.path.relative_to(self._session.folder)),
        )

    def _verified(
        self, known: Tried, bound: Bound, folder: str
    ) -> tuple[Tried | None, WrittenModel | None, Verified | None]:
        """Write what is best until one holds on fresh seeds; nothing if none is better than now."""
        done, limit = {known.choice.key}, math.inf
        for number in range(_MOST_TRIES):
            late = time.monotonic() + self._to_judge() > self._deadline
            if late and (number or folder != FOLDER):
                self._kept.append(Unsearched(folder, "no time was left to judge what is next best"))
                break
            tried = self._next(done, limit, bound)
            if tried is None or not self._is_better(tried, known, bound):
                break
            done.add(tried.choice.key)
            name = described(self._settings(tried.choice)) or "without what changes no state"
            try:
                written = self._write(tried, folder)
            except SceneError as error:
                self._kept.append(Unsearched(name, str(error).splitlines()[0]))
                continue
            found = self._judged(tried, written, bound)
            if found.holds:
                return tried, written, found
            self._kept.append(Unsearched(name, f"on fresh seeds: {found.sentence}"))
            limit = self._limit_after(tried, found, bound)
        rmtree(self._session.folder / folder, ignore_errors=True)
        return None, None, None

    def _limit_after(self, tried: Tried, found: Verified, bound: Bound) -> float:
        """Return the error in the search of what is to hold, after what does not: in proportion."""
        assert tried.error
        own = tried.error.share
        if found.word == "sound" and found.error and not found.labels:
            return _LESS * own * min(1.0, bound.limit / found.error)
        return _MUCH_LESS * own

    def _next(self, done: set[tuple[object, ...]], limit: float, bound: Bound) -> Tried | None:
        """Return the best that was not verified yet, of such an error; or at a shorter step."""

        def fits(one: Tried) -> bool:
            small = one.error is not None and one.error.share <= limit
            return one.choice.key not in done and small

        ranked = self._search.ranked(bound)
        if found := next(filter(fits, ranked), None):
            return found
        if self._search.dearest is not None or not ranked or math.isinf(limit):
            return None
        for choice in self._search.shorter(ranked[0]):
            if fits(tried := self._search.added(choice)):
                return tried
        return None

    def _timed_closely(self, known: Tried) -> None:
        """Time the best once more, on whole runs, and the model as written beside itself."""
        timed = [known]
        for bound in self._bounds:
            new = [one for one in self._search.ranked(bound) if one not in timed]
            timed += new[:_CLOSELY]
        models = [(self._search.space.made(one.choice), one.choice.multiple) for one in timed]
        left = self._deadline - time.monotonic()
        share = min(_TIMING * left, left - self._to_judge())
        until = time.monotonic() + max(share, 0)
        motions = [joined_seeds(*pair) for pair in zip(self._motions, self._fresh, strict=True)]
        for one, price in zip(timed, self._clock.whole(models, motions, until), strict=True):
            one.price = price

    def _is_better(self, tried: Tried, known: Tried, bound: Bound) -> bool:
        """Return whether something serves a bound better than the model as written."""
        assert tried.error
        assert tried.price
        assert known.error
        if self._search.dearest is not None:
            if self._search.dearest < 1:
                return True
            return tried.error.share < SAVES * known.error.share
        if known.error.share > bound.limit:
            return True
        return tried.price.high < 1 and tried.price.ratio < SAVES

    def _step(self, choice: Choice) -> float:
        return float(f"{choice.multiple * self._yards.step:.12g}")

    def _settings(self, choice: Choice) -> dict[str, object]:
        step = {} if choice.multiple == self._yards.finer else {"timestep": self._step(choice)}
        return {**step, **choice.settings}

    def _write(self, tried: Tried, folder: str) -> WrittenModel:
        edits = replace(
            self._edits_of(light=tried.choice.light, apart=tried.choice.apart),
            settings=self._settings(tried.choice),
        )
        return write_model(self._examined.scene, edits, self._session.folder / folder, MODEL)

    @cached_property
    def _fresh_task(self) -> Task:
        """The task of seeds that no choice was made by, as many as the search had."""
        task = fresh(self._examined.task)
        if self._request.at is not None:
            task = task.model_copy(update={"watched": ()})
        return task.model_copy(update={"seeds": task.seeds[: self._seeds]})

    @cached_property
    def _fresh(self) -> list[Motion]:
        return self._examined.motions_of(self._fresh_task)

    @cached_property
    def _fresh_yards(self) -> Yardsticks:
        return Yardsticks.of(self._judging, self._yards.finer, self._threads)

    @cached_property
    def _judging(self) -> list[Motion]:
        """Fresh motions of as many seeds as the time allows to judge."""
        passes = self._yards.finer + _JUDGED
        left = max(0.0, self._deadline - time.monotonic() - _OPENINGS * self._opening)
        left /= len(self._bounds)
        seeds = min(self._seeds, max(1, int(left / (passes * self._pass))))
        return [
            replace(motion, starts=motion.starts[:seeds], inputs=motion.inputs[:seeds])
            for motion in self._fresh
        ]

    @cached_property
    def _fresh_now(self) -> Apart:
        """Error of the model as written on fresh seeds."""
        return self._fresh_measure.apart(self._model, self._yards.finer)

    @cached_property
    def _fresh_measure(self) -> Measure:
        if self._request.at is None:
            return self._fresh_yards
        return ForwardError(
            self._judging, self._yards.finer, self._watched, self._request.at, self._threads
        )

    def _judged(self, tried: Tried, written: WrittenModel, bound: Bound) -> Verified:
        """Judge a written model, and measure it, on seeds that no choice was made by."""
        self._session.notify(f"verifying {described(self._settings(tried.choice)) or 'the model'}")
        made, multiple = self._search.space.made(tried.choice), tried.choice.multiple
        now, error = self._fresh_now, self._fresh_measure.apart(made, multiple)
        task = self._fresh_task
        task = task.model_copy(update={"seeds": task.seeds[: self._judging[0].seeds]})
        request = ExamineRequest(written.reference, task=self._request.task, sections=("budget",))
        examined = open_model(request, self._session)
        judged, (word, share, why) = self._worst_word(examined, task)
        # What keeps a bound in the search as the model as written does is as good on these seeds.
        own = self._search.tried[self._search.now.key].error
        as_now = own is not None and own.share <= bound.limit
        limit = max(self._aim.limit, SAME * now.share) if as_now else bound.limit
        timely = self._search.dearest is not None
        holds = timely or error.share <= limit
        if not holds:
            why = f"{self._text(error.share)} in {error.body}, limit {self._text(limit)}"
        elif word != "sound":
            holds = error.share <= SAME * now.share and self._word_now(judged) == word
            why = f"{word}, as the model as written: {why}" if holds else why
        else:
            why = "sound, and within the limit"
        labels = sorted(self._labels(examined, task) - self._labels_now) if holds else ()
        if labels:
            holds, why = False, f"labelled {' and '.join(labels)}, as the model as written is not"
        if holds and tried.choice.apart and (touched := self._touched()):
            holds, why = False, f"{touched} touch, which stayed apart before"
        return Verified(
            seeds=task.seeds,
            holds=holds,
            keeps_aim=holds and (timely or error.share <= max(self._aim.limit, self._aim_now(own))),
            error=_finite(error.share),
            now=_finite(now.share),
            word=word,
            share=_finite(share),
            labels=tuple(labels),
            sentence=why,
        )

    def _worst_word(
        self, examined: CheckedModel, task: Task
    ) -> tuple[Task, tuple[str, float, str]]:
        """Return what the judge says on a task's seeds, or, if that is sound, on the search's.

        Those are what `contactlab FILE` judges by.
        """
        fresh_word = self._word(examined, task)
        if fresh_word[0] != "sound":
            return task, fresh_word
        own = self._examined.task
        own = own.model_copy(update={"seeds": own.seeds[: len(task.seeds)]})
        return own, self._word(examined, own)

    @cached_property
    def _labels_now(self) -> set[str]:
        seeds = self._fresh_task.seeds[: self._judging[0].seeds]
        return self._labels(self._examined, self._fresh_task.model_copy(update={"seeds": seeds}))

    def _labels(self, examined: CheckedModel, task: Task) -> set[str]:
        """Return what the runs of a task are labelled."""
        with TemporaryDirectory(prefix="contactlab-") as folder:
            alone = replace(examined, session=replace(self._session, folder=Path(folder)))
            runs = alone.run("labels", "Judged on fresh seeds", seeds=task.seeds)
            return {each.label for each in run_labels(task, [run.record for run in runs])}

    def _aim_now(self, own: Apart | None) -> float:
        """Return the error on fresh seeds of a model that kept the aim on those of the search."""
        return SAME * self._fresh_now.share if own and own.share <= self._aim.limit else 0.0

    def _touched(self) -> str:
        """Return the first pair that touches on fresh seeds and stayed apart before, or ""."""
        model = self._motions[0].model
        runs = [part.positions for part in self._fresh_yards.parts]
        near = pairs_within(model, runs, 0.0)
        pairs = self._watched_pairs
        pair = min(pairs if near is None else pairs & near, default=None)
        return " and ".join(name_of(model, "geom", geom) for geom in pair) if pair else ""

    def _word_now(self, task: Task) -> str:
        return self._word(self._examined, task)[0]

    def _word(self, examined: CheckedModel, task: Task) -> tuple[str, float, str]:
        """Return what the judge says of a model's numerics: its word, share and reason."""
        motions = examined.motions_of(task)
        settings = Settings(places=False, excess=False)
        budget = error_budget(motions, rows=(), settings=settings, workers=self._threads)
        verdict = judge(budget, task.within)
        reason = verdict.reasons[0].sentence if verdict.reasons else "sound"
        return verdict.word, budget.share, reason

    def _as_accurate(self, known: Tried, chosen: Tried | None) -> Point | None:
        """Return the cheapest that is no less accurate than the model as written."""
        assert known.error
        own = known.error.share
        good = [
            one
            for one in self._search.tried.values()
            if one.error and one.price and one.error.share <= SAME * own and one.price.ratio < SAVES
        ]
        best = min(good, key=lambda one: one.price.ratio if one.price else math.inf, default=None)
        return self._point(best) if best and best is not chosen else None

    def _binds(self, nearest: Tried) -> str:
        """Say which body, when, and which row keeps the aim from being met."""
        error = nearest.error
        assert error
        if self._search.dearest is not None:
            return "nothing that was tried is fast enough"
        where = f"{error.body} at {error.time:.2f} s of {error.phase}"
        row = "the timestep"
        made = self._search.space.made(nearest.choice)
        made.opt.iterations, made.opt.tolerance = max(100, made.opt.iterations), 1e-12
        made.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
        done = self._search.measure.apart(made, nearest.choice.multiple)
        if done.share < 0.5 * error.share:
            row = "the solver"
        return f"{where}, by {row}"

    def _changes(self, chosen: Tried) -> Iterator[Changed]:
        model = self._model
        for name, after in self._settings(chosen.choice).items():
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
        error, price = tried.error, tried.price
        assert error
        settings: dict[str, Setting] = {
            name: as_written(value) for name, value in tried.choice.settings.items()
        }
        return Point(
            settings=settings,
            timestep=self._step(tried.choice),
            lighter=tried.choice.light,
            apart=tried.choice.apart,
            error=_finite(error.share),
            low=_finite(error.low),
            high=_finite(error.high),
            body=error.body,
            phase=error.phase,
            time=_finite(error.time),
            price=price and BudgetPrice(ratio=price.ratio, low=price.low, high=price.high),
        )

    def _text(self, error: float | None) -> str:
        if error is None:
            return "unknown"
        return percent(error) if self._aim.unit == "1" else f"{error:.2e} {self._aim.unit}"

    def _sentence(
        self,
        known: Tried,
        chosen: Tried | None,
        verified: Verified | None,
        nearest: Tried | None,
        binds: str,
        to_aim: ToAim | None,
    ) -> str:
        assert known.error
        now = self._text(known.error.share)
        keeps = ""
        if to_aim and to_aim.point.price:
            ratio = to_aim.point.price.ratio
            keeps = f"as written it misses the aim; what keeps it takes {ratio:.2f} of the time"
        elif nearest and nearest.error and nearest.price:
            near = described(self._settings(nearest.choice)) or "the model as written"
            got = f"{self._text(nearest.error.share)} at {nearest.price.ratio:.2f} of the time"
            limit = self._text(self._aim.limit)
            if self._search.dearest is not None:
                limit = f"{self._request.real_time:g} times real time"
            keeps = f"nothing keeps {limit}: nearest is {near}, {got}; it binds {binds}"
        if chosen and chosen.error and chosen.price and verified:
            saved = f"{chosen.price.ratio:.2f} of the time"
            if self._aim.unit == "1" and known.error.share > self._aim.within:
                within = self._text(self._aim.within)
                saved = (
                    f"as written it is beyond the tolerance of {within}; what keeps that: {saved}"
                )
            seen = f"{self._text(verified.error)} on fresh seeds"
            error = f"error {self._text(chosen.error.share)}, {seen} (now {now})"
            return "; ".join(filter(None, (f"{saved}, {error}", keeps)))
        if keeps:
            return f"nothing is faster at no larger error than now, {now}; {keeps}"
        return f"keep it as it is: error {now}, and nothing within the limit is faster"


def unread_flags(file: Path) -> tuple[str, ...]:
    """Return the flags of a model's file that compute what no state depends on."""
    try:
        bits = int(mujoco.MjSpec.from_file(str(file)).option.enableflags)
    except ValueError:
        return ()
    unread = {
        "energy": mujoco.mjtEnableBit.mjENBL_ENERGY,
        "fwdinv": mujoco.mjtEnableBit.mjENBL_FWDINV,
    }
    return tuple(name for name, bit in unread.items() if bits & int(bit))


def with_flags(model: mujoco.MjModel, names: Sequence[str]) -> mujoco.MjModel:
    """Return a model with flags that recording switches off, as its file has them."""
    for name in names:
        model.opt.enableflags |= int(getattr(mujoco.mjtEnableBit, f"mjENBL_{name.upper()}"))
    return model


def _finite(number: float) -> float | None:
    return float(number) if math.isfinite(number) else None
