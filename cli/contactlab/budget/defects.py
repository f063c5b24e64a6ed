"""How far two motions that began in one state are apart at the end of a window."""

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.numerical_tolerance import ROUNDING


def find_nearest_distances(end: Floats, others: Floats) -> Floats:
    """Return (M, B) distances of (M, B, 6) velocities from polylines through (M, K, B, 6)."""
    first, along = others[:, :-1], np.diff(others, axis=1)
    away = end[:, None] - first
    length = (along**2).sum(axis=-1)
    part = (away * along).sum(axis=-1) / np.where(length > 0, length, 1)
    part = np.clip(part, 0, 1)[..., None]
    return np.sqrt(((away - part * along) ** 2).sum(axis=-1).min(axis=1))


def slack_share(steps: int) -> float:
    """Return the share of a step that motions may be apart in time, in windows of `steps` steps."""
    longest = 0.25  # of a window: 10 ms, which only steps above that are shortened to
    return min(1.0, longest * steps)


def within_slack(velocities: Floats, share: float) -> Floats:
    """Return the part of (M, 2 r + 1, B, 6) velocities around the middle, a share of each side."""
    reach = velocities.shape[1] // 2
    if share >= 1:
        return velocities
    whole = int(share * reach)
    part, middle = share * reach - whole, reach
    inner = velocities[:, middle - whole : middle + whole + 1]
    if not part:
        return inner
    ends = [
        (1 - part) * velocities[:, middle + side * whole]
        + part * velocities[:, middle + side * (whole + 1)]
        for side in (-1, 1)
    ]
    return np.concatenate([ends[0][:, None], inner, ends[1][:, None]], axis=1)


def measure_defects(one: Floats, other: Floats, slack: float = 1.0) -> Floats:
    """Return (M, B) how far velocities are apart, up to a shift in time by a share of a step.

    Both are (M, 2 r + 1, B, 6), from one step before the end of the window to one after, with r of
    their own, and straight in between, because the distance between the points must not count.
    The time of an event is uncertain by a step in any stepping, so each motion's end is compared
    with all of the other's. With one side alone, a body at rest agrees with any motion that passes
    through rest. A step near the length of the window would forgive all that happens in it, so
    `slack` is the share of a step that is forgiven.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        one, other = within_slack(one, slack), within_slack(other, slack)
        ends = one[:, one.shape[1] // 2], other[:, other.shape[1] // 2]
        apart = np.maximum(
            find_nearest_distances(ends[0], other), find_nearest_distances(ends[1], one)
        )
    return np.where(np.isnan(apart), np.inf, apart)


def to_the_limit(quarter: Floats, eighth: Floats) -> Floats:
    """Return (B,) factors from defects against h/4 (B,) to those against the limit of fine steps.

    Extrapolated as Richardson does from those against h/8 (B,): in first order, the step from h/4
    to h/8 is half of the remaining distance. At least a half, and 1 for a body without a defect or
    a motion that gave up.
    """
    is_usable = (quarter > 0) & np.isfinite(quarter) & np.isfinite(eighth)
    factors = 2 * np.where(is_usable, eighth, 1) / np.where(is_usable, quarter, 1) - 1
    return np.where(is_usable, np.maximum(factors, 0.5), 1.0)


def measure_paths(velocities: Floats) -> Floats:
    """Return (M, B) lengths of paths of velocity, from (M, K, B, 6)."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.linalg.norm(np.diff(velocities, axis=1), axis=-1).sum(axis=1)


def energy_defects(end: Floats, around: Floats) -> Floats:
    """Return (M, 2) by how much energies (M,) leave those of the reference [J].

    The first is the distance from the range of (M, K) around the end; 0 within rounding of the
    energies. The second is the part that the range forgives: the distance from its middle, less the
    first.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        low, high = around.min(axis=1), around.max(axis=1)
        apart = end - np.clip(end, low, high)
        rounding = ROUNDING * np.maximum(np.abs(end), np.abs(around).max(axis=1))
        apart = np.where(np.abs(apart) > rounding, apart, 0.0)
        forgiven = end - around[:, around.shape[1] // 2] - apart
    return np.stack((apart, forgiven), axis=-1)


def settle_defects(defects_by_rate: Floats) -> Floats:
    """Return (W,) defects of energy, from (W, 2) of windows that follow upon each other.

    The forgiven part of one window is subtracted from the next if the signs differ: an event that
    the run has a step too early, or a part of it, is missing afterwards.
    """
    apart, forgiven = defects_by_rate.T
    before = np.nan_to_num(np.append(0.0, forgiven[:-1]))
    back = np.where(before * apart < 0, np.minimum(np.abs(before), np.abs(apart)), 0.0)
    return apart - np.copysign(back, apart)


def find_drift(shares: Floats) -> float:
    """Return the drift of sums over windows, from (W,) defects as shares of all energy.

    The larger of two. One is the mean of the last third of the sums less that of the first, times
    3/2, but no more than the sums reach in that third: the whole of a steady drift. The other is
    the part that every sum of the last third keeps: the whole of a drift that ended early, as in a
    motion that is damped to rest. A sum that goes up and down and comes back has little of either.
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
