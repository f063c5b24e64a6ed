"""Energy of motion without friction or contact."""

import numpy as np

from contactlab.contact import Floats
from contactlab.measure.conservation import energy_scale
from contactlab.measure.context import Context, energy
from contactlab.measure.oracles.oracle import Oracle


def _conserved_energy(context: Context) -> tuple[Floats, Floats]:
    values = energy(context)
    change = np.abs(values - values[:, :1]).max(axis=1)
    return np.zeros(context.trace.runs), change / energy_scale(context)


CONSERVED_ENERGY = Oracle(
    name="conserved_energy",
    unit="1",
    relative=False,
    definition=(
        "Mechanical energy of free motion stays what it was. Measured: largest change either way, "
        "as a share of the energy at the start that could become motion, as for energy_gain. Not "
        "for scenes with contact, whose springs hold energy that is not counted."
    ),
    settings=("timestep",),
    function=_conserved_energy,
)
