"""First impacts of runs, in velocity space."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from contactlab.contact import LINEAR_VELOCITY, STICK, damping_ratio, restitution_of, sticking_speed
from contactlab.schema import EvidenceRecord
from contactlab.store import Store
from contactlab.store.mcap import StoredPair

_MOST_READ = 600
_FEWEST = 3
# Slower than this two bodies rest on each other; it is no impact.
_APPROACH = 0.05


@dataclass(frozen=True)
class Approach:
    """The first impact of a run.

    Attributes:
        engine: what computed it.
        slip: tangential speed before it [m/s].
        bound: the largest one that Coulomb's law stops, mu (1 + e) v_n [m/s].
        sticks: whether the contact stuck at any time in it.
    """

    engine: str
    slip: float
    bound: float
    sticks: bool


def approaches(store: Store) -> list[Approach]:
    """Return the first impacts of runs whose traces are kept; none if they are too few.

    There has to be slip in them, since without it friction has nothing to decide.
    """
    found = list(_approaches(store))
    slipping = [each for each in found if each.slip > 0]
    return found if len(slipping) >= _FEWEST else []


def _approaches(store: Store) -> Iterator[Approach]:
    if store.manifest.traces_left_out or store.manifest.traces < _FEWEST:
        return
    records = (record for record in store.records() if record.trace is not None)
    for _, record in zip(range(_MOST_READ), records, strict=False):
        for pair in store.trace(record).pairs[:1]:
            yield from _of(pair, record)


def _of(pair: StoredPair, record: EvidenceRecord) -> Iterator[Approach]:
    if not len(pair.points):
        return
    velocity = pair.points[0, LINEAR_VELOCITY]
    normal, slip = abs(float(velocity[0])), float(np.linalg.norm(velocity[1:]))
    contact = record.pairs[pair.name]
    if normal < _APPROACH or contact.condim < 3:
        return
    restitution = restitution_of(damping_ratio(contact.solref))
    bound = float(sticking_speed(normal, restitution, contact.friction[0]))
    # Contacts of the first touch only: another one follows after a flight.
    breaks = np.flatnonzero(np.diff(pair.steps) > 1)
    first = pair.mode[: breaks[0] + 1] if len(breaks) else pair.mode
    yield Approach(str(record.settings["engine"]), slip, bound, bool((first == STICK).any()))
