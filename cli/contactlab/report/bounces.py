"""Bounces of a body: how high it comes, and how much of that is left after each."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from contactlab.contact import Floats, damping_ratio, restitution_of
from contactlab.report.coordinates import coordinates
from contactlab.report.grid import GridAxis
from contactlab.report.series import thinned
from contactlab.schema import EvidenceRecord
from contactlab.store import Store
from contactlab.store.mcap import StoredPair, StoredTrace

MOST_RUNS = 6
_MOST_READ = 200
_FEWEST = 2
# What comes less high than this share of the fall is lost in the contact's own depth.
_SEEN = 0.02


@dataclass(frozen=True)
class Bounces:
    """One run that bounces.

    Attributes:
        setting: what tells it from the others.
        time: (P,) [s].
        height: (P,) above where it first touches [m].
        peaks: (B + 1,) greatest height before the first bounce, and after each [m].
        restitution: what its contact is set to.
    """

    setting: str
    time: Floats
    height: Floats
    peaks: Floats
    restitution: float

    @property
    def ratios(self) -> Floats:
        """(B,) height after each bounce over that before; e^2 without loss in flight."""
        return self.peaks[1:] / self.peaks[:-1]


def bouncing(store: Store, axes: Sequence[GridAxis], stable: np.ndarray) -> list[Bounces]:
    """Return runs that bounce at least once, one for each value of what tells them apart.

    Args:
        store: the store.
        axes: the axes that differ between its runs.
        stable: (n,) whether a run has no failure label; only these are drawn.
    """
    axis = _telling(store, axes, stable)
    found: dict[str, Bounces] = {}
    for row in np.flatnonzero(stable)[:_MOST_READ].tolist():
        setting = f"{axis.name} {axis.words[axis.codes[row]]}" if axis else "the scene's own"
        if setting not in found and len(found) < MOST_RUNS:
            record = store.record(store.columns.identify([row])[0]["run_id"])
            if record.trace is None:
                continue
            one = _bounces(store.trace(record), record, setting)
            if one is not None:
                found[setting] = one
    return list(found.values())


def _telling(store: Store, axes: Sequence[GridAxis], stable: np.ndarray) -> GridAxis | None:
    """Return the axis along which the measured restitution of stable runs varies most."""
    if not axes or "restitution_measured" not in store.columns.schema.names:
        return None
    values = store.columns.numbers("restitution_measured").values
    values = np.where(stable, values, np.nan)

    def spread(axis: GridAxis) -> float:
        groups = (
            values[(axis.codes == code) & np.isfinite(values)] for code in range(len(axis.words))
        )
        means = [float(np.median(group)) for group in groups if len(group)]
        return max(means, default=0.0) - min(means, default=0.0)

    return max(axes, key=spread)


def _bounces(trace: StoredTrace, record: EvidenceRecord, setting: str) -> Bounces | None:
    heights = [each for each in coordinates(trace.model_xml, trace.qpos.shape[1]) if each.is_height]
    if not heights or not trace.pairs or not len(trace.pairs[0].steps):
        return None
    pair = trace.pairs[0]
    height = trace.qpos[:, heights[0].place] - trace.qpos[pair.steps[0], heights[0].place]
    peaks = np.array(list(_peaks(height, pair)))
    low = np.flatnonzero(peaks < _SEEN * peaks[0])
    peaks = peaks[: low[0]] if len(low) else peaks
    if len(peaks) < _FEWEST:
        return None
    places = thinned(height)
    solref = record.pairs[pair.name].solref
    return Bounces(
        setting,
        trace.time[places],
        height[places],
        peaks,
        float(restitution_of(damping_ratio(solref))),
    )


def _peaks(height: Floats, pair: StoredPair) -> Iterator[float]:
    """Yield the greatest height of each flight that has an end; the last one may be cut short."""
    gaps = np.flatnonzero(np.diff(pair.steps) > 1)
    yield float(height[: pair.steps[0] + 1].max())
    for gap in gaps.tolist():
        yield float(height[pair.steps[gap] : pair.steps[gap + 1] + 1].max())
