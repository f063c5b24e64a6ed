"""The contacts of pairs, reduced over their slots: net force, friction in use, slip and mode.

Tangential forces and velocities are summed in the world frame, and the 1-norm of a pyramidal cone
is taken in the frame of the first contact. Two components along the tangents are kept as one
complex number, so that a slot's columns stay contiguous in time.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import (
    ANGULAR_VELOCITY,
    DISTANCE,
    FORCE,
    LINEAR_VELOCITY,
    NORMAL,
    TANGENT,
    Floats,
    Integers,
    PairSeries,
    PairTrace,
)
from contactlab.measure.stick_slip import contact_modes
from contactlab.numerical_tolerance import SUM_ROUNDING

Complexes = NDArray[np.complex128]
"""Two numbers each: components along two tangents, or neighbors that are moved together."""

_NORMAL_FORCE = FORCE.start
_FRAME_FIELDS = slice(NORMAL.start, TANGENT.stop)


@dataclass(frozen=True)
class NetContact:
    """The contacts of R pairs, summed over their slots or reduced to the worst slot."""

    series: PairSeries  # the net quantities over time, (R, n, N)
    found: Integers  # (R, n, N) contacts that matched, recorded or not
    hardest: Floats  # (R, n, N) largest normal force of one contact [N]
    grip: Floats  # (R, n, N) share of the bound that the contacts use, each alone
    rolling: Floats
    """(R, n, N) relative angular speed of the first contact about its tangents [rad/s]."""
    spinning: Floats  # (R, n, N) the same about its normal
    excess: Floats
    """(R, n) relative excess of contacts' tangential forces over their bounds; a hundredth of the
    contacts that carry force, as at impacts, exceed it."""
    detached: Floats  # (R, n) largest product of normal force and positive distance [J]
    farthest: Floats  # (R, n) largest distance of a contact [m]; 0 if all overlap
    standoff: Floats  # (R, n) mean positive distance of contacts, weighted by normal force [m]


@dataclass(frozen=True)
class _Cone:
    """Friction bounds in T steps: on the 2-norm if elliptic, otherwise on the 1-norm."""

    friction: Floats  # (T,) the coefficient along the first tangent
    stretch: Floats  # (T,) `friction` over the coefficient along the second
    elliptic: bool

    def select_steps(self, steps: NDArray[np.intp]) -> "_Cone":
        """Return the bounds of some steps."""
        return _Cone(self.friction[steps], self.stretch[steps], self.elliptic)

    def norm(self, force: Complexes, out_of_plane: Floats | None = None) -> Floats:
        """Return the bounded norm of forces [N]; the 2-norm adds their square off the plane."""
        across = force.imag * self.stretch
        if not self.elliptic:
            return np.abs(force.real) + np.abs(across)
        square = force.real * force.real + across * across
        return np.sqrt(square if out_of_plane is None else square + out_of_plane)


@dataclass(frozen=True)
class _SlotColumns:
    """Fields of S slots in T steps, (S, T) each and contiguous in time."""

    normal: Floats
    distance: Floats
    force: Complexes  # along both tangents [N]
    velocity: Complexes  # along both tangents [m/s]
    turning: Floats  # (3, T) the first slot's angular velocity, normal first
    frame: Complexes | None  # (3, S, T) normal and tangent, two by two; None for a single slot


def net_contact(
    pairs: Sequence[PairTrace],
    pull: Floats,
    elliptic: NDArray[np.bool_],
    timestep: Floats,
    steps: int,
) -> NetContact:
    """Reduce the slots of pairs.

    Runs of pairs with as many filled slots are reduced together, a few at a time, so that gathered
    data stays in the cache. `pull` (n,) is gravity [m/s^2], `elliptic` (n,) the cone's form, and
    `timestep` (n,) [s] the length of a step.
    """
    shape = len(pairs), len(timestep), steps
    series, worst = np.zeros((shape[0], 9, *shape[1:])), np.zeros((shape[0], 4, shape[1]))
    contact_counts, slots = np.zeros(shape, np.int32), np.zeros((shape[0], 1, 1), np.int32)
    for row, pair in enumerate(pairs):
        contact_counts[row], slots[row] = pair.found, pair.slots.shape[2]
    contacts = np.clip(contact_counts, 0, slots)
    friction = np.array([pair.friction[:, :2] for pair in pairs]).reshape(*shape[:2], 2)
    filled = contacts.max(axis=2, initial=0)
    for group in _alike_runs(filled, elliptic, steps):
        rows, runs = zip(*group, strict=True)
        first, second = friction[rows, runs].repeat(steps, axis=0).T
        stretch = np.where(first == second, 1, first / second)
        parts = [pairs[row].slots[run][:, : filled[row, run]] for row, run in group]
        columns = _gather_columns(parts)
        cone = _Cone(first, stretch, bool(elliptic[runs[0]]))
        alone = cone.norm(columns.force)
        reduced = np.array(_reduce_steps(columns, contacts[rows, runs].ravel(), cone, alone))
        for place, (row, run) in enumerate(group):
            some = slice(place * steps, (place + 1) * steps)
            series[row, :, run] = reduced[:, some]
            worst[row, :, run] = _find_worst(columns, alone, some, friction[row, run, 0])
    normal, tangential, usage, slip, distance, *others = np.moveaxis(series, 1, 0)
    hardest, grip, rolling, spinning = others
    mode = contact_modes(normal > 0, usage, grip, slip / pull[:, None], timestep)
    net_series = PairSeries("", contacts, normal, tangential, usage, slip, distance, mode)
    return NetContact(
        net_series, contact_counts, hardest, grip, rolling, spinning, *np.moveaxis(worst, 1, 0)
    )


def _alike_runs(
    filled: NDArray[np.int32], elliptic: NDArray[np.bool_], steps: int
) -> Iterator[list[tuple[int, int]]]:
    contacts_together = 1 << 13  # their columns take about 1 MB
    groups: dict[tuple[int, bool], list[tuple[int, int]]] = {}
    for row, run in np.argwhere(filled).tolist():
        key = int(filled[row, run]), bool(elliptic[run])
        group = groups.setdefault(key, [])
        group.append((row, run))
        # NumPy sums the slots of a single step in another order.
        if steps == 1 or len(group) * key[0] * steps >= contacts_together:
            yield groups.pop(key)
    yield from groups.values()


def _gather_columns(runs: Sequence[Floats]) -> _SlotColumns:
    """Gather the columns of runs of as many slots, (N, S, 23) each, one after the other."""
    steps, slots, _ = runs[0].shape
    numbers = np.empty((2, slots, len(runs) * steps))
    neighbors = np.empty((2, slots, len(runs) * steps), complex)
    turning = np.empty((3, len(runs) * steps))
    frame = np.empty((3, *neighbors.shape[1:]), complex) if slots > 1 else None
    for place, run in enumerate(runs):
        some = slice(place * steps, (place + 1) * steps)
        part = run if run.strides[-1] == run.itemsize else np.ascontiguousarray(run)
        numbers[0, :, some] = part[:, :, _NORMAL_FORCE].T
        numbers[1, :, some] = part[:, :, DISTANCE].T
        for row, field in enumerate((FORCE, LINEAR_VELOCITY)):
            along = part[:, :, field.start + 1 : field.stop].view(complex)
            neighbors[row, :, some] = along[:, :, 0].T
        turning[:, some] = part[:, 0, ANGULAR_VELOCITY].T
        if frame is not None:
            frame[:, :, some] = part[:, :, _FRAME_FIELDS].view(complex).transpose(2, 1, 0)
    (normal, distance), (force, velocity) = numbers, neighbors
    return _SlotColumns(normal, distance, force, velocity, turning, frame)


def _reduce_steps(
    columns: _SlotColumns, contacts: NDArray[np.int32], cone: _Cone, alone: Floats
) -> tuple[Floats, ...]:
    """Return the series (T,) of steps; `alone` (S, T) are norms of single tangential forces."""
    # Sums over slots are in the first contact's frame or, if frames differ, in the world's.
    normal, force = columns.normal.sum(axis=0), columns.force.sum(axis=0)
    impulse = (columns.velocity * columns.normal).sum(axis=0)
    sums = np.stack((_complex_modulus(force), cone.norm(force), _complex_modulus(impulse)))
    frame = columns.frame
    if frame is not None:
        differ = (frame[:, 1:] != frame[:, :1]).any(axis=(0, 1))
        steps = np.flatnonzero(differ)
        if len(steps):
            sums[:, steps] = _sum_in_world(columns, frame[:, :, steps], cone, steps)
    tangential, friction_use, impulse = sums
    # The mean slip velocity [m/s], weighted by normal force.
    slip = impulse / np.where(normal > 0, normal, np.inf)
    bound = cone.friction * normal
    spin, along, across = columns.turning
    # The filled slots come first.
    filled = np.arange(len(columns.distance))[:, None] < contacts
    least_distance = np.where(filled, columns.distance, np.inf).min(axis=0)
    return (
        normal,
        tangential,
        _safe_ratio(friction_use, bound),
        slip,
        np.where(contacts > 0, least_distance, 0),
        columns.normal.max(axis=0),
        _safe_ratio(alone.sum(axis=0), bound),
        np.sqrt(along * along + across * across),
        np.abs(spin),
    )


def _find_worst(
    columns: _SlotColumns, alone: Floats, some: slice, friction: float
) -> tuple[Any, ...]:
    # NumPy sums contiguous numbers in one order, others in another.
    normal, alone, distance = (
        np.ascontiguousarray(each[:, some]) for each in (columns.normal, alone, columns.distance)
    )
    apart = normal * np.maximum(distance, 0)
    standoff = apart.sum() / max(normal.sum(), np.finfo(float).tiny)
    bound = friction * normal
    over = alone > bound
    over &= normal > SUM_ROUNDING * normal.max(initial=0)
    excess = np.sort(alone[over] / bound[over])[::-1] - 1
    brief_share = 0.01  # of the contacts that carry force: single steps of impacts do not count
    brief = int(brief_share * np.count_nonzero(bound))
    return (
        excess[brief : brief + 1].max(initial=0),
        apart.max(initial=0),
        distance.max(initial=0),
        standoff,
    )


def _sum_in_world(
    columns: _SlotColumns, frame: Complexes, cone: _Cone, steps: NDArray[np.intp]
) -> Floats:
    """Return (3, steps) tangential force, its norm of the cone, and velocity times normal force."""
    first, second, third = frame
    tangent = np.stack((second.imag, third.real, third.imag))
    x, y, z, (p, q, r) = first.real, first.imag, second.real, tangent
    # The cross product by hand: in the layout of np.cross, sums would round differently.
    cotangent = np.stack((y * r - z * q, z * p - x * r, x * q - y * p))

    def total(pairs: Complexes) -> Floats:
        return (pairs.real * tangent + pairs.imag * cotangent).sum(axis=1)

    force = total(columns.force[:, steps])
    square = (force * force).sum(axis=0)
    along, across = ((force * axis[:, 0]).sum(axis=0) for axis in (tangent, cotangent))
    friction_use = cone.select_steps(steps).norm(along + 1j * across, square - along**2 - across**2)
    impulse = total(columns.velocity[:, steps] * columns.normal[:, steps])
    return np.stack((np.sqrt(square), friction_use, np.sqrt((impulse * impulse).sum(axis=0))))


def _complex_modulus(pair: Complexes) -> Floats:
    """Return magnitudes, faster than `abs`, which guards against overflow."""
    return np.sqrt(pair.real * pair.real + pair.imag * pair.imag)


def _safe_ratio(part: Floats, whole: Floats) -> Floats:
    """Return part / whole, or 0 if the whole is not positive."""
    return part / np.where(whole > 0, whole, np.inf)
