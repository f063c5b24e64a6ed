"""The arrays of a stored trace."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats, Integers
from contactlab.errors import StoreError, did_you_mean

ACTIVATIONS = "activations"
"""Entry of a trace's metadata: actuator activations, which are hashed but not in the trace."""

_Number = TypeVar("_Number", bound=np.generic)


@dataclass(frozen=True)
class StoredPair:
    """One pair's contacts, in the M steps in which it touched."""

    name: str
    steps: Integers  # (M,) index of each such step, ascending
    contacts: Integers  # (M,) number of contact points stored
    # (M,) number of contacts of the pair; more than `contacts` if they exceed the slots.
    found: Integers
    mode: NDArray[np.int8]  # (M,) NO_CONTACT, STICK or SLIDE
    normal: Floats  # (M,) net normal force [N]
    tangential: Floats  # (M,) magnitude of the net tangential force [N]
    usage: Floats  # (M,) fraction of the friction limit in use
    slip: Floats  # (M,) magnitude of the force-weighted tangential velocity [m/s]
    distance: Floats  # (M,) least signed distance [m]
    # (K, 23) the contact points of all steps, concatenated; each a contact slot as in `PairTrace`,
    # rounded to single precision.
    points: Floats

    units: ClassVar[Mapping[str, str]] = {
        "contacts": "1",
        "found": "1",
        "normal": "N",
        "tangential": "N",
        "usage": "1",
        "slip": "m/s",
        "distance": "m",
    }
    """The unit of each array of measured values."""

    @property
    def point_steps(self) -> Integers:
        """(K,) step of each contact point."""
        return np.repeat(self.steps, self.contacts)

    def over(self, steps: int, values: NDArray[_Number], apart: float = 0) -> NDArray[_Number]:
        """(N,) values (M,) of the steps with contact over all N, `apart` in the others."""
        spread = np.full(steps, apart, dtype=values.dtype)
        spread[self.steps] = values
        return spread


@dataclass(frozen=True)
class StoredTrace:
    """One run of N steps; arrays and their time alignment are those of a run of `Trace`.

    Everything but individual contact points is bit for bit as recorded.
    """

    time: Floats
    qpos: Floats
    qvel: Floats
    kinetic: Floats
    potential: Floats
    contacts: Integers
    least_distance: Floats
    iterations: Integers
    iterations_most: Integers
    momentum: Floats | None
    angular_momentum: Floats | None
    pairs: tuple[StoredPair, ...]
    record_json: bytes  # the EvidenceRecord
    metadata: Mapping[str, str]  # the run's identity
    model_xml: bytes  # the MJCF as simulated

    units: ClassVar[Mapping[str, str]] = {
        "time": "s",
        "qpos": "m, rad",
        "qvel": "m/s, rad/s",
        "kinetic": "J",
        "potential": "J",
        "contacts": "1",
        "least_distance": "m",
        "iterations": "1",
        "iterations_most": "1",
        "momentum": "kg m/s",
        "angular_momentum": "kg m^2/s",
    }
    """The unit of each array; for coordinates, of slide and of hinge joints."""

    def pair(self, name: str) -> StoredPair:
        """Return a pair by its name; raise StoreError if no monitored pair has it."""
        for pair in self.pairs:
            if pair.name == name:
                return pair
        known = [pair.name for pair in self.pairs]
        hint = did_you_mean(name, known) or f"; recorded pairs: {', '.join(known) or 'none'}"
        raise StoreError(f"no pair '{name}' was recorded{hint}")
