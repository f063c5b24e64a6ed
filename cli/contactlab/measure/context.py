"""Inputs of a metric or a label: a trace, its setup, its pair series, and shared results."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property, wraps
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contactlab.contact.trace_arrays import (
    Floats,
    PairSeries,
    SelfChecks,
    Trace,
    squared_lengths,
)
from contactlab.contact.trace_setup import FreeBody, Setup
from contactlab.measure.net_contact import NetContact, net_contact
from contactlab.numerical_tolerance import COARSE_ROUNDING

Cached = TypeVar("Cached")

NEGLIGIBLE_SHARE = 0.01  # negligible rise or lever arm, as a share of a body's mean size


@dataclass(frozen=True)
class StackedPairs:
    """The monitored pairs of a trace, in rows: all pairs that never touch share one row.

    Attributes:
        names: the name of each pair.
        places: the index of the pair in each row; for the shared row, that of the last such pair.
        rows: (P,) the row of each pair.
        net: the contacts of each row, reduced: (R, n, N) for quantities with (n, N) per pair, and
            (R, n).
    """

    names: list[str]
    places: list[int]
    rows: NDArray[np.intp]
    net: NetContact

    @cached_property
    def series(self) -> tuple[PairSeries, ...]:
        """The net quantities of each pair over time."""
        # All fields except the name.
        stacked = [getattr(self.net.series, entry.name) for entry in fields(PairSeries)[1:]]
        rows_by_name = zip(self.names, self.rows.tolist(), strict=True)
        return tuple(
            PairSeries(name, *(array[row] for array in stacked)) for name, row in rows_by_name
        )


@dataclass(frozen=True)
class Context:
    """One trace of n runs under measurement.

    Attributes:
        pairs: the monitored pairs.
        checks: the results of a second pass, if there was one.
        cache: results of `cached` functions.
    """

    trace: Trace
    setup: Setup
    pairs: StackedPairs
    checks: SelfChecks | None = None
    cache: dict[object, object] = field(default_factory=dict[object, object], repr=False)

    @property
    def net(self) -> NetContact:
        """The contacts of the monitored pairs, stacked: (R, n, N) and (R, n)."""
        return self.pairs.net

    @property
    def series(self) -> tuple[PairSeries, ...]:
        """The net quantities of each monitored pair over time."""
        return self.pairs.series

    @property
    def last_fifth(self) -> slice:
        """The last fifth of the steps."""
        return slice(self.trace.steps - max(self.trace.steps // 5, 1), None)

    @property
    def seconds(self) -> Floats:
        """(n,) simulated time recorded [s]."""
        return self.trace.timestep * self.trace.steps

    def setting(self, name: str) -> Floats:
        """Return a setting of every run: (n,) for a number, (n, k) for k numbers."""
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


def context_of(trace: Trace, setup: Setup, checks: SelfChecks | None = None) -> Context:
    """Reduce the monitored pairs of a trace, ready to measure."""
    trace = trace.forbid_writes()
    places, rows = rows_of(trace)
    pairs, names = [trace.pairs[place] for place in places], [pair.name for pair in trace.pairs]
    with np.errstate(all="ignore"):
        net = net_contact(pairs, setup.pull, setup.elliptic, trace.timestep, trace.steps)
    _forbid_writes((*vars(net).values(), *vars(net.series).values()))
    return Context(trace, setup, StackedPairs(names, places, rows, net), checks)


def rows_of(trace: Trace) -> tuple[list[int], NDArray[np.intp]]:
    """Return the index of the pair in each row, and the row of each pair."""
    # Pairs that never touch may share one array.
    slots = {id(pair.slots): pair for pair in trace.pairs}
    touches = {key: pair.found.any() for key, pair in slots.items()}
    touched = np.array([touches[id(pair.slots)] for pair in trace.pairs], np.bool_)
    alone = runs_where(~touched)[-1:]
    places = sorted([*runs_where(touched), *alone])
    return places, np.searchsorted(places, np.where(touched, np.arange(len(touched)), alone or 0))


def _forbid_writes(value: Cached) -> Cached:
    for array in value if isinstance(value, tuple) else (value,):
        if isinstance(array, np.ndarray):
            array.setflags(write=False)
    return value


def cached(function: Callable[[Context], Cached]) -> Callable[[Context], Cached]:
    """Compute a function of the context once for all metrics and labels that need it."""

    @wraps(function)
    def lookup(context: Context) -> Cached:
        if function not in context.cache:
            # All metrics and labels share it.
            context.cache[function] = _forbid_writes(function(context))
        return context.cache[function]  # pyright: ignore[reportReturnType]

    return lookup


@cached
def contact_depths(context: Context) -> tuple[NDArray[np.bool_], Floats]:
    """Return (R, n, N) whether each row of pairs touches, and its depth [m], 0 without contact.

    In a scene without monitored pairs, all contacts count as one pair. Depths are NaN in runs with
    speculative contacts.
    """
    trace, series, speculative = context.trace, context.net.series, context.setup.speculative
    alone = not trace.pairs
    distance = trace.least_distance[None] if alone else series.distance
    depth = np.maximum(-distance, 0)
    if speculative is not None:
        depth[:, speculative] = np.nan
    return (trace.contacts[None] if alone else series.contacts) > 0, depth


@cached
def bearing(context: Context) -> NDArray[np.bool_]:
    """Return (R, n, N) whether each row of pairs carries force."""
    return context.net.series.normal > 0


def squares_from(states: Floats, starts: Sequence[int], width: int = 3) -> Floats:
    """Return (B, n, T) squared lengths of vectors at some start indices of states (n, T, k)."""
    places = np.array(starts, np.intp)[:, None] + range(width)
    squares = np.empty((len(starts), *states.shape[:2]))
    squares = np.empty((len(starts), *states.shape[:2]))
    block_rows = 1 << 11  # states that are processed together, so that they fit into the cache
    stride = max(1, block_rows // max(1, states.shape[1]))
    for first in range(0, len(states), stride):
        some = slice(first, first + stride)
        parts = states[some].transpose(2, 0, 1)[places]
        squares[:, some] = squared_lengths(np.moveaxis(parts, 1, -1))
    return squares


@cached
def squared_speeds(context: Context) -> Floats:
    """Return (B, n, N + 1) the squared speed of each free body's frame [m^2/s^2]."""
    return squares_from(context.trace.qvel, [body.dof for body in context.setup.free_bodies])


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

    Kinetic energy at the start plus the potential energy above the lowest in the run, so that the
    datum of the potential cancels.
    """
    heights = potential(context)
    return kinetic(context)[:, 0] + heights[:, 0] - heights.min(axis=1)


def free_mass(context: Context) -> Floats:
    """Return (n,) the mass of all free bodies [kg]."""
    return sum((body.mass for body in context.setup.free_bodies), np.zeros(context.trace.runs))


@cached
def least_energy(context: Context) -> Floats:
    """Return (n,) the least energy [J] that counts.

    It lifts everything by 1 % of a body's mean size, and moves it at 0.1 mean sizes a second.
    """
    size = context.setup.size
    # Negligible speed in body sizes per second, so that it holds in any unit of length.
    negligible_speed = 0.1
    least = gravity(context) * NEGLIGIBLE_SHARE * size + 0.5 * (negligible_speed * size) ** 2
    return np.maximum(context.setup.moving_mass * least, np.finfo(float).tiny)


@cached
def peak_kinetic(context: Context) -> Floats:
    """Return (n,) the largest kinetic energy of the run [J]."""
    return kinetic(context).max(axis=1)


def down(context: Context) -> Floats:
    """Return (n, 3) the unit vector of gravity; zero without gravity."""
    length = gravity(context)[:, None]
    return context.setup.gravity / np.where(length > 0, length, 1)


def worst_body(context: Context, values: Sequence[Floats] | Floats) -> Floats:
    """Return (n,) the largest of values (n,) over free bodies; NaN without free bodies."""
    return np.maximum.reduce(values) if len(values) else context.undefined()


def worst_pair(context: Context, values: Sequence[Floats] | Floats) -> Floats:
    """Return (n,) the largest of values (n,) over pairs; NaN if it applies to no pair."""
    return np.fmax.reduce(values) if len(values) else context.undefined()


def bodies_of_pair(context: Context, place: int) -> tuple[str, ...]:
    """Return the movable bodies of a monitored pair."""
    sides = context.setup.sides
    return sides[place] if sides else ()


def name_of_worst(context: Context, values: Floats, run: int) -> str:
    """Return the name of the pair with the largest quantity (R, n) in a run."""
    if not context.trace.pairs:
        return "the model"
    return context.pairs.names[context.pairs.places[int(np.nanargmax(values[:, run]))]]


def bodies_beyond(context: Context, values: Floats, run: int, limit: float) -> tuple[str, ...]:
    """Return the bodies of all pairs with a quantity (R, n) above a limit in a run."""
    rows = runs_where(values[:, run] > limit) if context.trace.pairs else []
    places = (context.pairs.places[row] for row in rows)
    return tuple(dict.fromkeys(body for place in places for body in bodies_of_pair(context, place)))


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
    """Return (n,) 1 if positions move with the velocity after a step, 0 for RK4."""
    return np.array([name != "RK4" for name in context.setup.settings["integrator"]], np.float64)


def friction(context: Context, place: int = 0) -> Floats:
    """Return (n,) a friction coefficient: sliding [1], or at place 2 torsional, 3 rolling [m]."""
    return context.setting("friction").reshape(context.trace.runs, -1)[:, place]


@cached
def gravity(context: Context) -> Floats:
    """Return (n,) the magnitude of gravity [m/s^2]."""
    return np.sqrt(squared_lengths(context.setup.gravity))


@cached
def hold_window(context: Context) -> NDArray[np.bool_]:
    """Return (n, N) the steps that begin in [from, to) of the hold; none if runs end earlier."""
    trace, hold = context.trace, context.setup.hold
    if hold is None:
        return np.zeros(trace.contacts.shape, dtype=np.bool_)
    first, last = (
        np.ceil(times / trace.timestep - COARSE_ROUNDING)[:, None]
        for times in (hold.start, hold.stop)
    )
    steps = np.arange(trace.steps)
    # A run may be half a step short if its duration is not a whole number of steps.
    return (steps >= first) & (steps < last) & (last <= trace.steps + 1)


@cached
def hold_seconds(context: Context) -> Floats:
    """Return (n,) the length of the hold window [s]; NaN without one."""
    steps = count(hold_window(context))
    return np.where(steps > 0, steps, np.nan) * context.trace.timestep


def count(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return (...) the number of true steps of a mask (..., N), faster than by a sum."""
    return np.bitwise_count(np.packbits(mask, axis=-1)).sum(axis=-1, dtype=np.intp)


def share(mask: NDArray[np.bool_]) -> Floats:
    """Return (...) the share of true steps of a mask (..., N)."""
    return count(mask) / mask.shape[-1]


def runs_where(mask: NDArray[np.bool_]) -> list[int]:
    """Return the runs with a true entry in a mask (n,)."""
    return mask.nonzero()[0].tolist() if mask.any() else []


def first_step(mask: NDArray[np.bool_]) -> int:
    """Return the first true step of a mask (N,); 0 if there is none."""
    return int(mask.argmax())
