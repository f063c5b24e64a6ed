"""What became of a motion's energy, and how its error goes with the timestep."""

import math
from dataclasses import dataclass

import numpy as np

from contactlab.contact import Floats
from contactlab.store.mcap import StoredTrace

_SAMPLE = 0.25
"""When trajectories are compared [s]: before a chaotic motion parts them for other reasons."""

_LEAST = 1e-12
"""Difference [m or rad] below which there is rounding only."""


@dataclass(frozen=True)
class Ledger:
    """The energy of one motion of N steps.

    Attributes:
        seconds: how long it was.
        change: mechanical energy at the end less that at the start [J].
        most: largest distance of the energy from that at the start [J].
        peak: largest kinetic energy [J].
        dampers: what viscous damping of the joints took [J].
    """

    seconds: float
    change: float
    most: float
    peak: float
    dampers: float

    def rate(self, peak: float) -> float:
        """Return the change of energy over a peak kinetic energy [J] and time [1/s]."""
        return self.change / peak / self.seconds

    def unexplained(self, peak: float) -> float:
        """Return the same for the change that the dampers leave unexplained [1/s]."""
        return (self.change + self.dampers) / peak / self.seconds


def ledger_of(trace: StoredTrace, damping: Floats, apart: tuple[Floats, Floats]) -> Ledger:
    """Return the ledger of a trace.

    A damper with coefficient b takes the power b qvel^2; its integral is by the trapezoidal rule,
    whose error goes with the square of the timestep.

    Args:
        trace: a run of at least two steps.
        damping: (nv,) viscous coefficient of each degree of freedom.
        apart: (N + 1,) each, kinetic and potential energy of what is left out [J].
    """
    rows = len(trace.kinetic)
    kinetic = trace.kinetic - apart[0][:rows]
    energy = kinetic + trace.potential - apart[1][:rows]
    power = (trace.qvel[:rows] ** 2) @ damping
    return Ledger(
        seconds=float(trace.time[rows - 1] - trace.time[0]),
        change=float(energy[-1] - energy[0]),
        most=float(np.abs(energy - energy[0]).max()),
        peak=float(kinetic.max()),
        dampers=float(np.trapezoid(power, trace.time[:rows])),
    )


def convergence_order(coarse: StoredTrace, middle: StoredTrace, fine: StoredTrace) -> float:
    """Return p of an error that goes with the timestep to the power p, by Richardson's ratio.

    Args:
        coarse: a run at timestep h.
        middle: the same at h/2.
        fine: the same at h/4.

    Returns:
        ``log2(|q(h) - q(h/2)| / |q(h/2) - q(h/4)|)`` with the largest difference of a coordinate
        a quarter of a second after the start; NaN where there is no difference but rounding.
    """
    step = max(1, round(_SAMPLE / float(coarse.time[1] - coarse.time[0])))
    step = min(step, len(coarse.qpos) - 1)
    first = _apart(coarse.qpos[step], middle.qpos[2 * step])
    second = _apart(middle.qpos[2 * step], fine.qpos[4 * step])
    if not min(first, second) > _LEAST:
        return math.nan
    return math.log2(first / second)


def _apart(some: Floats, others: Floats) -> float:
    return float(np.abs(some - others).max())
