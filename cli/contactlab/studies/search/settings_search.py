"""The search: the order in which configurations are tried, and the best of them.

The timestep comes first, with everything else as written: it saves most, and errors are faster to
measure than times, so that this small result needs little time. Then everything is removed that
costs time and adds no error; then integrator and timestep are searched; then other settings that
save time, up to the allowed error. Every configuration is stored with its error and time.
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

from contactlab.schema.time_ratio import LEAST_SAVING, TimeRatio
from contactlab.studies.search.clock import Clock
from contactlab.studies.search.configuration import (
    AS_WRITTEN,
    INTEGRATOR,
    Configuration,
    Key,
    Reductions,
    changed_settings,
)
from contactlab.studies.search.reference_error import ErrorEstimate
from contactlab.studies.search.search_space import SLEEP_SETTINGS, Parameter, Settings, split_condim

MIN_SPEEDUP_RATIO = 1 - LEAST_SAVING
"""Ratio of times below which a setting saves time."""
_LOSSLESS_SHARE = (
    0.05  # share of the limit that a lossless setting may add to the error of the model
)
LOSSLESS_TIME_SHARE = (
    0.4  # share of the remaining time for lossless settings, since the timestep follows
)
_INTEGRATOR_STEP_RATIO, _FINAL_STEP_RATIO = (
    1.15,
    1.03,
)  # ratios of steps that count as different: of integrators, and of the final step
EQUAL_ERROR_RATIO = 1.02
"""Ratio of errors up to which they are equal: at equal steps both have the same noise."""
MAX_SINGLE_GEOMS = 12  # geoms whose contacts are tried one by one
MAX_SHORTER_STEPS = 3  # configurations that are tried at shorter steps
_RANKING_TURNS, _COMPARISON_TURNS = 4, 8
"""Turns of the clock: to rank settings that may save time, and to confirm that they do."""


class OutOfTimeError(Exception):
    """The time limit was reached."""


class ErrorEstimator(Protocol):
    """Estimates the error of a model at a timestep of `multiple` fine steps."""

    def estimate_error(self, model: mujoco.MjModel, multiple: int) -> ErrorEstimate:
        """Return the error."""
        raise NotImplementedError


@dataclass(frozen=True)
class Bound:
    """The largest allowed error, and the largest error that the search accepts for it.

    There is no margin between them: fresh seeds show how much seeds differ, and failures there are
    followed by shorter steps.

    Attributes:
        limit: largest allowed error on fresh seeds.
        accepted: largest error in the search.
    """

    limit: float
    accepted: float

    @classmethod
    def of(cls, limit: float) -> "Bound":
        """Return the bound of a limit that depends on no measurement of the search."""
        return cls(limit, limit)

    @classmethod
    def as_current(cls, now: float) -> "Bound":
        """Return the bound that equals the error of the model as written."""
        return cls(now, EQUAL_ERROR_RATIO * now)

    def or_as_current(self, now: float) -> "Bound":
        """Return the wider of both bounds; at equal steps, equal errors have the same noise."""
        if now > self.limit:
            return self
        return Bound(self.limit, max(self.accepted, EQUAL_ERROR_RATIO * now))


@dataclass
class Evaluation:
    """A configuration, with its error and time ratio if they were measured."""

    configuration: Configuration
    error: ErrorEstimate | None = None
    time_ratio: TimeRatio | None = None


@dataclass(frozen=True)
class SearchSpace:
    """The search space.

    Attributes:
        models: compiled models by reductions.
        start: reductions of all candidates.
        substeps: fine steps in a timestep of the model as written.
        longest: longest timestep, in fine steps, that the estimator supports.
        parameters: settings to search.
        integrators: integrators to try, the model's own first.
        simplified: reductions of the start and simplified hulls; None if not requested.
        may_sleep: whether awake bodies may sleep instead.
    """

    models: Mapping[Reductions, mujoco.MjModel]
    start: Reductions
    substeps: int
    longest: int
    parameters: Sequence[Parameter]
    integrators: Sequence[str]
    simplified: Reductions | None = None
    may_sleep: bool = False

    @property
    def model(self) -> mujoco.MjModel:
        """As written."""
        return self.models[AS_WRITTEN]

    def model_of(self, choice: Configuration) -> mujoco.MjModel:
        """Return the model of a configuration, at the timestep of the model as written."""
        return choice.apply_to(self.models[choice.reductions])


@dataclass
class Search:
    """A search for the fastest configuration within a limit, or the most accurate within a time.

    Attributes:
        bounds: on the error, searched in order; the last result counts last.
        max_time_ratio: largest time ratio, if the error is minimized.
        deadline: on the clock of `time.monotonic`.
        evaluations: evaluated configurations by key.
        timed_out: whether the time limit ended the search early.
    """

    space: SearchSpace
    estimator: ErrorEstimator
    clock: Clock
    bounds: Sequence[Bound]
    max_time_ratio: float | None
    deadline: float
    evaluations: dict[Key, Evaluation] = field(default_factory=dict[Key, "Evaluation"])
    timed_out: bool = False
    _lossless: Configuration | None = None
    _timing_seconds: float = 0.0  # s of the last timing of a configuration
    _sleep_seconds: float = (
        0.0  # s of the last timing of a sleeping configuration, times its fine steps per step
    )

    @property
    def current(self) -> Configuration:
        """The model as written."""
        return Configuration({}, self.space.substeps)

    def run_search(self) -> None:
        """Search until nothing is left to try, or the time limit; each bound gets a share of it."""
        whole, self.deadline = self.deadline, math.inf
        try:
            self._error_of(self.current)
            self._time_ratios_of([self.current])
            for place, bound in enumerate(self.bounds):
                self.bound = bound
                left = whole - time.monotonic()
                self.deadline = whole - left * (1 - 1 / (len(self.bounds) - place))
                try:
                    self._search_bound()
                except OutOfTimeError:
                    self.timed_out = True
        except (OutOfTimeError, KeyboardInterrupt):
            self.timed_out = True

    def _search_bound(self) -> None:
        """Search for one bound."""
        alone = self._search_step_alone() if self.max_time_ratio is None else self.current
        base = self._search_step(self._remove_lossless(), alone.multiple)
        if self.max_time_ratio is None:
            base = self._add_lossy(base)
            self._try_neighboring_steps(base)
            self._try_shorter_steps()
        self._try_sleep(base)

    def as_accurate_as_current(self, until: float) -> list[Evaluation]:
        """Return candidates as accurate as the model as written at no longer steps, fastest first.

        They are searched at the model's own timestep until the given time of `time.monotonic`.
        """
        self.deadline, own = until, self._error_of(self.current)
        with suppress(OutOfTimeError):
            self._time_ratios_of([self._remove_lossless()])
        known = [one for one in self.evaluations.values() if one.error and one.time_ratio]
        short = [one for one in known if one.configuration.multiple <= self.current.multiple]
        return sorted(
            (one for one in short if error_of(one) <= EQUAL_ERROR_RATIO * own), key=_time_ratio_of
        )

    def rank_candidates(self, bound: Bound) -> list[Evaluation]:
        """Return the timed candidates within a bound, the best first."""
        known = [one for one in self.evaluations.values() if one.error and one.time_ratio]
        if self.max_time_ratio is not None:
            cheap = [one for one in known if _time_ratio_of(one) <= self.max_time_ratio]
            return sorted(cheap, key=error_of)
        return sorted((one for one in known if error_of(one) <= bound.accepted), key=_time_ratio_of)

    def estimate_times(self, bound: Bound) -> list[tuple[float, Evaluation]]:
        """Return candidates within a bound by estimated time ratio; timed at other steps."""
        steps = {
            one.configuration.key[1:]: _time_ratio_of(one) * one.configuration.multiple
            for one in self.evaluations.values()
            if one.time_ratio
        }
        found = [
            (steps[one.configuration.key[1:]] / one.configuration.multiple, one)
            for one in self.evaluations.values()
            if one.configuration.key[1:] in steps and error_of(one) <= bound.accepted
        ]
        return sorted(found, key=lambda pair: pair[0])

    def closest_to(self, limit: float, failed: Container[Key] = ()) -> Evaluation | None:
        """Return the candidate that is closest to an unmet target.

        For an error: the fastest within the limit that did not fail on fresh seeds, which the time
        limit left unverified; otherwise the one with the least error.
        """
        known = [one for one in self.evaluations.values() if one.error]
        if self.max_time_ratio is not None:
            return min((one for one in known if one.time_ratio), key=_time_ratio_of, default=None)
        likely = (
            one
            for _, one in self.estimate_times(Bound.of(limit))
            if one.configuration.key not in failed
        )
        return next(likely, None) or min(known, key=error_of, default=None)

    def _check_time(self, takes: float = 0.0) -> None:
        """Raise an OutOfTimeError if less than `takes` seconds are left."""
        if time.monotonic() + takes > self.deadline:
            raise OutOfTimeError

    def _evaluation_of(self, choice: Configuration) -> Evaluation:
        return self.evaluations.setdefault(choice.key, Evaluation(choice))

    def _error_of(self, choice: Configuration) -> float:
        """Return the error of a configuration."""
        entry = self._evaluation_of(choice)
        if entry.error is None:
            self._check_time()
            found = self.estimator.estimate_error(self.space.model_of(choice), choice.multiple)
            entry.error = found
        return entry.error.error

    def _time_ratios_of(self, choices: Sequence[Configuration]) -> list[float]:
        """Return the time ratios of configurations; time those that were not timed yet."""
        self._time_together([one for one in choices if self._evaluation_of(one).time_ratio is None])
        return [_time_ratio_of(self._evaluation_of(one)) for one in choices]

    def _time_together(
        self, choices: Sequence[Configuration], turns: int = _RANKING_TURNS
    ) -> list[TimeRatio]:
        """Time configurations in common turns, so that they can be ranked; return their ratios."""
        if not choices:
            return []
        self._check_time(len(choices) * self._timing_seconds)
        begin = time.monotonic()
        prices = self.clock.time_ratios([self._model_at_step(one) for one in choices], turns)
        self._timing_seconds = (time.monotonic() - begin) / (1 + len(choices))
        for choice, price in zip(choices, prices, strict=True):
            if math.isfinite(price.ratio):  # otherwise MuJoCo refuses it
                self._evaluation_of(choice).time_ratio = price
        return prices

    def _ratios_by_key(self, choices: Sequence[Configuration]) -> dict[Key, float]:
        """Return the time ratios of configurations from common turns, by key."""
        timed = self._time_together(choices)
        return {one.key: price.ratio for one, price in zip(choices, timed, strict=True)}

    def _model_at_step(self, choice: Configuration) -> tuple[mujoco.MjModel, int]:
        return self.space.model_of(choice), choice.multiple

    def _is_within_bound(self, choice: Configuration) -> bool:
        return self._error_of(choice) <= self.bound.accepted

    def _with_newton(self, base: Configuration) -> Configuration:
        """Return a configuration with Newton's solver, if the current one slows down the search."""
        newton = changed_settings({"solver": "Newton"}, self.space.model_of(base))
        if not newton:
            return base
        return self._faster_of(base.with_settings(newton), base)

    def _with_simplified_hulls(self, base: Configuration) -> Configuration:
        """Return a configuration with simplified hulls, if that saves time within the bound."""
        if self.space.simplified is None:
            return base
        return self._faster_of(base.with_reductions(self.space.simplified), base)

    def _faster_of(self, choice: Configuration, base: Configuration) -> Configuration:
        """Return a configuration if it is faster than `base` without added error, or `base`."""
        most = max(self._error_of(base) + _LOSSLESS_SHARE * self.bound.limit, self.bound.accepted)
        return choice if self._saves_time(choice, base) and self._error_of(choice) <= most else base

    def _try_sleep(self, base: Configuration) -> None:
        """Try a configuration with sleep, which only whole runs can measure."""
        if not self.space.may_sleep or not self._is_within_bound(base):
            return
        asleep = base.with_settings(SLEEP_SETTINGS)
        self._check_time(self._sleep_seconds / base.multiple)
        begin, (own, price) = time.monotonic(), (self._model_at_step(one) for one in (base, asleep))
        found = self.clock.compare_whole_runs(price, own)
        known = self._evaluation_of(base).time_ratio
        if known and found.is_less(MIN_SPEEDUP_RATIO) and self._is_within_bound(asleep):
            self._evaluation_of(asleep).time_ratio = found.scaled(known.ratio)
        self._sleep_seconds = (time.monotonic() - begin) * base.multiple

    def _remove_lossless(self) -> Configuration:
        """Return the model without anything that costs time and adds no error, at its own step.

        All bounds start from it. The smallest bound decides which added error counts as none, and
        bounds that the model as written satisfies stay satisfied.
        """
        if self._lossless is None:
            base = self._with_simplified_hulls(
                self._with_newton(self.current.with_reductions(self.space.start))
            )
            own = self._error_of(base)
            kept = [bound.accepted for bound in self.bounds if own <= bound.accepted]
            most = own + _LOSSLESS_SHARE * min(bound.limit for bound in self.bounds)
            most = min([most, *kept])
            whole = self.deadline
            self.deadline = time.monotonic() + LOSSLESS_TIME_SHARE * max(
                0.0, whole - time.monotonic()
            )
            self._lossless = base
            with suppress(OutOfTimeError):
                self._lossless = self._add_parameters(
                    base, self.space.parameters, lambda one: self._error_of(one) <= most
                )
            self.deadline = whole
        return self._lossless

    def _add_lossy(self, base: Configuration) -> Configuration:
        """Return a configuration with settings that save time within the bound."""
        if not self._is_within_bound(base):
            return base
        parameters = [
            replace(parameter, values=[*parameter.values, *parameter.step_sensitive])
            for parameter in self.space.parameters
        ]
        return self._add_parameters(base, parameters, self._is_within_bound)

    def _add_parameters(
        self,
        base: Configuration,
        parameters: Sequence[Parameter],
        good: Callable[[Configuration], bool],
    ) -> Configuration:
        """Return a configuration with the best good value of each parameter that saves time.

        Each value is timed and measured alone, then all are combined. A value that is not good in
        the combination, or saves nothing in it, is dropped.
        """
        found = list[tuple[float, Settings]]()
        for saving in self._time_saving_values(base, parameters):
            for ratio, one in saving:
                if good(one):
                    found.append((ratio, _added_settings(one, base)))
                    break
                alone = split_condim(_added_settings(one, base))[:MAX_SINGLE_GEOMS]
                if kept := [each for each in alone if good(base.with_settings(each))]:
                    found.append((ratio, dict(ChainMap(*map(dict, kept)))))
                    break
        both = base
        for _, settings in sorted(found, key=lambda pair: pair[0]):
            if good(more := both.with_settings(settings)):
                both = more
        if both == base or not self._saves_time(both, base):
            return base
        return self._drop_useless(both, base, [settings for _, settings in found])

    def _time_saving_values(
        self, base: Configuration, parameters: Sequence[Parameter]
    ) -> Iterator[list[tuple[float, Configuration]]]:
        """Yield the values of each parameter that save time, the fastest first."""
        made = self.space.model_of(base)
        tried = [
            [
                base.with_settings(value)
                for value in parameter.values
                if changed_settings(value, made)
            ]
            for parameter in parameters
        ]
        last = [
            values[-1:] if parameter.cost_falls else values
            for parameter, values in zip(parameters, tried, strict=True)
        ]
        ratios = self._ratios_by_key([base, *chain(*last)])
        worth = MIN_SPEEDUP_RATIO * ratios[base.key]

        def saving(choices: Sequence[Configuration]) -> list[tuple[float, Configuration]]:
            found = [(ratios[one.key], one) for one in choices if ratios[one.key] < worth]
            return sorted(found, key=lambda pair: pair[0])

        less = [values for values, ends in zip(tried, last, strict=True) if saving(ends)]
        ratios |= self._ratios_by_key([one for one in chain(*less) if one.key not in ratios])
        yield from map(saving, less)

    def _drop_useless(
        self, choice: Configuration, base: Configuration, added: Sequence[Settings]
    ) -> Configuration:
        """Return a configuration without the added settings that save no time in combination."""
        parts = [part for part in added if part.keys() <= choice.settings.keys()]
        if len(parts) < 2:
            return choice
        without = [choice.with_reverted(part, base) for part in parts]
        own, *prices = self._time_together([choice, *without], _COMPARISON_TURNS)
        least = choice
        for part, price in zip(parts, prices, strict=True):
            if MIN_SPEEDUP_RATIO * price.ratio < own.ratio or price.low < own.ratio:
                least = least.with_reverted(part, base)
        if least in (choice, base):
            return choice
        self._check_time()
        beside = self.clock.compare_segments(
            self._model_at_step(choice), self._model_at_step(least), _COMPARISON_TURNS
        )
        if beside.is_less(MIN_SPEEDUP_RATIO):
            return choice
        self._error_of(least)
        self._time_ratios_of([least])
        return least

    def _saves_time(self, choice: Configuration, base: Configuration) -> bool:
        """Return whether a configuration is faster than another; if so, time it."""
        self._check_time()
        price = self.clock.compare_segments(
            self._model_at_step(choice), self._model_at_step(base), _COMPARISON_TURNS
        )
        if saves := price.is_less(by=LEAST_SAVING):
            self._time_ratios_of([choice])
        return saves

    def _search_step_alone(self) -> Configuration:
        """Return the longest step within the limit, with everything else as written, and time it.

        Later bounds start from the lossless model, which is as accurate and faster to measure.
        """
        own = self._lossless or self.current.with_reductions(self.space.start)
        found = self._longest_step(self._double_step(own), 1, _INTEGRATOR_STEP_RATIO) or own
        self._time_ratios_of([found])
        return found

    def _search_step(self, base: Configuration, alone: int) -> Configuration:
        """Return the configuration with the best integrator and timestep.

        Steps of the model's own integrator start from its longest step alone.
        """
        model = self.space.model
        choices = [
            base.with_settings(
                {INTEGRATOR: name} if changed_settings({INTEGRATOR: name}, model) else {}
            )
            for name in self.space.integrators
        ]
        prices = [price.ratio for price in self._time_together(choices)]
        if self.max_time_ratio is not None:
            return self._most_accurate(choices, prices)
        best, cost = None, math.inf
        for price, choice in zip(prices, choices, strict=True):
            # the shortest step that would be faster
            least = math.floor(price * choice.multiple / cost) + 1 if best else 1
            near = choice if best else choice.with_step(alone)
            if found := self._longest_step(near, least, _INTEGRATOR_STEP_RATIO):
                best, cost = found, price * choice.multiple / found.multiple
        if best is None:
            self._time_ratios_of([min(self.evaluations.values(), key=error_of).configuration])
            return base
        best = self._longest_step(best, best.multiple, _FINAL_STEP_RATIO) or best
        self._time_ratios_of([best])
        return best

    def _double_step(self, choice: Configuration) -> Configuration:
        """Return a configuration at the longest doubled step within the limit, or at its own.

        Errors may fall again with longer steps if contacts decide.
        """
        if self._is_within_bound(choice):
            doublings = int(math.log2(self.space.longest / choice.multiple))
            for doubling in range(doublings, 0, -1):
                if self._is_within_bound(longer := choice.with_step(choice.multiple << doubling)):
                    return longer
        return choice

    def _longest_step(
        self, choice: Configuration, least: int, close: float
    ) -> Configuration | None:
        """Return a configuration at its longest step of at least `least` within the limit."""
        shortest = min(self.space.substeps, 2)
        low = max(least, min(shortest, choice.multiple), 1)
        if low > self.space.longest:
            return None
        start = max(low, choice.multiple)
        if not self._is_within_bound(choice.with_step(start)):
            high = start
            if not self._is_within_bound(choice.with_step(low)):
                return None
        else:
            low, high = start, math.ceil(start * close**2) + 1
            while high <= self.space.longest and self._is_within_bound(choice.with_step(high)):
                low, high = high, 2 * high
            high = min(high, self.space.longest + 1)
        while high - low > 1 and high > close * low:
            middle = (low + high) // 2
            if self._is_within_bound(choice.with_step(middle)):
                low = middle
            else:
                high = middle
        return choice.with_step(low)

    def _try_neighboring_steps(self, base: Configuration) -> None:
        """Try the neighboring steps of a configuration that was extended."""
        for part in (1.25, 1.1):
            longer = base.with_step(max(base.multiple + 1, round(part * base.multiple)))
            if longer.multiple <= self.space.longest and self._is_within_bound(longer):
                self._time_ratios_of([longer])
                break
        shorter = base.with_step(max(1, min(base.multiple - 1, round(0.8 * base.multiple))))
        self._error_of(shorter)
        self._time_ratios_of([shorter])

    def _try_shorter_steps(self) -> None:
        """Try configurations above the limit at shorter steps, if they are still faster there."""
        best = min(map(_time_ratio_of, self.rank_candidates(self.bound)), default=math.inf)
        found = list[tuple[float, Configuration]]()
        for one in self.evaluations.values():
            if one.time_ratio and self.bound.accepted < error_of(one) < math.inf:
                multiple = math.floor(
                    one.configuration.multiple * self.bound.accepted / error_of(one)
                )
                if multiple >= min(self.space.substeps, 2):
                    about = _time_ratio_of(one) * one.configuration.multiple / multiple
                    found.append((about, one.configuration.with_step(multiple)))
        for about, choice in sorted(found, key=lambda pair: pair[0])[:MAX_SHORTER_STEPS]:
            if about < MIN_SPEEDUP_RATIO * best and self._is_within_bound(choice):
                self._time_ratios_of([choice])

    def _most_accurate(
        self, choices: Sequence[Configuration], prices: Sequence[float]
    ) -> Configuration:
        """Return the most accurate configuration at the shortest step that its time allows."""
        assert self.max_time_ratio is not None
        shortest = min(self.space.substeps, 2)
        steps = [
            choice.with_step(
                max(shortest, math.ceil(choice.multiple * price / self.max_time_ratio))
            )
            for price, choice in zip(prices, choices, strict=True)
        ]
        within = [choice for choice in steps if choice.multiple <= self.space.longest]
        for choice in within:
            self._error_of(choice)
        self._time_ratios_of(within)
        return min(within, key=self._error_of, default=choices[0])

    def evaluate_error(self, choice: Configuration) -> Evaluation:
        """Evaluate the error of a configuration after the search, without a deadline."""
        self.deadline = math.inf
        self._error_of(choice)
        return self._evaluation_of(choice)

    def evaluate(self, choice: Configuration) -> Evaluation:
        """Evaluate the error and the time of a configuration after the search."""
        found = self.evaluate_error(choice)
        self._time_ratios_of([choice])
        return found

    def shorter_steps(self, tried: Evaluation) -> Iterator[Configuration]:
        """Yield a configuration at ever shorter steps."""
        multiple = tried.configuration.multiple
        while multiple > 1:
            multiple = min(multiple - 1, math.floor(0.9 * multiple)) or 1
            yield tried.configuration.with_step(multiple)


def _added_settings(choice: Configuration, base: Configuration) -> Settings:
    """Return the settings of a configuration that another does not have."""
    return {
        name: setting
        for name, setting in choice.settings.items()
        if base.settings.get(name, ...) != setting
    }


def _time_ratio_of(tried: Evaluation) -> float:
    return tried.time_ratio.ratio if tried.time_ratio else math.inf


def error_of(tried: Evaluation) -> float:
    """Return the error of an evaluation; infinite if it was not measured."""
    return tried.error.error if tried.error else math.inf
