"""A stored trace as the few hundred points that a page draws."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import NO_CONTACT, Floats
from contactlab.report.coordinates import Coordinate, coordinates
from contactlab.store.mcap import StoredPair, StoredTrace

POINTS = 400
MOST_COORDINATES = 6


@dataclass(frozen=True)
class Signal:
    """One quantity over time, thinned.

    Attributes:
        name: what it is.
        unit: its unit.
        panel: the chart it belongs to: motion, force or depth.
        time: (P,) [s].
        values: (P,).
    """

    name: str
    unit: str
    panel: str
    time: Floats
    values: Floats


@dataclass(frozen=True)
class Ribbon:
    """When a pair stuck, slid, or did neither.

    Attributes:
        pair: its name.
        starts: (S,) when each stretch begins [s].
        modes: (S,) NO_CONTACT, STICK or SLIDE; a stretch ends where the next begins.
        end: when the last one ends [s].
    """

    pair: str
    starts: Floats
    modes: NDArray[np.int8]
    end: float


@dataclass(frozen=True)
class RunSeries:
    """What a page draws of one run."""

    signals: tuple[Signal, ...]
    ribbons: tuple[Ribbon, ...]


def run_series(trace: StoredTrace) -> RunSeries:
    """Return the motion, forces, depths and modes of a run, at 400 points at most each.

    Of each stretch of steps the least and the largest value are kept, at their own times.
    """
    signals = [*_motion(trace)]
    for pair in trace.pairs:
        signals += _contact(trace, pair)
    return RunSeries(tuple(signals), tuple(_ribbon(trace, pair) for pair in trace.pairs))


def thinned(values: Floats, points: int = POINTS) -> NDArray[np.intp]:
    """Return which of (n,) values stand for all: of each stretch the least and the largest.

    The first and the last value are always among them; values that are no numbers are not.
    """
    if len(values) <= points:
        return np.flatnonzero(np.isfinite(values))
    edges = np.linspace(0, len(values), points // 2, dtype=np.intp)
    kept = {0, len(values) - 1}
    for start, stop in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        stretch = values[start:stop]
        if np.isfinite(stretch).any():
            kept |= {start + int(np.nanargmin(stretch)), start + int(np.nanargmax(stretch))}
    places = np.array(sorted(kept), dtype=np.intp)
    return places[np.isfinite(values[places])]


def _signal(name: str, unit: str, panel: str, time: Floats, values: Floats) -> Signal:
    places = thinned(values)
    return Signal(name, unit, panel, time[places], values[places])


def _motion(trace: StoredTrace) -> Iterator[Signal]:
    known = coordinates(trace.model_xml, trace.qpos.shape[1])
    for each in _telling(known, trace.qpos):
        yield _signal(each.name, each.unit, "motion", trace.time, trace.qpos[:, each.place])


def _telling(known: tuple[Coordinate, ...], qpos: Floats) -> list[Coordinate]:
    """Return heights first, then what moves most; of many coordinates the first few of these."""
    with np.errstate(invalid="ignore"):
        spread = np.nan_to_num(np.nanmax(qpos, axis=0) - np.nanmin(qpos, axis=0))
    ranked = sorted(known, key=lambda each: (not each.is_height, -spread[each.place]))
    return ranked[:MOST_COORDINATES]


def _contact(trace: StoredTrace, pair: StoredPair) -> Iterator[Signal]:
    """Yield forces, 0 where nothing touches, and depth."""
    for name, unit, panel, values in (
        ("normal", "N", "force", pair.normal),
        ("tangential", "N", "force", pair.tangential),
        ("depth", "m", "depth", np.maximum(-pair.distance, 0.0)),
    ):
        full = np.zeros(len(trace.contacts))
        full[pair.steps] = values
        yield _signal(f"{pair.name} {name}", unit, panel, trace.time[:-1], full)


def _ribbon(trace: StoredTrace, pair: StoredPair) -> Ribbon:
    modes = np.full(len(trace.contacts), NO_CONTACT, dtype=np.int8)
    modes[pair.steps] = pair.mode
    changes = np.flatnonzero(np.diff(modes)) + 1
    starts = np.concatenate(([0], changes))[:POINTS]
    return Ribbon(pair.name, trace.time[starts], modes[starts], float(trace.time[-1]))
