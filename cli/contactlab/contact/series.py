"""One pair's contacts folded into net quantities over time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.arrays import Floats

NO_CONTACT = 0
STICK = 1
SLIDE = 2


@dataclass(frozen=True)
class PairSeries:
    """Net quantities of one graded pair, for n runs of N steps.

    Attributes:
        name: the pair's name.
        contacts: (n, N) contacts recorded, at most the slots.
        normal: (n, N) net normal force [N].
        tangential: (n, N) magnitude of the net tangential force [N].
        usage: (n, N) share of the friction bound in use, in the cone's own norm; 1 means sliding.
        slip: (n, N) magnitude of the force-weighted tangential velocity [m/s].
        distance: (n, N) least signed distance [m]; 0 where nothing touches.
        mode: (n, N) NO_CONTACT, STICK or SLIDE, with hysteresis (see `measure`).
    """

    name: str
    contacts: NDArray[np.int32]
    normal: Floats
    tangential: Floats
    usage: Floats
    slip: Floats
    distance: Floats
    mode: NDArray[np.int8]
