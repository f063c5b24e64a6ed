"""How far two motions that began in one state are apart at the end of a window."""

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.numerical_tolerance import ROUNDING


def nearest(end: Floats, others: Floats) -> Floats:
    """Return (M, B) distances of (M, B, 6) velocities from polylines through (M, K, B, 6)."""
    first, along = others[:, :-1], np.diff(others, axis=1)
    away = end[:, None] - first
    length = (along**2).sum(axis=-1)
    part = (away * along).sum(axis=-1) / np.where(length > 0, length, 1)
    part = np.clip(part, 0, 1)[..., None]
    return np.sqrt(((away - part * along) ** 2).sum(axis=-1).min(axis=1))


def defects(one: Floats, other: Floats) -> Floats:
    """Return (M, B) how far velocities are apart, up to a shift in time by one step of the run.

    Both are (M, 2 r + 1, B, 6), from one step before the end of the window to one after, with r of
    their own, and straight in between: with the points alone, how far they lie apart would count.
    The time of an event is uncertain by a step in any stepping, so each motion's end is compared
    with all of the other's: with one side alone, what stands still agrees with all that passes
    through rest.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        ends = one[:, one.shape[1] // 2], other[:, other.shape[1] // 2]
        apart = np.maximum(nearest(ends[0], other), nearest(ends[1], one))
    return np.where(np.isnan(apart), np.inf, apart)


def to_the_limit(quarter: Floats, eighth: Floats) -> Floats:
    """Return (B,) factors from defects against h/4 (B,) to those against the limit of fine steps.

    Extrapolated as Richardson does from those against h/8 (B,): in first order, what h/8 adds to
    h/4 is half of what is left to add. At least a half, and 1 for what gave up or has no defect.
    """
    is_usable = (quarter > 0) & np.isfinite(quarter) & np.isfinite(eighth)
    factors = 2 * np.where(is_usable, eighth, 1) / np.where(is_usable, quarter, 1) - 1
    return np.where(is_usable, np.maximum(factors, 0.5), 1.0)


def paths(velocities: Floats) -> Floats:
    """Return (M, B) lengths of paths of velocity, from (M, K, B, 6)."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.linalg.norm(np.diff(velocities, axis=1), axis=-1).sum(axis=1)


def energy_defects(end: Floats, around: Floats) -> Floats:
    """Return (M, 2) by how much energies (M,) leave those of the reference [J].

    First the range of (M, K), which that has around the end; what is within rounding of the
    energies is 0. Then what the range forgives: the distance from its middle, less that.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        low, high = around.min(axis=1), around.max(axis=1)
        apart = end - np.clip(end, low, high)
        rounding = ROUNDING * np.maximum(np.abs(end), np.abs(around).max(axis=1))
        apart = np.where(np.abs(apart) > rounding, apart, 0.0)
        forgiven = end - around[:, around.shape[1] // 2] - apart
    return np.stack((apart, forgiven), axis=-1)


def settled(defects_by_rate: Floats) -> Floats:
    """Return (W,) defects of energy, from (W, 2) of windows that follow upon each other.

    What was forgiven to one is taken off the next, where it is of the other sign: an event that
    the run has a step too early, or a part of it, is missing afterwards.
    """
    apart, forgiven = defects_by_rate.T
    before = np.nan_to_num(np.append(0.0, forgiven[:-1]))
    back = np.where(before * apart < 0, np.minimum(np.abs(before), np.abs(apart)), 0.0)
    return apart - np.copysign(back, apart)


def drift(shares: Floats) -> float:
    """Return the drift of sums over windows, from (W,) defects as shares of all energy.

    The larger of two: the mean of the last third of the sums less that of the first, times 3/2,
    which is the whole of a steady drift, but no more than the sums reach in that third; and what no
    sum of it gives back, which is the whole of one that ended early, as of what is damped to rest.
    What goes up and down and comes back leaves little of either.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        sums = np.cumsum(shares)
        third = max(1, len(sums) // 3)
        last = sums[-third:]
        low, high = min(last.min(), 0), max(last.max(), 0)
        trend = np.clip(1.5 * (last.mean() - sums[:third].mean()), low, high)
        stays = max(last.min(), 0) + min(last.max(), 0)
        largest = max(trend, stays, key=abs) if len(sums) > 2 else sums[-1]
    return float(np.inf if np.isnan(largest) else largest)
