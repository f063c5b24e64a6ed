"""The front of accuracy and time: a few candidates that no other one beats in both.

It is chosen by counted work and errors, so that it repeats. Candidates that cannot be distinguished
are one point.
"""

import math
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from contactlab.studies.search.configuration import Key
from contactlab.studies.search.settings_search import (
    Evaluation,
    cost_of,
    error_of,
    find_undominated,
)
from contactlab.tasks.reference_error import ErrorEstimate


@dataclass(frozen=True)
class FrontRules:
    """When candidates are points of their own, and how many points there are.

    Attributes:
        most: points that are shown.
        cost_ratio: two points with a smaller ratio of counted works take the same time: half of all
            counts are within 1.3 % of the measured time, and nine of ten within 13 %.
        error_ratio: two points with a smaller ratio of errors are equally accurate: seeds differ by
            more.
        noise: the few seeds of a search may rank two candidates wrongly if their errors have a
            smaller ratio.
        contenders: candidates that are measured on more seeds, the points are chosen from these.
    """

    most: int = 8
    cost_ratio: float = 1.07
    error_ratio: float = 1.2
    noise: float = 1.5
    contenders: int = 20

    def is_same_cost(self, one: Evaluation, other: Evaluation) -> bool:
        """Return whether two candidates take the same time, as far as counts tell."""
        return abs(math.log(one.cost / other.cost)) < math.log(self.cost_ratio)

    def is_same_error(self, one: Evaluation, other: Evaluation) -> bool:
        """Return whether two candidates are equally accurate, as far as seeds tell."""
        low, high = sorted((error_of(one), error_of(other)))
        return high == low or (low > 0 and high / low < self.error_ratio)


def choose_contenders(
    candidates: Iterable[Evaluation],
    marked: Sequence[Evaluation],
    limit: float,
    rules: FrontRules | None = None,
) -> list[Evaluation]:
    """Return the candidates that may be points of the front, with the marked ones.

    Errors of few seeds are noisy, so that a candidate contends unless a cheaper one is distinctly
    more accurate. The cheapest of those that move alike with equal errors contends.
    """
    rules = rules or FrontRules()
    fixed = {one.configuration.key: one for one in marked}
    chosen, best, seen_texts = list(fixed.values()), math.inf, set[str]()
    measured_points = [one for one in candidates if one.error and math.isfinite(one.cost)]
    measured_points.sort(key=lambda one: (cost_of(one), len(one.configuration.settings)))
    for one in measured_points:
        error, text = error_of(one), f"{error_of(one):.4g}"
        is_new = text not in seen_texts and one.configuration.key not in fixed
        if is_new and error <= min(rules.noise * best, limit):
            chosen.append(one)
        seen_texts.add(text)
        best = min(best, error)
    chosen.sort(key=lambda one: (-one.cost, error_of(one)))
    return _thin_out(chosen, fixed, -math.inf, rules.contenders)


def choose_front(
    candidates: Iterable[Evaluation],
    marked: Sequence[Evaluation],
    limit: float,
    rules: FrontRules | None = None,
) -> list[Evaluation]:
    """Return the points of the front from the most accurate to the fastest.

    Args:
        candidates: measured candidates.
        marked: candidates that are points in any case, such as the model as written.
        limit: largest error of the others.
        rules: when candidates are points of their own.
    """
    rules = rules or FrontRules()
    fixed = {one.configuration.key: one for one in marked}
    usable = [
        one
        for one in candidates
        if one.error
        and math.isfinite(one.cost)
        and error_of(one) <= limit
        and one.configuration.key not in fixed
    ]
    points = _drop_equal(find_undominated([*usable, *fixed.values()]), fixed, rules)
    points = [one for one in points if not _is_marked_twin(one, fixed, rules)]
    points += fixed.values()
    points.sort(key=lambda one: (-one.cost, error_of(one)))
    return _thin_out(points, fixed, math.log(rules.cost_ratio), rules.most)


def _is_marked_twin(one: Evaluation, fixed: Mapping[Key, Evaluation], rules: FrontRules) -> bool:
    return any(
        one is other or (rules.is_same_cost(one, other) and rules.is_same_error(one, other))
        for other in fixed.values()
    )


def _drop_equal(
    points: Sequence[Evaluation], fixed: Container[Key], rules: FrontRules
) -> list[Evaluation]:
    # A marked one of equal points stays, otherwise the accurate or fast one.
    distinct = list[Evaluation]()
    most_accurate: Evaluation | None = None  # of those that the last point stands for
    for one in points:
        is_fixed = one.configuration.key in fixed
        last = distinct[-1] if distinct else one
        if distinct and not (is_fixed and last.configuration.key in fixed):
            if rules.is_same_cost(one, last):
                if is_fixed:
                    distinct[-1] = one
                continue
            assert most_accurate
            if rules.is_same_error(one, most_accurate) and last.configuration.key not in fixed:
                distinct[-1] = one
                continue
        distinct.append(one)
        most_accurate = one
    return distinct


def _thin_out(
    points: Sequence[Evaluation], fixed: Container[Key], least: float, most: int
) -> list[Evaluation]:
    # Return at most this many points, with the marked ones; the others bend least or lie closest.
    #
    # A point that the straight line between its neighbors replaces, in logarithms, is missed least;
    # of savings below the least one, the point with the closest neighbors.
    remaining = list(points)
    spans = [_total_span(remaining, value) for value in (cost_of, error_of)]

    def measure_loss(place: int) -> tuple[float, float]:
        before, after = remaining[place - 1], remaining[place + 1]
        between = points[points.index(before) + 1 : points.index(after)]
        bend = max(_saving_beyond(one, before, after) for one in between)
        gap = math.hypot(
            *(
                _log_distance(value(before), value(after)) / span
                for value, span in zip((cost_of, error_of), spans, strict=True)
            )
        )
        return max(bend, least), gap

    while len(remaining) > most:
        inner = [
            place
            for place in range(1, len(remaining) - 1)
            if remaining[place].configuration.key not in fixed
        ]
        if not inner:
            break
        remaining.pop(min(inner, key=measure_loss))
    return remaining


def _saving_beyond(one: Evaluation, before: Evaluation, after: Evaluation) -> float:
    # Return the saving of a point over the straight line between two others, as a logarithm.
    error, first, last = (_log_of(error_of(each)) for each in (one, before, after))
    share = min(1.0, max(0.0, (error - first) / (last - first))) if last > first else 0.0
    line = (1 - share) * math.log(before.cost) + share * math.log(after.cost)
    return line - math.log(one.cost)


def _total_span(points: Sequence[Evaluation], value: Callable[[Evaluation], float]) -> float:
    steps = (_log_distance(value(one), value(other)) for one, other in pairwise(points))
    return sum(steps) or 1.0


def _log_distance(one: float, other: float) -> float:
    return abs(_log_of(one) - _log_of(other))


def _log_of(value: float) -> float:
    tiny = 1e-300  # an error of 0 has no logarithm
    return math.log(max(value, tiny))


Point = tuple[str, Evaluation, ErrorEstimate]
"""A name, a candidate, and its error on fresh seeds."""


def drop_slower(
    points: Sequence[Point], time_of: Callable[[Point], float], marked: Container[Key]
) -> list[Point]:
    """Return points without those that take no less time than a more accurate one.

    Measured errors and times differ from those that chose the points. Marked ones stay.

    Args:
        points: from the most accurate on.
        time_of: returns the time of a point.
        marked: keys of candidates that are points in any case.
    """
    faster, fastest = list[Point](), math.inf
    for point in points:
        if time_of(point) < fastest or point[1].configuration.key in marked:
            faster.append(point)
        fastest = min(fastest, time_of(point))
    return faster
