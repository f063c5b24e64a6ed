"""The search: which choices are tried, in which order, and which is the best of them.

The step comes first, of all else as written: it saves most, and is found by errors, which cost less
to measure than times do, so that little time gives that small answer. Then all goes that costs time
and adds no error, together; then integrator and step, then, where the error may grow, what else
saves time. Every choice that was tried is kept, with its error and its time.
"""

import math
import time
from collections import ChainMap
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Protocol

import mujoco

from contactlab.budget.prices import Price
from contactlab.studies.search.choice import AS_WRITTEN, INTEGRATOR, Choice, Cuts, Key, differing
from contactlab.studies.search.clock import Clock
from contactlab.studies.search.levers import ASLEEP, Lever, Settings, condim_alone
from contactlab.studies.search.yardstick import Apart

SAVES = 0.97
"""Ratio of times below which a setting saves any."""
_LOSSLESS = 0.05  # of the limit, that what counts as free may add to the error of the model
_WASTE = 0.4  # of the time that is left, for what adds no error: steps are to follow
_CLOSE, _CLOSEST = 1.15, 1.03  # ratios of steps that are told apart: of integrators, of the best
SAME = 1.02
"""Ratio of errors up to which one is no larger: of equal steps both have the same noise."""
_ALONE = 12  # geoms whose contacts are tried one by one
_SHORTER = 3  # choices that are tried at shorter steps
_TURNS, _COMPARED = 4, 8
"""Of the clock: to see what may save time, and to see whether it does."""


class OutOfTimeError(Exception):
    """The time that was allowed is over."""


class Measure(Protocol):
    """What tells how far a model of so many fine steps is from the model as written."""

    def apart(self, model: mujoco.MjModel, multiple: int) -> Apart:
        """Return how far."""
        raise NotImplementedError


@dataclass(frozen=True)
class Bound:
    """The largest error that is asked for, and that which the search takes for it.

    There is no margin between them: fresh seeds tell by how much seeds differ, and what they show
    beyond the limit is followed by shorter steps.

    Attributes:
        limit: what is to hold on fresh seeds.
        accepted: largest error in the search.
    """

    limit: float
    accepted: float

    @classmethod
    def of(cls, limit: float) -> "Bound":
        """Return the bound of a limit that hangs on nothing that the search measures."""
        return cls(limit, limit)

    @classmethod
    def as_now(cls, now: float) -> "Bound":
        """Return the bound that the model as written keeps, whose error is now."""
        return cls(now, SAME * now)

    def or_as_now(self, now: float) -> "Bound":
        """Return the wider of both; of equal steps, what is as accurate has the same noise."""
        if now > self.limit:
            return self
        return Bound(self.limit, max(self.accepted, SAME * now))


@dataclass
class Tried:
    """A choice that was tried, its error and its price, as far as they were measured."""

    choice: Choice
    error: Apart | None = None
    price: Price | None = None


@dataclass(frozen=True)
class Space:
    """What is searched.

    Attributes:
        models: as written, and without what may go.
        start: what all that is tried is without.
        finer: fine steps in one of the model as written.
        longest: steps, in fine ones, that the measure can tell of.
        levers: settings.
        integrators: that of the model first.
        hulled: the start's, with fewer vertices of hulls, too; None if that is not asked for.
        sleeps: whether bodies may sleep that are awake now.
    """

    models: Mapping[Cuts, mujoco.MjModel]
    start: Cuts
    finer: int
    longest: int
    levers: Sequence[Lever]
    integrators: Sequence[str]
    hulled: Cuts | None = None
    sleeps: bool = False

    @property
    def model(self) -> mujoco.MjModel:
        """As written."""
        return self.models[AS_WRITTEN]

    def made(self, choice: Choice) -> mujoco.MjModel:
        """Return the model of a choice, but for its step."""
        return choice.made(self.models[choice.cuts])


@dataclass
class Search:
    """A search for the cheapest choice within a limit, or the most accurate within a price.

    Attributes:
        bounds: of the error, one search after the other; what is found for the last stands last.
        dearest: largest price, if the error is what is to be small.
        deadline: on the clock of `time.monotonic`.
        tried: what was tried, by key.
        ended: whether the time was over before nothing was left to try.
    """

    space: Space
    measure: Measure
    clock: Clock
    bounds: Sequence[Bound]
    dearest: float | None
    deadline: float
    tried: dict[Key, Tried] = field(default_factory=dict[Key, "Tried"])
    ended: bool = False
    _without_waste: Choice | None = None
    _timing: float = 0.0  # s that a choice took to be timed, the last time
    _sleeping: float = 0.0  # s that one whose bodies may sleep took, times its fine steps in one

    @property
    def now(self) -> Choice:
        """The model as written."""
        return Choice({}, self.space.finer)

    def run(self) -> None:
        """Search until nothing is left to try, or the time is over: a share of it a bound."""
        whole, self.deadline = self.deadline, math.inf
        try:
            self._error(self.now)
            self._priced([self.now])
            for place, bound in enumerate(self.bounds):
                self.bound = bound
                left = whole - time.monotonic()
                self.deadline = whole - left * (1 - 1 / (len(self.bounds) - place))
                try:
                    self._searched()
                except OutOfTimeError:
                    self.ended = True
        except (OutOfTimeError, KeyboardInterrupt):
            self.ended = True

    def _searched(self) -> None:
        """Search for one bound."""
        alone = self._step_alone() if self.dearest is None else self.now
        here = self._step(self._lean(), alone.multiple)
        if self.dearest is None:
            here = self._with_losses(here)
            self._step_again(here)
            self._at_shorter_steps()
        self._asleep(here)

    def safest(self, until: float) -> list[Tried]:
        """Return what is as accurate as the model as written at no longer steps, cheapest first.

        It is searched for at the model's own step until then, on the clock of `time.monotonic`.
        """
        self.deadline, own = until, self._error(self.now)
        with suppress(OutOfTimeError):
            self._priced([self._lean()])
        known = [one for one in self.tried.values() if one.error and one.price]
        short = [one for one in known if one.choice.multiple <= self.now.multiple]
        return sorted((one for one in short if share_of(one) <= SAME * own), key=_ratio)

    def ranked(self, bound: Bound) -> list[Tried]:
        """Return what keeps a bound, the best first; only what was measured and timed."""
        known = [one for one in self.tried.values() if one.error and one.price]
        if self.dearest is not None:
            cheap = [one for one in known if _ratio(one) <= self.dearest]
            return sorted(cheap, key=share_of)
        return sorted((one for one in known if share_of(one) <= bound.accepted), key=_ratio)

    def likely(self, bound: Bound) -> list[tuple[float, Tried]]:
        """Return what keeps a bound by about its price: what was not timed, from other steps."""
        steps = {
            one.choice.key[1:]: _ratio(one) * one.choice.multiple
            for one in self.tried.values()
            if one.price
        }
        found = [
            (steps[one.choice.key[1:]] / one.choice.multiple, one)
            for one in self.tried.values()
            if one.choice.key[1:] in steps and share_of(one) <= bound.accepted
        ]
        return sorted(found, key=lambda pair: pair[0])

    def nearest(self, limit: float, failed: Container[Key] = ()) -> Tried | None:
        """Return what comes nearest to an aim that nothing was seen to meet.

        Of errors, the cheapest within the limit but for those that failed on fresh seeds, so what
        time did not allow to judge; or else what has the least error.
        """
        known = [one for one in self.tried.values() if one.error]
        if self.dearest is not None:
            return min((one for one in known if one.price), key=_ratio, default=None)
        likely = (one for _, one in self.likely(Bound.of(limit)) if one.choice.key not in failed)
        return next(likely, None) or min(known, key=share_of, default=None)

    def _left(self, takes: float = 0.0) -> None:
        """Go on if there is time for what takes so long [s]."""
        if time.monotonic() + takes > self.deadline:
            raise OutOfTimeError

    def _entry(self, choice: Choice) -> Tried:
        return self.tried.setdefault(choice.key, Tried(choice))

    def _error(self, choice: Choice) -> float:
        """Return the error of a choice."""
        entry = self._entry(choice)
        if entry.error is None:
            self._left()
            found = self.measure.apart(self.space.made(choice), choice.multiple)
            entry.error = found
        return entry.error.share

    def _priced(self, choices: Sequence[Choice]) -> list[float]:
        """Return the prices of choices, which are timed if they were not yet."""
        self._timed([one for one in choices if self._entry(one).price is None])
        return [_ratio(self._entry(one)) for one in choices]

    def _timed(self, choices: Sequence[Choice], turns: int = _TURNS) -> list[Price]:
        """Return the prices of choices from turns that all of them take, so that they rank."""
        if not choices:
            return []
        self._left(len(choices) * self._timing)
        begin = time.monotonic()
        prices = self.clock.prices([self._stepped(one) for one in choices], turns)
        self._timing = (time.monotonic() - begin) / (1 + len(choices))
        for choice, price in zip(choices, prices, strict=True):
            if math.isfinite(price.ratio):  # else MuJoCo refuses it
                self._entry(choice).price = price
        return prices

    def _ratios(self, choices: Sequence[Choice]) -> dict[Key, float]:
        """Return what choices cost in the same turns, by key."""
        timed = self._timed(choices)
        return {one.key: price.ratio for one, price in zip(choices, timed, strict=True)}

    def _stepped(self, choice: Choice) -> tuple[mujoco.MjModel, int]:
        return self.space.made(choice), choice.multiple

    def _fits(self, choice: Choice) -> bool:
        return self._error(choice) <= self.bound.accepted

    def _quick(self, here: Choice) -> Choice:
        """Return a choice with Newton's solver, if another makes all that follows slow."""
        newton = differing({"solver": "Newton"}, self.space.made(here))
        if not newton:
            return here
        return self._faster(here.with_settings(newton), here)

    def _hulled(self, here: Choice) -> Choice:
        """Return a choice with fewer vertices of hulls, if that saves time and keeps the bound."""
        if self.space.hulled is None:
            return here
        return self._faster(here.without(self.space.hulled), here)

    def _faster(self, choice: Choice, here: Choice) -> Choice:
        """Return a choice, if it saves time beside another and adds no error, or that one."""
        most = max(self._error(here) + _LOSSLESS * self.bound.limit, self.bound.accepted)
        return choice if self._saves(choice, here) and self._error(choice) <= most else here

    def _asleep(self, here: Choice) -> None:
        """Try a choice whose bodies may sleep, which only whole runs tell of."""
        if not self.space.sleeps or not self._fits(here):
            return
        asleep = here.with_settings(ASLEEP)
        self._left(self._sleeping / here.multiple)
        begin, (own, price) = time.monotonic(), (self._stepped(one) for one in (here, asleep))
        found = self.clock.compared_whole(price, own)
        known = self._entry(here).price
        if known and found.high < SAVES and self._fits(asleep):
            self._entry(asleep).price = Price(
                *(known.ratio * part for part in (found.ratio, found.low, found.high))
            )
        self._sleeping = (time.monotonic() - begin) * here.multiple

    def _lean(self) -> Choice:
        """Return the model without all that costs time and adds no error, at its own step.

        All bounds begin there: the least of them says what counts as no error, and what the model
        as written keeps is kept.
        """
        if self._without_waste is None:
            here = self._hulled(self._quick(self.now.without(self.space.start)))
            own = self._error(here)
            kept = [bound.accepted for bound in self.bounds if own <= bound.accepted]
            most = own + _LOSSLESS * min(bound.limit for bound in self.bounds)
            most = min([most, *kept])
            whole = self.deadline
            self.deadline = time.monotonic() + _WASTE * max(0.0, whole - time.monotonic())
            self._without_waste = here
            with suppress(OutOfTimeError):
                self._without_waste = self._added(
                    here, self.space.levers, lambda one: self._error(one) <= most
                )
            self.deadline = whole
        return self._without_waste

    def _with_losses(self, here: Choice) -> Choice:
        """Return a choice with what saves time and keeps the limit."""
        if not self._fits(here):
            return here
        levers = [
            replace(lever, values=[*lever.values, *lever.tight]) for lever in self.space.levers
        ]
        return self._added(here, levers, self._fits)

    def _added(
        self, here: Choice, levers: Sequence[Lever], good: Callable[[Choice], bool]
    ) -> Choice:
        """Return a choice with the best good value of each lever that saves time.

        Each value is timed and measured alone, then all are together: what is not good with the
        rest is left out, and what saves nothing beside it.
        """
        found = list[tuple[float, Settings]]()
        for saving in self._saving(here, levers):
            for ratio, one in saving:
                if good(one):
                    found.append((ratio, _beyond(one, here)))
                    break
                alone = condim_alone(_beyond(one, here))[:_ALONE]
                if kept := [each for each in alone if good(here.with_settings(each))]:
                    found.append((ratio, dict(ChainMap(*map(dict, kept)))))
                    break
        both = here
        for _, settings in sorted(found, key=lambda pair: pair[0]):
            if good(more := both.with_settings(settings)):
                both = more
        if both == here or not self._saves(both, here):
            return here
        return self._needed(both, here, [settings for _, settings in found])

    def _saving(
        self, here: Choice, levers: Sequence[Lever]
    ) -> Iterator[list[tuple[float, Choice]]]:
        """Yield what of each lever saves time beside a choice, with prices, the cheapest first."""
        made = self.space.made(here)
        tried = [
            [here.with_settings(value) for value in lever.values if differing(value, made)]
            for lever in levers
        ]
        last = [
            values[-1:] if lever.falls else values
            for lever, values in zip(levers, tried, strict=True)
        ]
        ratios = self._ratios([here, *chain(*last)])
        worth = SAVES * ratios[here.key]

        def saving(choices: Sequence[Choice]) -> list[tuple[float, Choice]]:
            found = [(ratios[one.key], one) for one in choices if ratios[one.key] < worth]
            return sorted(found, key=lambda pair: pair[0])

        less = [values for values, ends in zip(tried, last, strict=True) if saving(ends)]
        ratios |= self._ratios([one for one in chain(*less) if one.key not in ratios])
        yield from map(saving, less)

    def _needed(self, choice: Choice, here: Choice, added: Sequence[Settings]) -> Choice:
        """Return a choice without what was added to another and saves no time beside the rest."""
        parts = [part for part in added if part.keys() <= choice.settings.keys()]
        if len(parts) < 2:
            return choice
        without = [choice.undone(part, here) for part in parts]
        own, *prices = self._timed([choice, *without], _COMPARED)
        least = choice
        for part, price in zip(parts, prices, strict=True):
            if SAVES * price.ratio < own.ratio or price.low < own.ratio:
                least = least.undone(part, here)
        if least in (choice, here):
            return choice
        self._left()
        beside = self.clock.compared(self._stepped(choice), self._stepped(least), _COMPARED)
        if beside.high < SAVES:
            return choice
        self._error(least)
        self._priced([least])
        return least

    def _saves(self, choice: Choice, here: Choice) -> bool:
        """Return whether a choice is faster than another, beside it, and price it."""
        self._left()
        price = self.clock.compared(self._stepped(choice), self._stepped(here), _COMPARED)
        if saves := price.ratio < SAVES and price.high < 1:
            self._priced([choice])
        return saves

    def _step_alone(self) -> Choice:
        """Return the longest step within the limit, of all else as written, and price it.

        Of later bounds, of the model without waste, which is as accurate and sooner measured.
        """
        own = self._without_waste or self.now.without(self.space.start)
        found = self._longest(self._far(own), 1, _CLOSE) or own
        self._priced([found])
        return found

    def _step(self, here: Choice, alone: int) -> Choice:
        """Return a choice with the integrator and the step that serve the aim best.

        Steps of the model's own integrator are sought from that on which is the longest alone.
        """
        model = self.space.model
        choices = [
            here.with_settings({INTEGRATOR: name} if differing({INTEGRATOR: name}, model) else {})
            for name in self.space.integrators
        ]
        prices = [price.ratio for price in self._timed(choices)]
        if self.dearest is not None:
            return self._most_accurate(choices, prices)
        best, cost = None, math.inf
        for price, choice in zip(prices, choices, strict=True):
            # The shortest step that would win.
            least = math.floor(price * choice.multiple / cost) + 1 if best else 1
            near = choice if best else choice.at(alone)
            if found := self._longest(near, least, _CLOSE):
                best, cost = found, price * choice.multiple / found.multiple
        if best is None:
            self._priced([min(self.tried.values(), key=share_of).choice])
            return here
        best = self._longest(best, best.multiple, _CLOSEST) or best
        self._priced([best])
        return best

    def _far(self, choice: Choice) -> Choice:
        """Return a choice at the longest of doubled steps within the limit, or at its own.

        Errors need not grow with the step: where contacts decide, they may fall again.
        """
        if self._fits(choice):
            doublings = int(math.log2(self.space.longest / choice.multiple))
            for doubling in range(doublings, 0, -1):
                if self._fits(longer := choice.at(choice.multiple << doubling)):
                    return longer
        return choice

    def _longest(self, choice: Choice, least: int, close: float) -> Choice | None:
        """Return a choice at its longest step within the limit that is at least so long."""
        shortest = min(self.space.finer, 2)
        low = max(least, min(shortest, choice.multiple), 1)
        if low > self.space.longest:
            return None
        start = max(low, choice.multiple)
        if not self._fits(choice.at(start)):
            high = start
            if not self._fits(choice.at(low)):
                return None
        else:
            low, high = start, math.ceil(start * close**2) + 1
            while high <= self.space.longest and self._fits(choice.at(high)):
                low, high = high, 2 * high
            high = min(high, self.space.longest + 1)
        while high - low > 1 and high > close * low:
            middle = (low + high) // 2
            if self._fits(choice.at(middle)):
                low = middle
            else:
                high = middle
        return choice.at(low)

    def _step_again(self, here: Choice) -> None:
        """Try the steps beside that of a choice, to which more was added since."""
        for part in (1.25, 1.1):
            longer = here.at(max(here.multiple + 1, round(part * here.multiple)))
            if longer.multiple <= self.space.longest and self._fits(longer):
                self._priced([longer])
                break
        shorter = here.at(max(1, min(here.multiple - 1, round(0.8 * here.multiple))))
        self._error(shorter)
        self._priced([shorter])

    def _at_shorter_steps(self) -> None:
        """Try what saves more than its error costs in steps, if that falls with them."""
        best = min(map(_ratio, self.ranked(self.bound)), default=math.inf)
        found = list[tuple[float, Choice]]()
        for one in self.tried.values():
            if one.price and self.bound.accepted < share_of(one) < math.inf:
                multiple = math.floor(one.choice.multiple * self.bound.accepted / share_of(one))
                if multiple >= min(self.space.finer, 2):
                    about = _ratio(one) * one.choice.multiple / multiple
                    found.append((about, one.choice.at(multiple)))
        for about, choice in sorted(found, key=lambda pair: pair[0])[:_SHORTER]:
            if about < SAVES * best and self._fits(choice):
                self._priced([choice])

    def _most_accurate(self, choices: Sequence[Choice], prices: Sequence[float]) -> Choice:
        """Return the most accurate of choices at the shortest step that their price allows."""
        assert self.dearest is not None
        shortest = min(self.space.finer, 2)
        steps = [
            choice.at(max(shortest, math.ceil(choice.multiple * price / self.dearest)))
            for price, choice in zip(prices, choices, strict=True)
        ]
        within = [choice for choice in steps if choice.multiple <= self.space.longest]
        for choice in within:
            self._error(choice)
        self._priced(within)
        return min(within, key=self._error, default=choices[0])

    def measured(self, choice: Choice) -> Tried:
        """Return a choice that is tried after the search: it has its own time."""
        self.deadline = math.inf
        self._error(choice)
        return self._entry(choice)

    def added(self, choice: Choice) -> Tried:
        """Return it with its price, too."""
        found = self.measured(choice)
        self._priced([choice])
        return found

    def shorter(self, tried: Tried) -> Iterator[Choice]:
        """Yield a choice at ever shorter steps."""
        multiple = tried.choice.multiple
        while multiple > 1:
            multiple = min(multiple - 1, math.floor(0.9 * multiple)) or 1
            yield tried.choice.at(multiple)


def _beyond(choice: Choice, here: Choice) -> Settings:
    """Return the settings that a choice has beyond another's."""
    return {
        name: setting
        for name, setting in choice.settings.items()
        if here.settings.get(name, ...) != setting
    }


def _ratio(tried: Tried) -> float:
    return tried.price.ratio if tried.price else math.inf


def share_of(tried: Tried) -> float:
    """Return the error of what was tried; infinite if it was not measured."""
    return tried.error.share if tried.error else math.inf
