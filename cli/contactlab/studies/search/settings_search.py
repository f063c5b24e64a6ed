"""The search: the order in which configurations are tried, and the best of them.

Everything is decided by errors and by counted work, in a fixed order, so that the same search has
the same result on any machine and under any load. Exact savings come first: settings that change
no bit of the motion. Then every setting that saves work and adds hardly any error; then integrator
and timestep; then settings that save work within the allowed error. Then the front: each integrator
at its own ladder of steps, from finer than as written to as coarse as the tolerance allows, then
sleep, which whole runs are needed for. A time limit ends the search early.
"""

import itertools
import math
from collections import ChainMap
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, Protocol

import mujoco

from contactlab.modifications.modification import Settings
from contactlab.modifications.numerics import SLEEP_SETTINGS
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.schema.time_ratio import LEAST_SAVING, TimeRatio
from contactlab.step_progress import StepCount, finish_step, step_count
from contactlab.studies.search.configuration import (
    AS_WRITTEN,
    INTEGRATOR,
    Configuration,
    Key,
    Reductions,
    changed_settings,
)
from contactlab.studies.search.search_space import Parameter, split_condim
from contactlab.tasks.reference_error import ErrorEstimate

SAVING = 1 - LEAST_SAVING
"""Share of the work below which a setting saves work. A line that saves less is not worth it."""
SURE_COST = 0.87
"""Counted share of the work of the model as written: a setting with more may not be faster.

For nine in ten models, the count is within 13 % of the time (see `budget.step_work`). Other work of
the machine changes no count, and so changes no advice.
"""
STEP_MARGIN = 0.8
"""Largest share of a failed timestep that is recommended."""
EQUAL_ERROR_RATIO = 1.02
"""Ratio of errors up to which they are equal: at equal steps both have the same noise."""
_LOSSLESS_SHARE = (
    0.05  # share of the limit that a lossless setting may add to the error of the model
)
_MOST_GEOMS = 12
"""Geoms whose contacts are tried one by one; more would crowd the patch, and take long."""
_ACCURATE = "RK4"  # has the finest steps first, if work ends the search

_UNUSED: Reductions = frozenset({"unused"})
Ending = Literal["complete", "work", "time"]


class OutOfWorkError(Exception):
    """The search has done its share of counted work."""


class OutOfTimeError(Exception):
    """The time limit was reached."""


class ErrorEstimator(Protocol):
    """Estimates the error of a model at a timestep of `multiple` fine steps."""

    def estimate_error(self, model: mujoco.MjModel, multiple: int) -> ErrorEstimate:
        """Return the error."""
        raise NotImplementedError


class CostMeter(Protocol):
    """Counts the work of models."""

    def count_cost(self, model: mujoco.MjModel, multiple: int) -> float:
        """Return the counted work per simulated second, over that of the model as written.

        The timestep is `multiple` fine steps.
        """
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
    def as_current(cls, now: float, floor: float = 0.0, chance: float = 0.0) -> "Bound":
        """Return the bound that equals the error of the model as written, or a floor if larger.

        An equal error may be larger by `chance`.
        """
        return cls(max(now, floor), max(EQUAL_ERROR_RATIO * now, now + chance, floor))

    def or_as_current(self, now: float) -> "Bound":
        """Return the wider of both bounds; at equal steps, equal errors have the same noise."""
        if now > self.limit:
            return self
        return Bound(self.limit, max(self.accepted, EQUAL_ERROR_RATIO * now))


@dataclass
class Evaluation:
    """A configuration, and everything that was measured of it.

    Attributes:
        cost: counted work per simulated second, over that of the model as written.
        exact: whether each bit of the task's motion is that of the model as written.
        time_ratio: measured time over that of the model as written; only of what is reported.
    """

    configuration: Configuration
    error: ErrorEstimate | None = None
    cost: float = math.inf
    exact: bool = False
    time_ratio: TimeRatio | None = None


@dataclass(frozen=True)
class SearchSpace:
    """The search space.

    Attributes:
        models: compiled models by reductions.
        start: reductions of all candidates.
        substeps: fine steps in a timestep of the model as written.
        steps: usable timesteps in fine steps, ascending, with that of the model as written.
        parameters: settings to search.
        integrators: integrators to try, the model's own first.
        simplified: reductions of the start and simplified hulls; None if not requested.
        may_sleep: whether awake bodies may sleep instead.
    """

    models: Mapping[Reductions, mujoco.MjModel]
    start: Reductions
    substeps: int
    steps: Sequence[int]
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
    """A search for the fastest configuration within a bound, or the most accurate within a cost.

    Attributes:
        bounds: on the error, searched in order, each with an equal share of the remaining work.
        max_cost: largest cost, if the error is minimized.
        work: counted work of the search for bounds, in tasks of the model as written.
        front_limit: largest error of the front.
        front_work: counted work of the front, besides.
        sleep_work: work of an estimate with sleep, over that of one without.
        is_late: whether the time of the search is over.
        is_exact: whether a model moves as the model as written, bit for bit.
        evaluations: evaluated configurations by key.
        ending: whether all trials were made; otherwise, whether work or time ended them.
    """

    space: SearchSpace
    estimator: ErrorEstimator
    meter: CostMeter
    bounds: Sequence[Bound]
    max_cost: float | None
    work: float
    is_late: Callable[[], bool]
    is_exact: Callable[[mujoco.MjModel], bool] = lambda _: False
    front_limit: float = 0.0
    front_work: float = 0.0
    sleep_work: float = 1.0
    evaluations: dict[Key, Evaluation] = field(default_factory=dict[Key, "Evaluation"])
    ending: Ending = "complete"
    work_done: float = 0.0
    _work_limit: float = math.inf
    _progress: StepCount = field(default_factory=lambda: StepCount("", 1.0))

    @property
    def current(self) -> Configuration:
        """The model as written."""
        return Configuration({}, self.space.substeps)

    @property
    def trials(self) -> int:
        """Number of trials that a search without limits makes at most, for each bound."""
        values = sum(len(each.values) + len(each.step_sensitive) for each in self.space.parameters)
        return 1 + 2 * values + 2 * len(self.space.steps) * len(self.space.integrators)

    def evaluate_current(self) -> Evaluation:
        """Evaluate the model as written, whatever time is left."""
        entry = self._evaluation_of(self.current)
        entry.cost = 1.0
        if entry.error is None:
            model = self.space.model_of(self.current)
            entry.error = self.estimator.estimate_error(model, self.current.multiple)
            self.work_done += 1.0
        return entry

    @property
    def work_left(self) -> float:
        """Counted work that a complete search did not need, in tasks of the model as written."""
        left = self.work + self.front_work - self.work_done
        return max(0.0, left) if self.ending == "complete" else 0.0

    def run_search(self) -> None:
        """Search until nothing is left to try, or until work or time are over."""
        with step_count("work of the search", self.work + self.front_work) as self._progress:
            self._search_all()

    def _search_all(self) -> None:
        try:
            self.evaluate_current()
            best_of_bounds = list[tuple[Bound, Configuration]]()
            for place, bound in enumerate(self.bounds):
                self.bound = bound
                self._work_limit = self.work_done + (self.work - self.work_done) / (
                    len(self.bounds) - place
                )
                try:
                    if best := self._search_bound():
                        best_of_bounds.append((bound, best))
                except OutOfWorkError:
                    self.ending = "work"
            self._work_limit = self.work_done + self.front_work
            try:
                self._search_ladders()
                for self.bound, best in best_of_bounds:
                    self._try_sleep(best)
                self._search_between()
            except OutOfWorkError:
                self.ending = "work"
        except OutOfTimeError:
            self.ending = "time"

    def _search_ladders(self) -> None:
        # They come before refinements, so that a slow model has both ends of its front.
        if not self.front_limit:
            return
        bases = {
            name: self._exact_base.with_settings(
                changed_settings({INTEGRATOR: name}, self.space.model)
            )
            for name in self.space.integrators
        }
        for base in bases.values():
            self._evaluate_choice(base)
        distinct = list[str]()
        for name in sorted(bases, key=lambda name: self._cost_of(bases[name])):
            if not self._moves_like_cheaper(name, distinct):
                distinct.append(name)
                self._try_longer_steps(name, bases[name])
        for name in sorted(distinct, key=lambda name: name != _ACCURATE):
            self._try_finer_steps(self._without_error(name), bases[name])

    def _search_between(self) -> None:
        if self.max_cost is None and self.front_limit > max(each.limit for each in self.bounds):
            self.bound = Bound.of(self.front_limit)
            if best := self._search_bound():
                self._try_sleep(best)
        if self.front_limit:
            self._cross_front()

    def _without_error(self, integrator: str) -> Configuration:
        own = changed_settings({INTEGRATOR: integrator}, self.space.model)
        return self._lossless_base.with_settings(own)

    def _moves_like_cheaper(self, name: str, cheaper: Sequence[str]) -> bool:
        # Whether an integrator is no more accurate than a cheaper one.
        #
        # Integrators differ in how they treat damping, velocities and bias forces. A model without
        # these moves alike at its own step and at the longest one within the tolerance.
        mine = self._without_error(name)
        for other in map(self._without_error, cheaper):
            within = [
                multiple
                for multiple in self.space.steps
                if multiple >= self.space.substeps
                and (evaluation := self.evaluations.get(other.with_step(multiple).key))
                and error_of(evaluation) <= self.front_limit
            ]
            both = dict.fromkeys((self.space.substeps, max(within, default=self.space.substeps)))
            if all(
                EQUAL_ERROR_RATIO * self._error_of(mine.with_step(multiple))
                >= self._error_of(other.with_step(multiple))
                for multiple in both
            ):
                return True
        return False

    def _cross_front(self) -> None:
        # Evaluate the settings of each point of the front at the steps of the others.
        #
        # A setting is first tried at one step; at others it may save as much, with less error.
        crossed = set[Key]()
        while True:
            accurate = [
                one for one in self.evaluations.values() if error_of(one) <= self.front_limit
            ]
            points = find_undominated(accurate)
            pairs = [
                (point, self._combine_settings(point.configuration, other.configuration))
                for point, other in itertools.product(points, points)
            ]
            new = [
                (point, crossing)
                for point, crossing in pairs
                if crossing.key not in self.evaluations
            ]
            new = [(point, crossing) for point, crossing in new if crossing.key not in crossed]
            if not new:
                return
            for point, crossing in new:
                crossed.add(crossing.key)
                if self._saves_work(crossing, point.configuration) and self._can_afford(crossing):
                    self._evaluate_choice(crossing)

    @staticmethod
    def _combine_settings(choice: Configuration, other: Configuration) -> Configuration:
        own = {name: value for name, value in choice.settings.items() if name == INTEGRATOR}
        more = {name: value for name, value in other.settings.items() if name != INTEGRATOR}
        return replace(choice, settings={**more, **own}, reductions=other.reductions)

    def _try_longer_steps(self, name: str, exact: Configuration) -> None:
        """Evaluate ever longer steps, with the settings that add hardly any error.

        An integrator whose own error is as small as theirs is evaluated without them, too.
        """
        cheap = self._without_error(name)
        small = 2 * _LOSSLESS_SHARE * min(bound.limit for bound in self.bounds)
        for multiple in (each for each in self.space.steps if each >= self.space.substeps):
            error = self._error_of(cheap.with_step(multiple))
            if error <= small:
                self._error_of(exact.with_step(multiple))
            if error > self.front_limit and multiple > self.space.substeps:
                break

    def _try_finer_steps(self, cheap: Configuration, exact: Configuration) -> None:
        """Evaluate ever finer steps until none of a quarter of the best step gains accuracy.

        Errors of few seeds are too noisy to end it earlier. If settings that add hardly any error,
        or a solver that stops early, are a large part of the error of a step, they are left out
        from there on.
        """
        base, best = cheap, self._evaluate_choice(cheap)
        most_cost = 50.0  # of the most accurate points, over the model as written
        settings_share = 0.3  # of an error above which the settings are worth leaving out
        useless_finer = 4  # times finer steps that gain nothing end the ladder
        for multiple in reversed([each for each in self.space.steps if each < cheap.multiple]):
            if self._cost_of(base.with_step(multiple)) > most_cost:
                break
            evaluation = self._evaluate_choice(base.with_step(multiple))
            # Half of what a method of first order gains.
            most = math.sqrt(multiple / best.configuration.multiple) * error_of(best)
            if error_of(evaluation) > most:
                for other in (exact, self._with_converged_solver(exact)):
                    if self._added_error(base, other) > settings_share * error_of(evaluation):
                        base = other
                        evaluation = self._evaluate_choice(base.with_step(multiple))
            if error_of(evaluation) <= most:
                best = evaluation
            elif useless_finer * multiple <= best.configuration.multiple:
                break

    def _added_error(self, choice: Configuration, exact: Configuration) -> float:
        # Return the error that settings add, from errors at the own step, where both are cheap.
        #
        # It adds to that of the step as if at a right angle, so that a small difference says much.
        both = [self._error_of(one.with_step(self.space.substeps)) for one in (choice, exact)]
        return math.sqrt(abs(both[0] ** 2 - both[1] ** 2)) if math.isfinite(sum(both)) else math.inf

    def _with_converged_solver(self, choice: Configuration) -> Configuration:
        option = self.space.model_of(choice).opt
        converged = {
            "solver": "Newton",
            "iterations": max(100, int(option.iterations)),
            "tolerance": min(1e-10, float(option.tolerance)),
        }
        return choice.with_settings(changed_settings(converged, self.space.model_of(choice)))

    def _search_bound(self) -> Configuration | None:
        # Return the best configuration, except for sleep.
        base = self._lossless_base
        if self.max_cost is not None:
            self._search_accuracy(base)
            return None
        best = self._search_steps(base)
        return best and self._drop_useless(self._add_lossy(best))

    def rank_candidates(self, bound: Bound) -> list[Evaluation]:
        """Return the candidates within a bound, the best first; ties go to the simpler one."""
        measured_candidates = [
            one
            for one in self.evaluations.values()
            if one.error and self.keeps_margin(one, bound.accepted)
        ]
        if self.max_cost is not None:
            return sorted(
                (one for one in measured_candidates if one.cost <= self.max_cost), key=error_of
            )
        return sorted(
            (one for one in measured_candidates if error_of(one) <= bound.accepted),
            key=self._rank_tried,
        )

    def _rank_tried(self, evaluation: Evaluation) -> tuple[float, int]:
        # Costs within the smallest saving are ties.
        level = (
            round(math.log(evaluation.cost) / math.log(1 / SAVING))
            if evaluation.cost > 0
            else -(10**6)
        )
        return level, self.count_changes(evaluation.configuration)

    def count_changes(self, choice: Configuration) -> int:
        """Return the number of changed lines of a configuration, as far as known."""
        step = choice.multiple != self.space.substeps
        own = changed_settings(choice.settings, self.space.model)
        return len(own) + step + len(choice.reductions)

    def keeps_margin(self, evaluation: Evaluation, accepted: float) -> bool:
        """Return whether a timestep is far enough below those that failed with its settings.

        Steps fail whose error is larger than `accepted`.
        """
        choice = evaluation.configuration
        if choice.multiple <= self.space.substeps:
            return True
        failed = (
            one.configuration.multiple
            for one in self.evaluations.values()
            if one.configuration.key[1:] == choice.key[1:]
            and one.error
            and error_of(one) > accepted
        )
        return not any(STEP_MARGIN * step < choice.multiple < step for step in failed)

    def closest_to(self, limit: float, failed: Container[Key] = ()) -> Evaluation | None:
        """Return the candidate that is closest to an unmet target.

        For an error: the cheapest within the limit that did not fail on fresh seeds, since the time
        limit left it unverified; otherwise the one with the least error.
        """
        measured_candidates = [one for one in self.evaluations.values() if one.error]
        if self.max_cost is not None:
            return min(measured_candidates, key=cost_of, default=None)
        likely = [
            one
            for one in self.rank_candidates(Bound.of(limit))
            if one.configuration.key not in failed
        ]
        return next(iter(likely), None) or min(measured_candidates, key=error_of, default=None)

    def evaluate(self, choice: Configuration) -> Evaluation:
        """Evaluate a configuration after the search, without limits."""
        self._work_limit, self.is_late = math.inf, bool
        return self._evaluate_choice(choice)

    def shorter_steps(self, evaluation: Evaluation) -> Iterator[Configuration]:
        """Yield a configuration at ever shorter usable steps.

        None takes more than a quarter of the work of a search, as sleep of a slow model does.
        """
        self._work_limit, self.is_late = math.inf, bool
        for multiple in reversed(self.space.steps):
            choice = evaluation.configuration.with_step(multiple)
            is_shorter = multiple < evaluation.configuration.multiple
            if is_shorter and self._count_work(choice) <= self.work / 4:
                yield choice

    def without_lossy(self, choice: Configuration) -> Configuration:
        """Return a configuration without settings that add error, except integrator and step."""
        lossless = self._lossless_base.settings
        kept_settings = {
            name: value if name == INTEGRATOR else lossless[name]
            for name, value in choice.settings.items()
            if name == INTEGRATOR or name in lossless
        }
        return replace(choice, settings=kept_settings)

    def _check_limits(self) -> None:
        if self.is_late():
            raise OutOfTimeError
        if self.work_done > self._work_limit:
            raise OutOfWorkError

    def _evaluation_of(self, choice: Configuration) -> Evaluation:
        return self.evaluations.setdefault(choice.key, Evaluation(choice))

    def _evaluate_choice(self, choice: Configuration) -> Evaluation:
        entry = self._evaluation_of(choice)
        self._cost_of(choice)
        if entry.error is None:
            self._check_limits()
            estimate = self.estimator.estimate_error(self.space.model_of(choice), choice.multiple)
            entry.error = estimate
            self.work_done += self._count_work(choice)
            finish_step(self._progress, self.work_done - self._progress.finished_steps)
        return entry

    def _count_work(self, choice: Configuration) -> float:
        cost = self._cost_of(choice)
        passes = self.sleep_work if choice.settings.get("sleep") else 1.0
        return passes * (cost if math.isfinite(cost) else 1.0)

    def _can_afford(self, choice: Configuration) -> bool:
        return self.work_done + self._count_work(choice) <= self._work_limit

    def _error_of(self, choice: Configuration) -> float:
        return error_of(self._evaluate_choice(choice))

    def _cost_of(self, choice: Configuration) -> float:
        # Counting the cost is a small part of estimating errors.
        entry = self._evaluation_of(choice)
        if math.isinf(entry.cost):
            self._check_limits()
            entry.cost = self.meter.count_cost(self.space.model_of(choice), choice.multiple)
        return entry.cost

    def _is_within_bound(self, choice: Configuration) -> bool:
        return self._error_of(choice) <= self.bound.accepted

    def _saves_work(self, choice: Configuration, base: Configuration) -> bool:
        return self._cost_of(choice) < SAVING * self._cost_of(base)

    @cached_property
    def _lossless_base(self) -> Configuration:
        """The model without anything that costs work and adds no error, at its own step.

        All bounds start from it. The smallest bound decides which added error counts as none, and
        bounds that the model as written satisfies stay satisfied.
        """
        base = self._exact_base
        base = self._with_faster_base(base)
        own = self._error_of(base)
        accepted_errors = [bound.accepted for bound in self.bounds if own <= bound.accepted]
        most = own + _LOSSLESS_SHARE * min(bound.limit for bound in self.bounds)
        most = min([most, *accepted_errors])
        with suppress(OutOfWorkError):
            base = self._add_parameters(
                base, self.space.parameters, lambda one: self._error_of(one) <= most
            )
        base = self._drop_useless(base, most)
        self._evaluate_milder(base)
        return base

    def _evaluate_milder(self, choice: Configuration) -> None:
        milder = self._milder_choice(choice)
        while milder != choice and self._saves_work(milder, self.current):
            self._evaluate_choice(milder)
            choice, milder = milder, self._milder_choice(milder)

    def _milder_choice(self, choice: Configuration) -> Configuration:
        """Return a configuration with the next milder value of each parameter that has one."""
        for parameter in self.space.parameters:
            values = list(parameter.values) if parameter.cost_falls else []
            for value, milder in itertools.pairwise(values[::-1]):
                if value.items() <= choice.settings.items():
                    choice = choice.with_settings(milder)
                    break
        return choice

    @cached_property
    def _exact_base(self) -> Configuration:
        """The cheapest configuration whose motion is that of the model as written.

        It holds whatever else is measured, so that a slow model has a result early.
        """
        exact = self.current.with_reductions(self.space.start)
        if "far-pairs" in self.space.start:
            return exact
        self._evaluate_choice(exact).exact = True

        def moves_alike(choice: Configuration) -> bool:
            self._check_limits()
            if not self.is_exact(self.space.model_of(choice)):
                return False
            self.work_done += self._cost_of(choice)
            return True

        fastest_exact = self._add_parameters(exact, self.space.parameters, moves_alike)
        self._evaluate_choice(fastest_exact).exact = True
        return fastest_exact

    def _with_faster_base(self, base: Configuration) -> Configuration:
        """Return a configuration with Newton's solver, and with simplified hulls on request.

        Each must save work within the bound. Another solver would slow down the whole search.
        """
        choices = list[Configuration]()
        newton = changed_settings({"solver": "Newton"}, self.space.model_of(base))
        if newton:
            choices.append(base.with_settings(newton))
        if self.space.simplified is not None:
            choices.append(base.with_reductions(self.space.simplified))
        limit = min(bound.limit for bound in self.bounds)
        accepted = max(bound.accepted for bound in self.bounds)
        most = max(self._error_of(base) + _LOSSLESS_SHARE * limit, accepted)
        for choice in choices:
            more = replace(choice, settings={**base.settings, **choice.settings})
            if self._saves_work(more, base) and self._error_of(more) <= most:
                base = more
        return base

    def _add_lossy(self, base: Configuration) -> Configuration:
        """Return a configuration with settings that save work within the bound."""
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
        """Return a configuration with the best good value of each parameter that saves work.

        Each value is counted and measured alone, then all are combined. A value that is not good in
        the combination, or saves nothing in it, is dropped.
        """
        costs_of_settings = list[tuple[float, Settings]]()
        ended = False
        try:
            for parameter in parameters:
                if settings := self._best_value(base, parameter, good):
                    costs_of_settings.append(
                        (self._cost_of(base.with_settings(settings)), settings)
                    )
        except OutOfWorkError:
            # Good values of a slow model are worth little alone.
            ended, self._work_limit = (
                True,
                self.work_done + sum(cost for cost, _ in costs_of_settings),
            )
        both = base
        for _, settings in sorted(costs_of_settings, key=lambda pair: pair[0]):
            more = both.with_settings(settings)
            if self._saves_work(more, both) and good(more):
                both = more
        if ended:
            raise OutOfWorkError
        return both

    def _best_value(
        self, base: Configuration, parameter: Parameter, good: Callable[[Configuration], bool]
    ) -> Settings:
        """Return the good value that saves most work; of ties the one nearest to the base.

        If no value of all geoms together is good, geoms are tried one by one.
        """
        model_of_base = self.space.model_of(base)
        choices = [
            base.with_settings(value)
            for value in parameter.values
            if changed_settings(value, model_of_base)
        ]
        if parameter.cost_falls and choices and not self._saves_work(choices[-1], base):
            return {}
        saving = [one for one in choices if self._saves_work(one, base)]
        for cheapest in sorted(saving, key=self._cost_of):
            tied = SAVING * self._cost_of(base)
            tied = min(tied, self._cost_of(cheapest) / SAVING)
            near = (one for one in saving if self._cost_of(one) <= tied)
            for one in (*near, cheapest):
                if good(one):
                    return _added_settings(one, base)
            alone = split_condim(_added_settings(cheapest, base))
            share = min(1.0, _MOST_GEOMS / max(1, len(alone)))
            saved = share * (1 - self._cost_of(cheapest) / self._cost_of(base))
            # Few of many geoms save too little.
            alone = alone[:_MOST_GEOMS] if saved > 1 - SAVING else []
            if good_values := [each for each in alone if good(base.with_settings(each))]:
                return dict(ChainMap(*map(dict, good_values)))
        return {}

    def _drop_useless(self, choice: Configuration, most: float | None = None) -> Configuration:
        """Return a configuration without changes that save no work in combination.

        Each is tested by leaving it out, and those that are left out save nothing together either.
        `most` is the largest error, by default the bound.
        """
        accepted, whole = self.bound.accepted if most is None else most, choice
        for without in self._simpler_choices(choice):
            simpler = without(choice)
            if simpler is None:
                continue
            if not self._saves_work(whole, simpler) and self._error_of(simpler) <= accepted:
                choice = simpler
        return choice

    def _simpler_choices(
        self, choice: Configuration
    ) -> list[Callable[[Configuration], Configuration | None]]:
        def without_settings(names: Sequence[str]) -> Callable[..., Configuration | None]:
            def drop(own: Configuration) -> Configuration | None:
                other_settings = {
                    key: value for key, value in own.settings.items() if key not in names
                }
                return (
                    replace(own, settings=other_settings)
                    if len(other_settings) < len(own.settings)
                    else None
                )

            return drop

        def without_reductions(own: Configuration) -> Configuration | None:
            return own.with_reductions(AS_WRITTEN) if own.reductions == _UNUSED else None

        # More geoms than are tried one by one stay or go together.
        names = [name.partition("[")[0] for name in choice.settings]
        groups = dict[str, list[str]]()
        for name, kind in zip(choice.settings, names, strict=True):
            groups.setdefault(kind if names.count(kind) > _MOST_GEOMS else name, []).append(name)
        return [*map(without_settings, [*groups.values()][::-1]), without_reductions]

    def _search_steps(self, base: Configuration) -> Configuration | None:
        """Return the configuration with the best integrator and timestep; None if none is good."""
        model, best = self.space.model, None
        for name in self.space.integrators:
            own = changed_settings({INTEGRATOR: name}, model)
            choice = base.with_settings(own) if own else base
            longest = self._longest_step(choice, best)
            if longest and (best is None or self._saves_work(longest, best)):
                best = longest
        return best

    def _longest_step(
        self, choice: Configuration, best: Configuration | None
    ) -> Configuration | None:
        """Return a configuration at its longest usable step within the bound.

        If it is within the bound at its own step, longer steps are tried until two in a row fail;
        otherwise shorter ones. Only steps that save work over `best` are tried.
        """
        own = self.current.multiple
        longer = [multiple for multiple in self.space.steps if multiple >= own]
        longest, failed = None, 0
        for multiple in longer:
            candidate = choice.with_step(multiple)
            if best is not None and not self._saves_work(candidate, best):
                continue
            if self._is_within_bound(candidate):
                longest, failed = candidate, 0
            else:
                failed += 1
                # After two failed timesteps in a row, longer ones are not tried.
                if failed == 2 or multiple == own:
                    break
        if longest:
            return self._with_margin(longest)
        for multiple in reversed([each for each in self.space.steps if each < own]):
            candidate = choice.with_step(multiple)
            if best is not None and not self._saves_work(candidate, best):
                return None
            if self._is_within_bound(candidate):
                return candidate
        return None

    def _with_margin(self, longest: Configuration) -> Configuration | None:
        """Return a configuration at this step, or at the next one that keeps the margin."""
        for multiple in reversed([each for each in self.space.steps if each <= longest.multiple]):
            choice = longest.with_step(multiple)
            if self._is_within_bound(choice) and self.keeps_margin(
                self._evaluate_choice(choice), self.bound.accepted
            ):
                return choice
            if multiple <= self.space.substeps:
                break
        return None

    def _try_sleep(self, base: Configuration) -> None:
        if not self.space.may_sleep or not self._is_within_bound(base):
            return
        asleep = base.with_settings(SLEEP_SETTINGS)
        if self._saves_work(asleep, base) and self._can_afford(asleep):
            self._is_within_bound(asleep)

    def _search_accuracy(self, base: Configuration) -> None:
        """Evaluate each integrator at the shortest usable step that its cost allows."""
        assert self.max_cost is not None
        for name in self.space.integrators:
            own = changed_settings({INTEGRATOR: name}, self.space.model)
            choice = base.with_settings(own) if own else base
            for multiple in self.space.steps:
                if self._cost_of(choice.with_step(multiple)) <= self.max_cost:
                    self._error_of(choice.with_step(multiple))
                    break


def _added_settings(choice: Configuration, base: Configuration) -> Settings:
    """Return the settings of a configuration that another does not have."""
    return {
        name: setting
        for name, setting in choice.settings.items()
        if base.settings.get(name, ...) != setting
    }


def find_usable_steps(
    own: float, fine: float, longest: float, period: float | None
) -> tuple[int, ...]:
    """Return the timesteps that people can use, in fine steps, with the model's own.

    They divide the period of a controller. Without one they are 1, 2, 2.5, 4, 5 or 8 times a power
    of ten. If the model's own step is not such a number, its whole multiples and whole parts are
    usable as well.

    Args:
        own: timestep of the model as written [s].
        fine: fine step, which all candidates are multiples of [s].
        longest: longest timestep [s].
        period: of the controller [s], if there is one.
    """
    multiples = {round(own / fine)}
    for multiple in range(1, max(1, math.floor(longest / fine * (1 + SUM_ROUNDING))) + 1):
        step = multiple * fine
        if period is not None:
            usable = _is_whole(period / step)
        else:
            longer = step / own
            doubled = _is_whole(longer) and math.log2(round(longer)).is_integer()
            related = not _is_round(own) and (_is_whole(own / step) or doubled)
            usable = _is_round(step) or related
        if usable:
            multiples.add(multiple)
    return tuple(sorted(multiples))


def _is_whole(ratio: float) -> bool:
    return round(ratio) >= 1 and abs(ratio - round(ratio)) <= SUM_ROUNDING * ratio


def _is_round(step: float) -> bool:
    round_numbers = (1.0, 2.0, 2.5, 4.0, 5.0, 8.0)
    digits = step / 10 ** math.floor(math.log10(step) + SUM_ROUNDING)
    return any(math.isclose(digits, number, rel_tol=SUM_ROUNDING) for number in round_numbers)


def find_undominated(candidates: Iterable[Evaluation]) -> list[Evaluation]:
    """Return the candidates that no other one beats in error and cost, the most accurate first."""
    undominated, best = list[Evaluation](), math.inf
    for one in sorted(candidates, key=lambda one: (cost_of(one), error_of(one))):
        if error_of(one) < best:
            undominated.append(one)
            best = error_of(one)
    return undominated[::-1]


def cost_of(evaluation: Evaluation) -> float:
    """Return the counted cost of an evaluation; infinite if it was not counted."""
    return evaluation.cost


def error_of(evaluation: Evaluation) -> float:
    """Return the error of an evaluation; infinite if it was not measured."""
    return evaluation.error.error if evaluation.error else math.inf
