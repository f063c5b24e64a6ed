"""How an error falls with the timestep: its order, and the floor that it does not fall below."""

from dataclasses import dataclass

import numpy as np

from contactlab.contact import Floats
from contactlab.schema import Floor, Order

FEWEST = 3
# An error this many times what hides it is off by a third at most, from one side.
CLEAR = 3.0
# Twice this is how far a slope may be off: whole orders are told apart with room to spare.
WORST_STANDARD_ERROR = 0.1
LEAST_SLOPE = 0.25
FLAT = 1.5
FLAT_SPAN = 4.0


@dataclass(frozen=True)
class Steps:
    """What one method makes of n timesteps, the finest first.

    Attributes:
        timestep: (n,) distinct [s].
        error: (n,) positive.
        hidden: (n,) what of an error may not be its own: the reference's estimate, or 0.
    """

    timestep: Floats
    error: Floats
    hidden: Floats


def order(steps: Steps, floor: float = 0.0) -> Order:
    """Return the order of convergence.

    A line through log error over log timestep is fitted to the widest range, from the finest clear
    step up, over which its slope has a standard error of at most 0.1; coarser steps are beyond
    where the order shows. A step is clear if its error is three times the reference's estimate, and
    three times the floor.

    Args:
        steps: the timesteps that went through, and whose contact is not clamped.
        floor: the error that no timestep removes; 0 if none is known.
    """
    hidden = np.maximum(steps.hidden, floor)
    clear = steps.error > CLEAR * hidden
    timestep, error = np.log(steps.timestep[clear]), np.log(steps.error[clear])
    if len(timestep) < FEWEST:
        return none(_too_few(len(timestep), steps, floor))
    for count in range(len(timestep), FEWEST - 1, -1):
        slope, standard_error = _line(timestep[:count], error[:count])
        if standard_error <= WORST_STANDARD_ERROR:
            return _judged(slope, standard_error, count)
    return none("the errors of the finest timesteps do not lie on a line")


def none(reason: str) -> Order:
    """Return that there is no order, and why."""
    return Order(slope=None, standard_error=None, points=0, reason=reason)


def find_floor(steps: Steps) -> Floor | None:
    """Return the error that no longer falls with the timestep, or None.

    It is the median over the widest range, from the finest step up, of at least three steps that
    span a factor of four and whose errors stay within a factor of 1.5. An error of order 1/2 would
    change by 2 over that span, one of order 1 by 4.
    """
    found = None
    for count in range(FEWEST, len(steps.timestep) + 1):
        timestep, error = steps.timestep[:count], steps.error[:count]
        if error.max() > FLAT * error.min():
            break
        # The span is compared with a little room, since timesteps such as 1e-3 / 4 are rounded.
        if timestep[-1] >= FLAT_SPAN * timestep[0] * (1 - 1e-9):
            found = Floor(error=float(np.median(error)), points=count, timestep=float(timestep[-1]))
    return found


def _too_few(clear: int, steps: Steps, floor: float) -> str:
    if not floor and not steps.hidden.any():
        return f"{clear} timesteps, and a line takes {FEWEST}"
    what = "the floor" if floor else "the reference's own error"
    return f"{clear} of {FEWEST} or more timesteps have an error above three times {what}"


def _judged(slope: float, standard_error: float, count: int) -> Order:
    if slope < LEAST_SLOPE:
        return none(f"the error does not fall with the timestep (slope {slope:.2g})")
    return Order(slope=slope, standard_error=standard_error, points=count, reason=None)


def _line(x: Floats, y: Floats) -> tuple[float, float]:
    """Return the slope of the least-squares line through (n,) points, and its standard error."""
    across = x - x.mean()
    spread = float(across @ across)
    slope = float(across @ y) / spread
    residual = y - y.mean() - slope * across
    return slope, float(np.sqrt(residual @ residual / (len(x) - 2) / spread))
