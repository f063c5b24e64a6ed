"""Laws of the clock, on a simulated machine: no test reads the time."""

import math
from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
import pytest

from contactlab.timing.interleaved import (
    TimingProtocol,
    compare_times,
    order_turns,
    ratios_of_samples,
    stopwatch,
    time_round,
    time_rounds,
    time_samples,
)

TRIALS = 200
# Of so many trials, 95 % less three standard errors.
LEAST_COVERED = 0.95 - 3 * math.sqrt(0.95 * 0.05 / TRIALS)


class Machine:
    """A machine whose turns take known times, with noise, spells and effects of order.

    Attributes:
        turns: the turns so far, by the number of the model.
    """

    def __init__(
        self,
        seed: int,
        *,
        noise: float = 0.0,
        disturbed: float = 0.0,
        first: float = 0.0,
        drift: float = 0.0,
    ) -> None:
        self._random, self.turns = np.random.default_rng(seed), list[int]()
        self._noise, self._disturbed = noise, disturbed
        self._first, self._drift = first, drift

    def timers(self, *times: float) -> list[Callable[[], float]]:
        """Return the timers of models that take these times."""
        return [
            lambda place=place, own=own: self._turn(place, own) for place, own in enumerate(times)
        ]

    def _turn(self, place: int, own: float) -> float:
        spent = own * math.exp(self._noise * self._random.normal())
        if self._random.random() < self._disturbed:
            spent *= 1 + self._random.exponential()
        if not self.turns or self.turns[-1] != place:
            spent += self._first  # its caches are those of another model
        spent += self._drift * len(self.turns)
        self.turns.append(place)
        return spent


@pytest.mark.parametrize(("noise", "disturbed"), [(0.02, 0.0), (0.02, 0.2), (0.1, 0.05)])
@pytest.mark.parametrize("truth", [1.0, 1.3])
def test_intervals_hold_the_truth_in_nineteen_of_twenty(
    noise: float, disturbed: float, truth: float
) -> None:
    """A model next to itself has a ratio of 1, and a planted ratio of 1.3 is found."""
    found = [
        compare_times(Machine(seed, noise=noise, disturbed=disturbed).timers(1.0, truth))[0]
        for seed in range(TRIALS)
    ]
    covered = np.mean([ratio.low <= truth <= ratio.high for ratio in found])
    assert covered >= LEAST_COVERED
    if truth > 1:
        # Of a fifth of turns that other work disturbs, by as much in the mean, 44 leave more doubt.
        assert np.mean([ratio.is_greater() for ratio in found]) > (0.95 if disturbed < 0.1 else 0.8)
    else:
        assert np.mean([ratio.is_equal() for ratio in found]) > 0.95


def test_a_machine_that_slows_down_steadily_favors_no_model() -> None:
    """Two models lose as much on the way there as they gain on the way back."""
    spent = time_rounds(Machine(0, drift=0.01).timers(1.0, 1.0), TimingProtocol(rounds=5, looks=1))
    assert spent[:, 0] == pytest.approx(spent[:, 1])


def test_the_caches_of_another_model_favor_no_model() -> None:
    """Rounds begin with one model after the other, and the one that turns back is warm in its."""
    (ratio,) = compare_times(Machine(0, first=0.2).timers(1.0, 1.0), TimingProtocol(rounds=6))
    assert ratio.low <= 1 <= ratio.high
    taken = time_rounds(Machine(0, first=0.2).timers(1.0, 1.0, 1.0), TimingProtocol(rounds=6))
    assert taken.sum(axis=0) == pytest.approx(taken.sum() / 3)


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_each_model_is_first_and_last_as_often(count: int) -> None:
    rounds = [order_turns(count, number) for number in range(count)]
    assert sorted(order[0] for order in rounds) == [*range(count)]
    for order in rounds:
        assert sorted(order) == sorted([*range(count)] * 2)
        assert order == order[::-1]


def test_counted_rounds_end_the_work() -> None:
    """A ratio that stays wide ends at the last look; one that is narrow ends at the first."""
    plan = TimingProtocol(rounds=6, looks=3, half_width=0.05)
    noisy, quiet = Machine(0, noise=1.0), Machine(0, noise=0.001)
    assert len(time_rounds(noisy.timers(1.0, 1.0), plan)) == 18
    assert len(time_rounds(quiet.timers(1.0, 1.0), plan)) == 6
    assert len(noisy.turns) == 2 * (1 + 2 * 18)


def test_only_models_with_wide_intervals_take_further_turns() -> None:
    plan = TimingProtocol(rounds=6, looks=3)
    quiet, noisy = Machine(0), Machine(0, noise=1.0)
    timers = [*quiet.timers(1.0, 2.0), *noisy.timers(3.0)]
    taken = time_rounds(timers, plan)
    assert np.isfinite(taken).sum(axis=0).tolist() == [18, 6, 18]
    assert quiet.turns.count(1) == 1 + 2 * 6
    assert (
        compare_times(Machine(0).timers(1.0, 2.0), plan)[0]
        == compare_times([*Machine(0).timers(1.0, 2.0), *Machine(0, noise=1.0).timers(3.0)], plan)[
            0
        ]
    )


def test_answers_do_not_depend_on_other_models() -> None:
    """A model that is slow, or refused by its engine, changes nothing about the others."""
    alone = compare_times(Machine(0).timers(1.0, 0.5))
    both = compare_times(Machine(0).timers(1.0, 0.5, 70.0, math.inf))
    assert both[0] == alone[0]
    assert both[2].ratio == math.inf


def test_a_stopwatch_reads_the_given_clock() -> None:
    read = iter([1.0, 3.5])
    done = list[str]()
    assert stopwatch(lambda: done.append("work"), lambda: next(read))() == 2.5
    assert done == ["work"]


def samples(generator: np.random.Generator, count: int) -> Iterator[list[Callable[[], float]]]:
    """Yield timers of seeds, which differ in length and in the ratio of two models."""
    for _ in range(count):
        base, apart = (math.exp(0.1 * generator.normal()) for _ in range(2))
        times = base, 0.5 * base * apart
        yield [lambda own=own: own * math.exp(0.01 * generator.normal()) for own in times]


def test_intervals_of_seeds_hold_the_truth() -> None:
    """Those that stop as soon as an interval is narrow miss it more often: 2 % more."""
    truth, covered = 0.5 * math.exp(0.1**2 / 2), list[bool]()
    for seed in range(TRIALS):
        taken = [*time_samples(samples(np.random.default_rng(seed), 24))]
        (ratio,) = ratios_of_samples(taken)
        covered.append(ratio.low <= truth <= ratio.high)
        assert ratio.half_width <= 0.05 or len(taken) == 24
    assert LEAST_COVERED - 0.02 <= np.mean(covered) < 1


def test_seeds_are_timed_until_every_interval_is_narrow() -> None:
    quiet, noisy = Machine(0), Machine(0, noise=1.0)
    timers = [[*quiet.timers(1.0, 2.0), *noisy.timers(3.0)]] * 24
    assert len([*time_samples(timers)]) == 24
    assert len([*time_samples([models[:2] for models in timers])]) == 6


def test_two_seeds_are_timed_in_any_case() -> None:
    taken = [*time_samples(samples(np.random.default_rng(0), 5), may_continue=lambda: False)]
    assert len(taken) == 2


def test_rounds_start_one_model_further() -> None:
    machine = Machine(0)
    timers = machine.timers(1.0, 1.0, 1.0)
    for number in range(3):
        time_round(timers, number)
    assert machine.turns == [0, 1, 2, 2, 1, 0, 1, 2, 0, 0, 2, 1, 2, 0, 1, 1, 0, 2]
    assert sum(one == two for one, two in pairwise(machine.turns)) == 3
