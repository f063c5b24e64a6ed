"""How far a held object creeps on a contact, and for how long the contact would last.

A body slides at the limit of its friction only. Regularized friction lets it creep below.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import NORMAL, POSITION, Floats
from contactlab.rendering.amounts import format_amount
from contactlab.scene.contact_pairs import geom_ends
from contactlab.store.mcap.trace_reader import StoredPair, StoredTrace

Spans = list[tuple[int, int]]
Sides = tuple[tuple[int, ...], tuple[int, ...]]
"""The geoms of both sides of a pair."""


@dataclass(frozen=True)
class ContactHold:
    """A time span of a contact under load.

    Attributes:
        begin: time of its first step [s].
        seconds: its duration.
        creep: how far the contact creeps in its second half [m].
        remaining: distance to the end of the contact at the end, if it creeps on [m].
    """

    begin: float
    seconds: float
    creep: float
    remaining: float

    @property
    def times_left(self) -> float:
        """The time until the contact ends, over the time of the hold."""
        return self.seconds_left / self.seconds

    @property
    def seconds_left(self) -> float:
        """The time until the contact ends, if it creeps on as in the second half [s]."""
        return 0.5 * self.seconds * self.remaining / self.creep if self.creep else np.inf

    def describe_creep(self) -> str:
        """Say how far the contact creeps, and when it would be lost."""
        values = (self.creep, "m"), (0.5 * self.seconds, "s"), (self.seconds, "s")
        creep, half, whole, time_left = (
            format_amount(*each) for each in (*values, (self.seconds_left, "s"))
        )
        return f"creeps {creep} in {half}; held for {whole}, it would be lost {time_left} later"


@dataclass(frozen=True)
class CreepLimits:
    """The differences of creep from an impact, from sliding and from rest.

    Attributes:
        usage: largest part of the friction in use.
        speed: least slip [m/s].
        seconds: shortest stretch of creep, and longest gap within a hold.
        multiple: a hold is sound if the contact would last this many times as long again. Grips
            of scripted policies that keep their object would last 16 times and more; those that
            are just long enough less than once.
    """

    usage: float = 0.9
    speed: float = 1e-3
    seconds: float = 0.1
    multiple: float = 3.0


def find_holds(
    model: mujoco.MjModel,
    sides: Sides,
    pair: StoredPair,
    trace: StoredTrace,
    limits: CreepLimits = CreepLimits(),
) -> Iterator[ContactHold]:
    """Yield the holds of a pair that creep in their second half.

    The creep is at most the distance between places that touched each other in the middle of the
    hold, so that a grip may be shaken or turned.
    """
    steps, step = len(trace.time) - 1, float(trace.time[1] - trace.time[0])
    width = max(1, round(limits.seconds / step))
    below = (pair.usage < limits.usage) & (pair.normal > 0) & (pair.slip > limits.speed)
    creeps = np.zeros(steps, bool)
    for first, last in _find_spans(pair.spread_over_steps(steps, below, apart=False)):
        creeps[first:last] = last - first >= width
    slips = np.where(creeps, pair.spread_over_steps(steps, pair.slip), 0.0)
    loaded = pair.spread_over_steps(steps, pair.normal > 0, apart=False)
    for first, last in _join_spans(_find_spans(loaded), width):
        middle = (first + last) // 2
        slip = float(slips[middle:last].sum()) * step
        if slip and last - first >= width:
            place = int(np.searchsorted(pair.steps, middle))
            point = pair.points[int(pair.contacts[:place].sum())]
            way, remaining = _measure_slide(model, sides, point, trace.qpos[[middle, last]])
            yield ContactHold(
                begin=float(trace.time[first]),
                seconds=(last - first) * step,
                creep=min(slip, way),
                remaining=remaining,
            )


def _measure_slide(
    model: mujoco.MjModel, sides: Sides, point: Floats, states: Floats
) -> tuple[float, float]:
    # How far the places of a point on both sides part along the contact from one state to the next,
    # and how far they may go on until the sides no longer overlap.
    data, frames, origins = mujoco.MjData(model), list[Floats](), list[Floats]()
    bodies = [int(model.geom_bodyid[geoms[0]]) for geoms in sides]
    for qpos in states:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        frames.append(data.xmat[bodies].reshape(-1, 3, 3))
        origins.append(data.xpos[bodies])
    turns = frames[1] @ frames[0].transpose(0, 2, 1)
    moved = origins[1] + np.einsum("bij,bj->bi", turns, point[POSITION] - origins[0])
    normal = turns[0] @ point[NORMAL]
    slide = (moved[1] - moved[0]) - normal * float(normal @ (moved[1] - moved[0]))
    way = float(np.linalg.norm(slide))
    if not way:
        return 0.0, np.inf
    ahead = slide / way
    ends = geom_ends(model, data, ahead)
    front, back = (list(geoms) for geoms in sides)
    return way, float(ends[1, front].max() - ends[0, back].min())


def _find_spans(mask: np.ndarray) -> Spans:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]


def _join_spans(spans: Spans, gap: int) -> Spans:
    joined: Spans = []
    for first, last in spans:
        if joined and first - joined[-1][1] < gap:
            joined[-1] = joined[-1][0], last
        else:
            joined.append((first, last))
    return joined
