"""One run's contact slots, gathered by column and summed into net force and slip."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import DISTANCE, FORCE, LINEAR_VELOCITY, NORMAL, TANGENT, Floats
from contactlab.measure.cone import Complexes, Cone

_NORMAL_FORCE = FORCE.start
_TANGENTIAL_FORCE = slice(FORCE.start + 1, FORCE.stop)
_SLIP = slice(LINEAR_VELOCITY.start + 1, LINEAR_VELOCITY.stop)
_FRAME = slice(NORMAL.start, TANGENT.stop)


@dataclass(frozen=True)
class Columns:
    """What is read of the slots of one run, contiguous in time.

    Attributes:
        normal: (S, N) normal force [N].
        distance: (S, N) signed distance [m].
        force: (S, N) tangential force [N], along the first and the second tangent.
        velocity: (S, N) tangential velocity [m/s], likewise.
        frame: (3, S, N) the normal's and the first tangent's coordinates two by two; None for a
            single slot, whose frame is the only one.
    """

    normal: Floats
    distance: Floats
    force: Complexes
    velocity: Complexes
    frame: Complexes | None


class Net(NamedTuple):
    """Sums over the slots of one run, (N,) each.

    Attributes:
        normal: sum of the normal forces [N].
        tangential: magnitude of the sum of the tangential forces [N].
        used: the same in the norm of the cone [N].
        slip: magnitude of the mean tangential velocity [m/s], weighted by normal force.
        each: sum of the magnitudes of the tangential forces, each in the norm of the cone [N].
    """

    normal: Floats
    tangential: Floats
    used: Floats
    slip: Floats
    each: Floats


def gather(slots: Floats) -> Columns:
    """Gather the columns of one run's slots (N, S, 23)."""
    if slots.strides[-1] != slots.itemsize:
        slots = np.ascontiguousarray(slots)
    return Columns(
        normal=np.ascontiguousarray(slots[:, :, _NORMAL_FORCE].T),
        distance=np.ascontiguousarray(slots[:, :, DISTANCE].T),
        force=_by_twos(slots, _TANGENTIAL_FORCE)[0],
        velocity=_by_twos(slots, _SLIP)[0],
        frame=_by_twos(slots, _FRAME) if slots.shape[1] > 1 else None,
    )


def sum_slots(columns: Columns, cone: Cone) -> Net:
    """Sum the slots of one run, in the first contact's frame or, where they differ, the world's."""
    normal = columns.normal.sum(axis=0)
    force = columns.force.sum(axis=0)
    impulse = (columns.velocity * columns.normal).sum(axis=0)
    used, each = cone.norm(force), cone.norm(columns.force).sum(axis=0)
    net = Net(normal, modulus(force), used, modulus(impulse), each)
    if columns.frame is not None and not _same(columns.frame[:, 1:], columns.frame[:, :1]):
        differ = (columns.frame[:, 1:] != columns.frame[:, :1]).any(axis=(0, 1))
        _sum_in_world(columns, cone, np.flatnonzero(differ), net)
    return net._replace(slip=net.slip / np.where(normal > 0, normal, np.inf))


def modulus(pair: Complexes) -> Floats:
    """Return the magnitude of numbers two by two."""
    return np.sqrt(pair.real * pair.real + pair.imag * pair.imag)


def _by_twos(slots: Floats, field: slice) -> Complexes:
    """Return (k, S, N) a field of 2 k numbers."""
    pairs = slots[:, :, field].view(np.complex128)
    return np.ascontiguousarray(pairs.transpose(2, 1, 0))


def _cross(one: Sequence[Floats], other: Floats) -> Floats:
    (x, y, z), (p, q, r) = one, other
    return np.stack((y * r - z * q, z * p - x * r, x * q - y * p))


def _same(some: Complexes, others: Complexes) -> bool:
    return bool((some.view(np.float64) == others.view(np.float64)).all())


def _sum_in_world(columns: Columns, cone: Cone, steps: NDArray[np.intp], net: Net) -> None:
    """Replace in `net` the sums of the given steps; its slip is times normal force."""
    assert columns.frame is not None
    first, second, third = columns.frame[:, :, steps]
    tangent = np.stack((second.imag, third.real, third.imag))
    cotangent = _cross((first.real, first.imag, second.real), tangent)

    def total(pairs: Complexes) -> Floats:
        return (pairs.real * tangent + pairs.imag * cotangent).sum(axis=1)

    force = total(columns.force[:, steps])
    square = (force * force).sum(axis=0)
    along, across = ((force * axis[:, 0]).sum(axis=0) for axis in (tangent, cotangent))
    net.tangential[steps] = np.sqrt(square)
    net.used[steps] = cone.norm(along + 1j * across, square - along**2 - across**2)
    impulse = total(columns.velocity[:, steps] * columns.normal[:, steps])
    net.slip[steps] = np.sqrt((impulse * impulse).sum(axis=0))
