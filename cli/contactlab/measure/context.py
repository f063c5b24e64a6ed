"""What a metric or a rule is given: a trace, its setup, its pair series, and shared results."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats, FreeBody, PairSeries, SelfChecks, Setup, Trace
from contactlab.measure.fold import Folded, fold
from contactlab.measure.friction import series_of

Shared = TypeVar("Shared")


@dataclass(frozen=True)
class Context:
    """One trace of n runs under measurement.

    Attributes:
        trace: the trace.
        setup: what is known of its runs.
        folded: the contacts of each graded pair, folded over their slots.
        series: the series of each graded pair.
        checks: what a second pass found, if there was one.
        memo: results of `shared` functions.
    """

    trace: Trace
    setup: Setup
    folded: tuple[Folded, ...]
    series: tuple[PairSeries, ...]
    checks: SelfChecks | None = None
    memo: dict[object, object] = field(default_factory=dict[object, object], repr=False)

    @property
    def tail(self) -> slice:
        """The last fifth of the steps."""
        return slice(self.trace.steps - max(self.trace.steps // 5, 1), None)

    @property
    def seconds(self) -> Floats:
        """(n,) simulated time recorded [s]."""
        return self.trace.timestep * self.trace.steps

    def nothing(self) -> Floats:
        """Return (n,) NaN: the measure does not apply."""
        return np.full(self.trace.runs, np.nan)


def context_of(trace: Trace, setup: Setup, checks: SelfChecks | None = None) -> Context:
    """Fold the graded pairs of a trace, ready to measure."""
    with np.errstate(all="ignore"):
        folded = tuple(fold(pair, setup.elliptic) for pair in trace.pairs)
        series = tuple(
            series_of(pair.name, each, trace.timestep)
            for pair, each in zip(trace.pairs, folded, strict=True)
        )
    return Context(trace, setup, folded, series, checks)


def shared(function: Callable[[Context], Shared]) -> Callable[[Context], Shared]:
    """Compute a function of the context once for all metrics and rules that ask for it."""

    @wraps(function)
    def lookup(context: Context) -> Shared:
        if function not in context.memo:
            context.memo[function] = function(context)
        return context.memo[function]  # pyright: ignore[reportReturnType]

    return lookup


@shared
def contact_depths(context: Context) -> tuple[tuple[NDArray[np.bool_], Floats], ...]:
    """Return for each graded pair (n, N) whether it touches, and its depth [m], 0 where apart.

    A scene without graded pairs counts all its contacts as one. Depths are NaN in runs whose
    contacts are speculative.
    """
    trace = context.trace
    distances = [(each.contacts > 0, each.distance) for each in context.series]
    distances = distances or [(trace.contacts > 0, trace.least_distance)]
    depths = tuple((touching, np.maximum(-distance, 0)) for touching, distance in distances)
    if context.setup.speculative is not None:
        for _, depth in depths:
            depth[context.setup.speculative] = np.nan
    return depths


@shared
def kinetic(context: Context) -> Floats:
    """Return (n, N) kinetic energy [J]."""
    return np.ascontiguousarray(context.trace.kinetic)


@shared
def potential(context: Context) -> Floats:
    """Return (n, N) potential energy [J]."""
    return np.ascontiguousarray(context.trace.potential)


@shared
def energy(context: Context) -> Floats:
    """Return (n, N) mechanical energy [J]."""
    return kinetic(context) + potential(context)


@shared
def budget(context: Context) -> Floats:
    """Return (n,) the energy at the start that could become motion [J].

    Kinetic energy at the start plus the potential energy above the lowest that the run reaches,
    so that the datum of the potential drops out.
    """
    heights = potential(context)
    return kinetic(context)[:, 0] + heights[:, 0] - heights.min(axis=1)


@shared
def least_energy(context: Context) -> Floats:
    """Return (n,) the energy [J] below which changes of energy mean nothing in this scene.

    It lifts every free body by 1 mm, or sets it moving at 1 cm/s.
    """
    mass = sum((body.mass for body in context.setup.free_bodies), np.zeros(context.trace.runs))
    fall = np.linalg.norm(context.setup.gravity, axis=1)
    return np.maximum(mass * (fall * 1e-3 + 0.5 * 1e-4), 1e-12)


@shared
def peak_kinetic(context: Context) -> Floats:
    """Return (n,) the largest kinetic energy of the run [J]."""
    return kinetic(context).max(axis=1)


def speed_squared(context: Context, body: FreeBody) -> Floats:
    """Return (n, N + 1) the squared speed of a free body's frame [m^2/s^2]."""
    x, y, z = (context.trace.qvel[:, :, body.dof + axis] for axis in range(3))
    return x * x + y * y + z * z
