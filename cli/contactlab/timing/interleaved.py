"""Times models in turns, from the first to the last and back, and compares each with the first.

A machine is slower at some times than at others, and the first in a turn finds other caches than
the last. In a round each model has a turn on the way there and one on the way back, so that a
machine that slows down steadily favors none. Rounds begin with one model after the other, so that
being first favors none either. Only the means of a round are compared, as matched pairs.

The number of rounds follows from counted turns and from the intervals, never from a time limit: a
busy machine gives wider intervals, and no other answer.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.schema.time_ratio import BUILD_NOISE, TimeRatio

Timer = Callable[[], float]
"""Does the work of one turn, and returns its time [s]; infinite if the engine refuses it."""


@dataclass(frozen=True)
class TimingProtocol:
    """How often models take turns.

    Attributes:
        rounds: rounds until the intervals are looked at, and until each further look. An interval
            of a median needs 6 to hold it with 95 %; with 11 it holds it with 98.8 %, which leaves
            95 % after a further look.
        looks: most looks. The counted work ends there.
        half_width: half of an interval that is narrow enough, as a share of the ratio.
        warm_turns: turns before, which count nothing: the first run of a model loads its memory.
    """

    rounds: int = 11
    looks: int = 2
    half_width: float = BUILD_NOISE
    warm_turns: int = 1


TURN_SECONDS = 2.5e-3
"""Time of a turn of a fast model [s], several thousand times that of a look at the clock."""


def stopwatch(work: Callable[[], object], read_clock: Callable[[], float] | None = None) -> Timer:
    """Return a timer of some work, by the CPU time of this thread or another clock [s]."""

    def measure() -> float:
        clock = read_clock or time.thread_time
        begin = clock()
        work()
        return clock() - begin

    return measure


def order_turns(count: int, number: int) -> list[int]:
    """Return the order of the turns of models in a round: there and back."""
    there = [(number + place) % count for place in range(count)]
    return there + there[::-1]


def time_round(timers: Sequence[Timer], number: int = 0) -> Floats:
    """Return (K,) mean times of the two turns of each model in a round [s]."""
    spent = np.zeros(len(timers))
    for place in order_turns(len(timers), number):
        spent[place] += timers[place]()
    return spent / 2


def time_rounds(timers: Sequence[Timer], protocol: TimingProtocol | None = None) -> Floats:
    """Return (N, K) times of models by round [s], until all ratios to the first are narrow.

    A model with a narrow ratio takes part in no further round, where its time is NaN.
    """
    plan = protocol or TimingProtocol()
    for _ in range(plan.warm_turns):
        for timer in timers:
            timer()
    all_times, wide = list[Floats](), [*range(len(timers))]
    for _ in range(plan.looks):
        for _ in range(plan.rounds):
            times = np.full(len(timers), np.nan)
            times[wide] = time_round([timers[place] for place in wide], len(all_times))
            all_times.append(times)
        ratios = enumerate(ratios_of_rounds(all_times), 1)
        wide = [0, *(place for place, ratio in ratios if not ratio.half_width <= plan.half_width)]
        if wide == [0]:
            break
    return np.array(all_times)


def ratios_of_rounds(round_times: Sequence[Floats] | Floats) -> list[TimeRatio]:
    """Return the ratio of each model to the first, from (N, K) times of the same work by round."""
    base, *models = np.array(round_times).T
    return [TimeRatio.of_pairs((model / base)[~np.isnan(model)].tolist()) for model in models]


def compare_times(
    timers: Sequence[Timer], protocol: TimingProtocol | None = None
) -> list[TimeRatio]:
    """Return the time of each model over that of the first, for the same work in each round."""
    return ratios_of_rounds(time_rounds(timers, protocol))


def time_samples(
    samples: Iterable[Sequence[Timer]],
    *,
    rounds: int = 2,
    least: int = 2,
    enough: int = 6,
    half_width: float = BUILD_NOISE,
    may_continue: Callable[[], bool] = lambda: True,
) -> Iterator[Floats]:
    """Yield (K,) times of models for one sample of work after the other, such as seeds [s].

    Args:
        samples: timers of the models, for each sample.
        rounds: rounds of each sample.
        least: samples that are timed in any case: one shows no spread.
        enough: samples with a spread that is known well enough to stop at narrow intervals.
        half_width: half of an interval that is narrow enough, as a share of the ratio.
        may_continue: whether more than the least samples may be timed.
    """
    all_samples = list[Floats]()
    for timers in samples:
        if len(all_samples) >= least and not may_continue():
            return
        all_samples.append(
            np.mean([time_round(timers, number) for number in range(rounds)], axis=0)
        )
        yield all_samples[-1]
        ratios = ratios_of_samples(all_samples) if len(all_samples) >= enough else []
        if ratios and all(ratio.half_width <= half_width for ratio in ratios):
            return


def ratios_of_samples(samples: Sequence[Floats]) -> list[TimeRatio]:
    """Return the ratio of each model to the first, from (n, K) times of samples of the work."""
    base, *models = np.array(samples).T
    return [TimeRatio.of_sums(base.tolist(), model.tolist()) for model in models]
