"""What a metric or a label reads: a trace, its setup, its pair series, and shared results."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, wraps
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contactlab.contact.trace_arrays import Floats, PairSeries, SelfChecks, Trace
from contactlab.contact.trace_setup import FreeBody, Setup
from contactlab.measure.net_contact import NetContact, net_contact

Cached = TypeVar("Cached")
Item = TypeVar("Item")

_ROUNDING = 1e-6  # Share of a step by which a time may miss a whole number of steps


@dataclass(frozen=True)
class Context:
    """One trace of n runs under measurement.

    Attributes:
        net: the contacts of each monitored pair, reduced; all that never touch have the same.
        checks: what a second pass found, if there was one.
        cache: results of `cached` functions.
    """

    trace: Trace
    setup: Setup
    net: tuple[NetContact, ...]
    checks: SelfChecks | None = None
    cache: dict[object, object] = field(default_factory=dict[object, object], repr=False)

    @cached_property
    def series(self) -> tuple[PairSeries, ...]:
        """The net quantities of each monitored pair over time."""
        named = zip(self.net, self.trace.pairs, strict=True)
        return tuple(replace(net.series, name=pair.name) for net, pair in named)

    @cached_property
    def places(self) -> list[int]:
        """The place of each pair, and of all that never touch that of the last."""
        last = {id(net): place for place, net in enumerate(self.net)}
        return [last[id(net)] for net in self.net]

    @property
    def last_fifth(self) -> slice:
        """The last fifth of the steps."""
        return slice(self.trace.steps - max(self.trace.steps // 5, 1), None)

    @property
    def seconds(self) -> Floats:
        """(n,) simulated time recorded [s]."""
        return self.trace.timestep * self.trace.steps

    def setting(self, name: str) -> Floats:
        """Return a setting of every run: (n,) for a number, (n, k) for k of them."""
        return np.asarray(self.setup.settings[name], dtype=np.float64)

    def position(self, body: FreeBody) -> Floats:
        """Return (n, N + 1, 3) the position of a free body's frame [m]."""
        return self.trace.qpos[:, :, body.qpos : body.qpos + 3]

    def velocity(self, body: FreeBody) -> Floats:
        """Return (n, N + 1, 3) the velocity of a free body's frame [m/s]."""
        return self.trace.qvel[:, :, body.dof : body.dof + 3]

    def turning(self, body: FreeBody) -> Floats:
        """Return (n, N + 1, 3) the angular velocity of a free body [rad/s], along its own axes."""
        return self.trace.qvel[:, :, body.dof + 3 : body.dof + 6]

    def displacement(self, body: FreeBody) -> Floats:
        """Return (n, 3) the displacement of a free body's frame [m] over the run."""
        place = self.position(body)
        return place[:, -1] - place[:, 0]

    def undefined(self) -> Floats:
        """Return (n,) NaN: the metric does not apply."""
        return np.full(self.trace.runs, np.nan)

    def only(self, run: int) -> "Context":
        """Return the context of one of the runs."""
        checks = None if self.checks is None else self.checks.only(run)
        return context_of(self.trace.select([run]), self.setup.select([run]), checks)

    def refined(self, run: int) -> "Context":
        """Return the context of the refined copy of a run that was checked."""
        assert self.checks is not None
        return context_of(self.checks.refined[run], self.setup.select([run]))


def context_of(trace: Trace, setup: Setup, checks: SelfChecks | None = None) -> Context:
    """Reduce the monitored pairs of a trace, ready to measure."""
    untouched = [pair for pair in trace.pairs if not pair.found.any()]
    same = {id(pair): untouched[-1] for pair in untouched}
    pairs = [same.get(id(pair), pair) for pair in trace.pairs]
    with np.errstate(all="ignore"):
        net = each_once(pairs, lambda pair: net_contact(pair, setup.elliptic, trace.timestep))
    return Context(trace, setup, tuple(net), checks)


def each_once(items: Sequence[Item], quantity: Callable[[Item], Cached]) -> list[Cached]:
    """Return a quantity of each item, computed once of those that are the same object."""
    found = {key: quantity(each) for key, each in {id(each): each for each in items}.items()}
    return [found[id(each)] for each in items]


def cached(function: Callable[[Context], Cached]) -> Callable[[Context], Cached]:
    """Compute a function of the context once for all metrics and labels that need it."""

    @wraps(function)
    def lookup(context: Context) -> Cached:
        if function not in context.cache:
            context.cache[function] = function(context)
        return context.cache[function]  # pyright: ignore[reportReturnType]

    return lookup


@cached
def contact_depths(context: Context) -> tuple[tuple[NDArray[np.bool_], Floats], ...]:
    """Return for each monitored pair (n, N) whether it touches, and its depth [m], 0 where apart.

    A scene without monitored pairs counts all its contacts as one. Depths are NaN in runs whose
    contacts are speculative.
    """
    trace, speculative = context.trace, context.setup.speculative

    def depth_of(net: NetContact | None) -> tuple[NDArray[np.bool_], Floats]:
        distance = net.series.distance if net else trace.least_distance
        depth = np.maximum(-distance, 0)
        if speculative is not None:
            depth[speculative] = np.nan
        return (net.series if net else trace).contacts > 0, depth

    return tuple(each_once(context.net or [None], depth_of))


@cached
def kinetic(context: Context) -> Floats:
    """Return (n, N) kinetic energy [J]."""
    return np.ascontiguousarray(context.trace.kinetic)


@cached
def potential(context: Context) -> Floats:
    """Return (n, N) potential energy [J]."""
    return np.ascontiguousarray(context.trace.potential)


@cached
def energy(context: Context) -> Floats:
    """Return (n, N) mechanical energy [J]."""
    return kinetic(context) + potential(context)


@cached
def energy_budget(context: Context) -> Floats:
    """Return (n,) the energy at the start that could become motion [J].

    Kinetic energy at the start plus the potential energy above the lowest that the run reaches,
    so that the datum of the potential drops out.
    """
    heights = potential(context)
    return kinetic(context)[:, 0] + heights[:, 0] - heights.min(axis=1)


def free_mass(context: Context) -> Floats:
    """Return (n,) the mass of all free bodies [kg]."""
    return sum((body.mass for body in context.setup.free_bodies), np.zeros(context.trace.runs))


@cached
def least_energy(context: Context) -> Floats:
    """Return (n,) the least energy [J] that counts: it lifts free bodies by 1 mm at 1 cm/s."""
    return np.maximum(free_mass(context) * (gravity(context) * 1e-3 + 0.5 * 1e-4), 1e-12)


@cached
def peak_kinetic(context: Context) -> Floats:
    """Return (n,) the largest kinetic energy of the run [J]."""
    return kinetic(context).max(axis=1)


def down(context: Context) -> Floats:
    """Return (n, 3) the unit vector of gravity; zero without gravity."""
    gravity = context.setup.gravity
    length = np.linalg.norm(gravity, axis=1, keepdims=True)
    return gravity / np.where(length > 0, length, 1)


def worst_body(context: Context, quantity: Callable[[FreeBody], Floats]) -> Floats:
    """Return (n,) the largest of a quantity (n,) over free bodies; NaN where there are none."""
    values = [quantity(body) for body in context.setup.free_bodies]
    return np.maximum.reduce(values) if values else context.undefined()


def worst_pair(context: Context, values: list[Floats]) -> Floats:
    """Return (n,) the largest over pairs; NaN where it applies to none."""
    return np.fmax.reduce(values) if values else context.undefined()


def name_of_worst(context: Context, values: list[Floats], run: int) -> str:
    """Return the name of the pair of which a quantity (n,) is largest in a run."""
    if not context.series:
        return "the model"
    return context.series[int(np.nanargmax([each[run] for each in values]))].name


def distance_from_rest(context: Context, steps: ArrayLike) -> Floats:
    """Return (n, ...) the distance [m] that 1 m/s^2 moves a body from rest in this many steps.

    A semi-implicit step adds h a to the velocity and then h v to the position, so that N steps
    move by ``a h^2 N (N + 1) / 2``; RK4 by ``a (h N)^2 / 2``.
    """
    count = np.asarray(steps, dtype=np.float64)
    one = (slice(None),) + (None,) * count.ndim
    step = context.trace.timestep[one]
    return step**2 * count * (count + semi_implicit(context)[one]) / 2


def semi_implicit(context: Context) -> Floats:
    """Return (n,) 1 where positions move with the velocity after a step, 0 for RK4."""
    return np.array([name != "RK4" for name in context.setup.settings["integrator"]], np.float64)


def friction(context: Context, place: int = 0) -> Floats:
    """Return (n,) a friction coefficient: sliding [1], or at place 2 torsional, 3 rolling [m]."""
    return context.setting("friction").reshape(context.trace.runs, -1)[:, place]


def gravity(context: Context) -> Floats:
    """Return (n,) the magnitude of gravity [m/s^2]."""
    return np.linalg.norm(context.setup.gravity, axis=1)


@cached
def hold_window(context: Context) -> NDArray[np.bool_]:
    """Return (n, N) the steps that begin in [from, to) of the hold; none where runs end before."""
    trace, hold = context.trace, context.setup.hold
    if hold is None:
        return np.zeros(trace.contacts.shape, dtype=np.bool_)
    first, last = (
        np.ceil(times / trace.timestep - _ROUNDING)[:, None] for times in (hold.start, hold.stop)
    )
    steps = np.arange(trace.steps)
    # A run of a duration that is no whole number of steps may be half a step short.
    return (steps >= first) & (steps < last) & (last <= trace.steps + 1)


@cached
def hold_seconds(context: Context) -> Floats:
    """Return (n,) the length of the hold window [s]; NaN where there is none."""
    steps = hold_window(context).sum(axis=1)
    return np.where(steps > 0, steps, np.nan) * context.trace.timestep


def runs_where(mask: NDArray[np.bool_]) -> list[int]:
    """Return the runs in which a mask (n,) holds."""
    return np.flatnonzero(mask).tolist()


def first_step(mask: NDArray[np.bool_]) -> int:
    """Return the first step in which a mask (N,) holds; 0 if none."""
    return int(mask.argmax())
