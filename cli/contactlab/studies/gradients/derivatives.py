"""Derivatives at one place: of the model, of the run, and of the run by other methods."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.engines.engine import PreparedRuns
from contactlab.schema.gradients import Difference, GradientInput, GradientVerdict, LadderRung
from contactlab.studies.gradients.automatic_differentiation import (
    ADAPTIVE,
    ENGINE,
    differentiate_end,
)
from contactlab.studies.gradients.differences import (
    PLAN,
    Estimate,
    central_differences,
    estimate_noise,
    extrapolate,
    fit_slope,
    ladder_points,
    parameter_scale,
)
from contactlab.studies.gradients.end_states import DifferentiatedScene, Parameter, Point
from contactlab.studies.gradients.transition_chain import chain_transitions
from contactlab.tasks.session import Values


@dataclass(frozen=True)
class DerivativeMethod:
    """Another method for the derivative of a run."""

    # Takes the run, it with the parameter above and below, and the distance of these two.
    derivative: Callable[[PreparedRuns, int, float], float | None]
    settings: Values = field(default_factory=dict[str, object])  # settings of these runs


def _chain_of(**epsilon: float) -> DerivativeMethod:
    """Return the chain of transitions of a run with a converging solver."""
    converged = {"tolerance": 0.0, "ls_tolerance": 1e-10, "iterations": 100}
    return DerivativeMethod(partial(chain_transitions, **epsilon), converged)


METHODS: Mapping[str, Mapping[str, DerivativeMethod]] = {
    # With a step that crosses few mode switches, and with the step of MuJoCo's own examples.
    "chain": {"chain": _chain_of(), "chain 1e-6": _chain_of(epsilon=1e-6)},
    ENGINE: {ENGINE: DerivativeMethod(differentiate_end)},
    # The accuracy is that of its substeps.
    ADAPTIVE: {ADAPTIVE: DerivativeMethod(partial(differentiate_end, accuracy=1e-4))},
}


@dataclass(frozen=True)
class Differentiation:
    """Differentiates places."""

    subject: DifferentiatedScene
    finer: int  # refinement factor of the reference
    methods: Mapping[str, DerivativeMethod]
    ladder: bool  # whether every difference is kept

    def by(self, parameter: Parameter, points: Sequence[Point]) -> list[GradientInput]:
        """Return the derivative at each place, without verdicts."""
        values = [parameter.at(self.subject, point) for point in points]
        around = [
            np.concatenate(
                [ladder_points(value), value + parameter_scale(value) * PLAN.noise_offsets]
            )
            for value in values
        ]
        moved = [
            parameter.with_value(point, float(value))
            for point, each in zip(points, around, strict=True)
            for value in each
        ]
        own: list[Estimate] = []
        for at, ends in zip(around, self._end_values(moved, len(points)), strict=True):
            rungs = slice(2 * len(PLAN.spans))
            own.append(extrapolate(at[rungs], ends[rungs], estimate_noise(ends[rungs.stop :])))
        fine, coarse = (
            self._end_values(
                [
                    step.with_value(parameter, value)
                    for point, value in zip(points, values, strict=True)
                    for step in self._smoothing_runs(point, coarser)
                ],
                len(points),
            )
            for coarser in (1, 2)
        )
        shape = len(PLAN.wide_spans), len(PLAN.within)
        models = [
            fit_slope(
                PLAN.wide_spans * parameter_scale(value), some.reshape(shape), rough.reshape(shape)
            )
            for some, rough, value in zip(fine, coarse, values, strict=True)
        ]
        spread_share = 1e-6  # over the scale, of the two runs that a chain of steps differentiates
        inputs: list[GradientInput] = []
        for place, (point, value) in enumerate(zip(points, values, strict=True)):
            spread = spread_share * parameter_scale(value)
            inputs.append(
                GradientInput(
                    value=value,
                    model=_find_difference(models[place]),
                    run=_find_difference(own[place]),
                    methods=self._method_values(parameter, point, value, spread)
                    if self.methods
                    else {},
                    verdicts={},
                    ladder=self._ladder_rungs(parameter, point, value) if self.ladder else (),
                )
            )
        return inputs

    def _smoothing_runs(self, point: Point, coarser: int) -> "list[_Smoothed]":
        """Return the runs of one place at fine steps of different lengths, or coarser ones."""
        run = self.subject.resolve(point)
        # Extra steps of the runs of each pair of points: events then fall anywhere within a step.
        more_steps = (0, 6, 10, 18, 22, 30, 38, 42, 54, 58, 66, 74)
        half, steps = len(more_steps), run.steps * self.finer
        smoothed: list[_Smoothed] = []
        for span in PLAN.wide_spans:
            for number, about in enumerate(PLAN.within):
                # The two ends of a span have different steps.
                turn = number if number < half else (2 * half - 1 - number + half // 2) % half
                timestep = run.steps * run.timestep * coarser / (steps + more_steps[turn])
                smoothed.append(_Smoothed(point.at_step(timestep), float(span * about)))
        return smoothed

    def _end_values(self, points: Sequence[Point], places: int) -> list[Floats]:
        return list(self.subject.end_values(points).reshape(places, -1))

    def _method_values(
        self, parameter: Parameter, point: Point, value: float, spread: float
    ) -> dict[str, float | None]:
        """Return the derivative by each other method."""
        method_values: dict[str, float | None] = {}
        for name, method in self.methods.items():
            point_of_method = replace(point, values={**point.values, **method.settings})
            sides = (value, value + spread, value - spread)
            runs = self.subject.prepare(
                [parameter.with_value(point_of_method, side) for side in sides]
            )
            method_values[name] = method.derivative(runs, self.subject.place, 2 * spread)
        return method_values

    def _ladder_rungs(
        self, parameter: Parameter, point: Point, value: float
    ) -> tuple[LadderRung, ...]:
        points, rungs = ladder_points(value), list[LadderRung]()
        timestep = self.subject.resolve(point).timestep
        for step in (timestep, timestep / 2, timestep / 4):
            ends = self.subject.end_values(
                [parameter.with_value(point.at_step(step), float(each)) for each in points]
            )
            rungs += [
                LadderRung(step=step, span=float(span), value=difference)
                for span, difference in zip(*central_differences(points, ends), strict=True)
            ]
        return tuple(rungs)


@dataclass(frozen=True)
class _Smoothed:
    """One of the runs that smooth the model's derivative."""

    point: Point
    offset: float  # over the parameter's scale

    def with_value(self, parameter: Parameter, value: float) -> Point:
        return parameter.with_value(self.point, value + self.offset * parameter_scale(value))


def measure_influence(by: GradientInput) -> float:
    """Return how far a parameter moves the end if it changes by its own size; 0 if unknown."""
    return abs(by.model.value or 0.0) * parameter_scale(by.value)


def judge_derivative(
    value: float | None, by: GradientInput, tolerance: float, most: float
) -> GradientVerdict:
    """Return the verdict on a derivative; `most` is the largest influence of any input.

    A share of that up to the tolerance counts as zero.
    """
    most_bound = 0.5  # of a known derivative, over its value
    explodes, vanishes = 10.0, 0.01  # over the model's derivative
    model, bound = by.model.value, by.model.bound
    least = tolerance * most / parameter_scale(by.value)
    if value is None or model is None or bound is None:
        return "unknown"
    if bound > max(most_bound * abs(model), least):
        return "unknown"
    if abs(value) > explodes * max(abs(model), bound, least):
        return "explodes"
    if abs(value - model) <= max(tolerance * abs(model), least) + bound:
        return "agrees"
    return "vanishes" if abs(value) < vanishes * abs(model) else "differs"


def _find_difference(estimate: Estimate) -> Difference:
    value, bound, span = estimate
    return Difference(value=value, bound=bound, span=span)
