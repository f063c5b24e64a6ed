"""What each graded pair did in a part of a stored run."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from contactlab.contact import SLIDE, SLOT_WIDTH, Floats, HoldWindow, PairTrace, Setup, Trace
from contactlab.measure import assess
from contactlab.scene import MonitoredPair, make_setup
from contactlab.store.mcap import StoredTrace
from contactlab.studies.check.bench import Tried
from contactlab.studies.check.target import Target

_HELD = 0.5
"""Share of the steps in which a pair must bear force to be held; chattering ones lose it."""

_SLIDES = 0.9
"""Share of the steps from which a pair simply slides."""


@dataclass(frozen=True)
class Held:
    """One pair in a window.

    Attributes:
        name: the pair's name.
        share: share of the steps in which it bears force.
        sliding: share of these in which it slides.
        force: its mean net normal force over the window [N].
        switches: changes between stick and slide, and of contact while it sticks [1/s].
        depth: mean depth [m].
        slip: farthest that it slips from where it was at the start of the window [m].
    """

    name: str
    share: float
    sliding: float
    force: float
    switches: float
    depth: float
    slip: float

    @property
    def holds(self) -> bool:
        """Whether it carries force, and does not simply slide."""
        return self.share >= _HELD and self.sliding < _SLIDES


def held_pairs(target: Target, tried: Tried, start: float, stop: float) -> list[Held]:
    """Return what each graded pair did between two times [s] of a run of the model."""
    scene = target.scene
    resolved = scene.resolve(tried.values, 0, tried.record.duration)
    base = scene.base(resolved.structure)
    model = base.prepare(resolved.edits()).model
    setup = make_setup(base, None, [resolved], [model], {})
    steps = slice(*(round(time / resolved.timestep) for time in (start, stop)))
    return list(_held(base.pairs, tried, steps, setup))


def _held(
    pairs: tuple[MonitoredPair, ...], tried: Tried, steps: slice, setup: Setup
) -> Iterator[Held]:
    trace = tried.trace
    seconds = (steps.stop - steps.start) * np.diff(trace.time[:2])
    whole = HoldWindow(np.zeros(1), seconds)
    for index, pair in enumerate(pairs):
        friction = tried.record.pairs[pair.name].friction
        slots = PairTrace(pair.name, slots_of(trace, pair, steps), np.array([friction]))
        alone = replace(
            setup,
            thickness=setup.thickness[[index]],
            slots=setup.slots[[index]],
            barriers=(),
            hold=whole,
        )
        found = assess(part_of(trace, steps, (slots,)), alone)
        series, metrics = found.series[0], found.metrics
        bearing = series.normal[0] > 0
        yield Held(
            name=pair.name,
            share=float(bearing.mean()),
            sliding=float((series.mode[0] == SLIDE)[bearing].mean()) if bearing.any() else 0.0,
            force=float(series.normal[0].mean()),
            switches=float(metrics["hold_switches"][0]),
            depth=float(metrics["penetration_mean"][0]),
            slip=float(metrics["hold_slip"][0]),
        )


def slots_of(trace: StoredTrace, pair: MonitoredPair, steps: slice) -> Floats:
    """Put the contact points of a pair back into the slots (1, N, S, 23) of some steps."""
    stored = next(each for each in trace.pairs if each.name == pair.name)
    slots = np.zeros((1, steps.stop - steps.start, pair.slots, SLOT_WIDTH))
    first = np.cumsum(stored.contacts) - stored.contacts
    place = np.arange(len(stored.points)) - np.repeat(first, stored.contacts)
    step = stored.point_steps
    inside = (step >= steps.start) & (step < steps.stop)
    slots[0, step[inside] - steps.start, place[inside]] = stored.points[inside]
    return slots


def part_of(trace: StoredTrace, steps: slice, pairs: tuple[PairTrace, ...]) -> Trace:
    """Return some steps of a stored run as a trace of one run, without its momenta."""
    states = slice(steps.start, steps.stop + 1)
    return Trace(
        timestep=np.diff(trace.time[:2]),
        steps_asked=steps.stop - steps.start,
        time=trace.time[None, states],
        qpos=trace.qpos[None, states],
        qvel=trace.qvel[None, states],
        kinetic=trace.kinetic[None, steps],
        potential=trace.potential[None, steps],
        contacts=trace.contacts[None, steps],
        least_distance=trace.least_distance[None, steps],
        iterations=trace.iterations[None, steps],
        iterations_most=trace.iterations_most[None, steps],
        momentum=None,
        angular_momentum=None,
        pairs=pairs,
        warnings=({},),
    )
