"""Net quantities and mode of one contact pair over time."""

import numpy as np

from contactlab.contact import Floats, PairSeries, PairTrace, Setup, Trace
from contactlab.measure.fold import Folded, fold
from contactlab.measure.modes import modes


def pair_series(pair: PairTrace, trace: Trace, setup: Setup) -> PairSeries:
    """Return the net quantities and the mode of one pair over time.

    Tangential forces and velocities are summed in the world frame, and the 1-norm of a pyramidal
    cone is taken in the frame of the first contact. Contacts without normal force count as gaps
    (see `modes`).
    """
    with np.errstate(all="ignore"):
        return series_of(pair.name, fold(pair, setup.elliptic), trace.timestep)


def series_of(name: str, folded: Folded, timestep: Floats) -> PairSeries:
    """Return the series of a folded pair."""
    return PairSeries(
        name=name,
        contacts=folded.contacts,
        normal=folded.normal,
        tangential=folded.tangential,
        usage=folded.usage,
        slip=folded.slip,
        distance=folded.distance,
        mode=modes(
            folded.normal > 0,
            folded.usage,
            folded.grip,
            folded.slip,
            timestep,
        ),
    )
