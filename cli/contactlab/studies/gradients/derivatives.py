"""The derivatives at one place: the model's, the run's, and the run's by other means."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.engines.engine import PreparedRuns
from contactlab.schema.gradients import Difference, GradientBy, GradientWord, LadderRung
from contactlab.studies.gradients.automatic import ADAPTIVE, ENGINE, automatic
from contactlab.studies.gradients.chained import EPSILON, chained
from contactlab.studies.gradients.differences import (
    ABOUT,
    NOISE_POINTS,
    NOISE_SPAN,
    SPANS,
    WIDE_SPANS,
    Estimate,
    differences,
    extrapolated,
    ladder_about,
    noise_of,
    scale_of,
    slope,
)
from contactlab.studies.gradients.end_states import Parameter, Point, Subject
from contactlab.studies.session import Values

# Steps that runs make beyond a multiple of those of the scene's own: of each pair of points others,
# so that an event falls anywhere within a step.
_MORE_STEPS = (0, 6, 10, 18, 22, 30, 38, 42, 54, 58, 66, 74)
_NEAR = NOISE_SPAN * NOISE_POINTS
_SPREAD = 1e-6  # over the scale, of the two runs that a chain of steps differentiates
_CONVERGED = {"tolerance": 0.0, "ls_tolerance": 1e-10, "iterations": 100}
_ACCURACY = 1e-4  # of substeps
_EXPLODES, _VANISHES, _KNOWN = 10.0, 0.01, 0.5


@dataclass(frozen=True)
class Means:
    """Another way to a run's derivative."""

    # Returns it of three runs: itself, with the parameter above and below, so far apart.
    derivative: Callable[[PreparedRuns, int, float], float | None]
    settings: Values = field(default_factory=dict[str, object])  # that the runs are given


def _chain(epsilon: float) -> Means:
    """Return the chain of a run whose solver converges: else it need not move from where it was."""
    return Means(partial(chained, epsilon=epsilon), _CONVERGED)


MEANS: Mapping[str, Mapping[str, Means]] = {
    # With a step that stays on one side of most switches, and as MuJoCo's own examples call it.
    "chain": {"chain": _chain(EPSILON), "chain 1e-6": _chain(1e-6)},
    ENGINE: {ENGINE: Means(automatic)},
    ADAPTIVE: {ADAPTIVE: Means(partial(automatic, accuracy=_ACCURACY))},
}


@dataclass(frozen=True)
class Differentiation:
    """How places are differentiated."""

    subject: Subject
    finer: int  # how many times finer than the scene's own step the model's derivative is taken
    means: Mapping[str, Means]
    ladder: bool  # whether every difference is kept

    def by(self, parameter: Parameter, points: Sequence[Point]) -> list[GradientBy]:
        """Return the derivative at each of some places, without words."""
        values = [parameter.at(self.subject, point) for point in points]
        own = self._own(parameter, points, values)
        models = self._models(parameter, points, values)
        told: list[GradientBy] = []
        for place, (point, value) in enumerate(zip(points, values, strict=True)):
            spread = _SPREAD * scale_of(value)
            told.append(
                GradientBy(
                    at=value,
                    model=_difference(models[place]),
                    run=_difference(own[place]),
                    told=self._told(parameter, point, value, spread) if self.means else {},
                    words={},
                    ladder=self._rungs(parameter, point, value) if self.ladder else (),
                )
            )
        return told

    def _own(
        self, parameter: Parameter, points: Sequence[Point], values: Sequence[float]
    ) -> list[Estimate]:
        """Return the derivatives of runs at their own step."""
        around = [
            np.concatenate([ladder_about(value), value + scale_of(value) * _NEAR])
            for value in values
        ]
        moved = [
            parameter.moved(point, float(value))
            for point, each in zip(points, around, strict=True)
            for value in each
        ]
        found: list[Estimate] = []
        for at, ends in zip(around, self._ends(moved, len(points)), strict=True):
            rungs = slice(2 * len(SPANS))
            found.append(extrapolated(at[rungs], ends[rungs], noise_of(ends[rungs.stop :])))
        return found

    def _models(
        self, parameter: Parameter, points: Sequence[Point], values: Sequence[float]
    ) -> list[Estimate]:
        """Return the derivatives of models; see `differences.slope`."""
        fine, coarse = (
            self._ends(
                [
                    step.moved(parameter, value)
                    for point, value in zip(points, values, strict=True)
                    for step in self._smoothed(point, coarser)
                ],
                len(points),
            )
            for coarser in (1, 2)
        )
        shape = len(WIDE_SPANS), len(ABOUT)
        return [
            slope(WIDE_SPANS * scale_of(value), some.reshape(shape), rough.reshape(shape))
            for some, rough, value in zip(fine, coarse, values, strict=True)
        ]

    def _smoothed(self, point: Point, coarser: int) -> "list[_Smoothed]":
        """Return the runs of one place, by fine steps of some lengths, or by so many at once."""
        run = self.subject.resolve(point)
        half, steps = len(_MORE_STEPS), run.steps * self.finer
        found: list[_Smoothed] = []
        for span in WIDE_SPANS:
            for number, about in enumerate(ABOUT):
                # Both ends of a span have other steps than their pair's.
                turn = number if number < half else (2 * half - 1 - number + half // 2) % half
                timestep = run.steps * run.timestep * coarser / (steps + _MORE_STEPS[turn])
                found.append(_Smoothed(point.at_step(timestep), float(span * about)))
        return found

    def _ends(self, points: Sequence[Point], places: int) -> list[Floats]:
        return list(self.subject.end(points).reshape(places, -1))

    def _told(
        self, parameter: Parameter, point: Point, value: float, spread: float
    ) -> dict[str, float | None]:
        """Return what other means say."""
        told: dict[str, float | None] = {}
        for name, means in self.means.items():
            given = replace(point, values={**point.values, **means.settings})
            sides = (value, value + spread, value - spread)
            runs = self.subject.prepare([parameter.moved(given, side) for side in sides])
            told[name] = means.derivative(runs, self.subject.place, 2 * spread)
        return told

    def _rungs(self, parameter: Parameter, point: Point, value: float) -> tuple[LadderRung, ...]:
        points, rungs = ladder_about(value), list[LadderRung]()
        timestep = self.subject.resolve(point).timestep
        for step in (timestep, timestep / 2, timestep / 4):
            ends = self.subject.end(
                [parameter.moved(point.at_step(step), float(each)) for each in points]
            )
            rungs += [
                LadderRung(step=step, span=float(span), value=_finite(difference))
                for span, difference in zip(*differences(points, ends), strict=True)
            ]
        return tuple(rungs)


@dataclass(frozen=True)
class _Smoothed:
    """One run of many through which the model's derivative is smoothed."""

    point: Point
    offset: float  # over the parameter's scale

    def moved(self, parameter: Parameter, value: float) -> Point:
        return parameter.moved(self.point, value + self.offset * scale_of(value))


def influence(by: GradientBy) -> float:
    """Return how far a parameter moves the end if it changes by its own size; 0 if unknown."""
    return abs(by.model.value or 0.0) * scale_of(by.at)


def word(value: float | None, by: GradientBy, tolerance: float, most: float) -> GradientWord:
    """Return what a derivative is beside the model's; `most` is the largest influence of any.

    A share of that as large as the tolerance counts as none.
    """
    model, bound = by.model.value, by.model.bound
    least = tolerance * most / scale_of(by.at)
    if value is None or model is None or bound is None or bound > max(_KNOWN * abs(model), least):
        return "unknown"
    if abs(value) > _EXPLODES * max(abs(model), bound, least):
        return "explodes"
    if abs(value - model) <= max(tolerance * abs(model), least) + bound:
        return "agrees"
    return "vanishes" if abs(value) < _VANISHES * abs(model) else "differs"


def _difference(estimate: Estimate) -> Difference:
    value, bound, span = map(_finite, estimate)
    return Difference(value=value, bound=bound, span=span)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
