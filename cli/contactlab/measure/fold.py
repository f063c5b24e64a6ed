"""Contact slots of one pair folded into net force, use of the friction bound, and slip."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats, PairTrace
from contactlab.measure.cone import Cone, cones
from contactlab.measure.slots import Columns, gather, sum_slots

_FORCELESS = 1e-9
"""Share of a run's largest normal force below which a contact's force direction is rounding."""


@dataclass(frozen=True)
class Folded:
    """One pair's contacts, summed over its slots or reduced to the worst slot.

    Attributes:
        found: (n, N) contacts that matched, recorded or not.
        contacts: (n, N) contacts recorded.
        normal: (n, N) sum of the normal forces [N].
        tangential: (n, N) magnitude of the sum of the tangential forces [N].
        usage: (n, N) share of the friction bound that this sum uses, in the cone's own norm.
        slip: (n, N) magnitude of the mean tangential velocity [m/s], weighted by normal force.
        grip: (n, N) share of the bound that the contacts use, each by itself; at least `usage`.
        distance: (n, N) least signed distance [m]; 0 where nothing touches.
        excess: (n,) most that the tangential force of one contact exceeds its bound, as a share.
        detached: (n,) most that one contact's normal force times its positive distance is [J].
    """

    found: NDArray[np.int32]
    contacts: NDArray[np.int32]
    normal: Floats
    tangential: Floats
    usage: Floats
    slip: Floats
    grip: Floats
    distance: Floats
    excess: Floats
    detached: Floats


def fold(pair: PairTrace, elliptic: NDArray[np.bool_]) -> Folded:
    """Fold the slots of a pair, run by run, so that what is gathered stays in the cache.

    Slots that a run never fills, which come last, are left out.
    """
    runs, steps, slots, _ = pair.slots.shape
    found = pair.found.astype(np.int32)
    contacts = np.minimum(found, slots)
    series, worst = np.empty((6, runs, steps)), np.empty((2, runs))
    for run, cone in enumerate(cones(pair, elliptic)):
        columns = gather(pair.slots[run, :, : max(contacts[run].max(initial=0), 1)])
        net = sum_slots(columns, cone)
        bound = cone.friction * net.normal
        usage = _ratio(net.used, bound)
        distance = _least(columns.distance, contacts[run])
        series[:, run] = (
            net.normal,
            net.tangential,
            usage,
            net.slip,
            _ratio(net.each, bound),
            distance,
        )
        worst[:, run] = _excess(columns, cone), _detached(columns)
    return Folded(found, contacts, *series, *worst)


def _ratio(part: Floats, whole: Floats) -> Floats:
    """Return part / whole, and 0 where the whole is not positive."""
    return part / np.where(whole > 0, whole, np.inf)


def _least(distance: Floats, contacts: NDArray[np.int32]) -> Floats:
    """Return the least distance over the filled slots, which come first; 0 where none is."""
    if not (distance > 0).any():
        return distance.min(axis=0)
    filled = np.arange(len(distance))[:, None] < contacts
    return np.where(contacts > 0, np.where(filled, distance, np.inf).min(axis=0), 0)


def _excess(columns: Columns, cone: Cone) -> Floats:
    used, bound = cone.norm(columns.force), cone.friction * columns.normal
    over = used > bound
    over &= columns.normal > _FORCELESS * columns.normal.max(initial=0)
    return (used[over] / bound[over]).max(initial=1) - 1


def _detached(columns: Columns) -> Floats:
    return (columns.normal * np.maximum(columns.distance, 0)).max(initial=0)
