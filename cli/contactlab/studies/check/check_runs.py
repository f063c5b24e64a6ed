"""Runs of a model under check: their evidence, and the pairs that they hold."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import SLIDE, Floats
from contactlab.contact.trace_setup import HoldWindow
from contactlab.engines import engine_of
from contactlab.engines.engine import Buffers, PreparedRuns
from contactlab.engines.rollout_trace import make_trace
from contactlab.measure import METRICS, context_of
from contactlab.measure.context import hold_window
from contactlab.scene.contact_pairs import MonitoredPair
from contactlab.scene.run_setup import make_setup
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.scene.task import rest_time
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store
from contactlab.store.mcap.trace_reader import StoredTrace


@dataclass(frozen=True)
class CheckRun:
    """A run of the model, or of another scene with its parameters, and its evidence."""

    scene: Scene
    resolved: RunSpec
    store: Store

    @cached_property
    def record(self) -> EvidenceRecord:
        """Its record."""
        return self.store.record(self.scene.run_id(self.resolved))

    @cached_property
    def trace(self) -> StoredTrace:
        """Its trace."""
        return self.store.trace(self.record)

    @cached_property
    def model(self) -> mujoco.MjModel:
        """Its model with the settings written."""
        return self.scene.base(self.resolved.structure).prepare(self.resolved.edits()).model

    @property
    def is_complete(self) -> bool:
        """Whether it was simulated to its end, without an engine warning."""
        return self.record.status == "ok" and not self.record.warnings


_BEARS = 0.5
"""Fraction of steps with force from which a pair counts as held; chattering pairs lose it."""

_SLIDES = 0.9  # fraction of these steps with sliding from which a pair just slides
_AT_REST = 0.05
"""Speed of a pair's surfaces against each other [m/s], of the mean motion, up to which neither
falls: a body that falls has it after 5 ms."""

_WINDOW = 0.5
_HELD = ("hold_switches", "hold_penetration", "hold_slip")


@dataclass(frozen=True)
class HeldPair:
    """One pair in a time window."""

    name: str
    share: float  # fraction of steps in which it carries force
    sliding: float  # fraction of these in which it slides
    speed: float  # bound on that of its surfaces against each other, of their mean motion [m/s]
    force: float  # mean net normal force over the window [N]
    switches: float  # changes between stick and slide, and losses of contact while sticking [1/s]
    depth: float  # mean penetration [m]
    slip: float  # largest slip from its place at the start of the window [m]

    @property
    def holds(self) -> bool:
        """Whether it carries force, and neither just slides nor belongs to what falls."""
        return self.share >= _BEARS and self.sliding < _SLIDES and self.speed <= _AT_REST


@dataclass(frozen=True)
class Holding:
    """Bodies that a run of the model holds in a time window."""

    window: tuple[float, float]  # its start and end [s]
    declared: bool  # whether the scene declares that something is held then
    bearing: tuple[HeldPair, ...]  # the pairs that carry force in it

    @property
    def held(self) -> tuple[HeldPair, ...]:
        """The pairs that are held or stand: all that carry force in a declared hold."""
        return tuple(pair for pair in self.bearing if self.declared or pair.holds)

    @property
    def nothing(self) -> str:
        """In words, that nothing is held and that nothing stands."""
        start, stop = self.window
        span = f"from {start:g} to {stop:g} s"
        loose = [pair.name for pair in self.bearing]
        if not loose:
            return f"no monitored pair carries force {span}: nothing is held, and nothing stands"
        return (
            f"{span} {', '.join(loose[:3])} carry force, but intermittently, while sliding or "
            "while falling: nothing is held; a scene that holds something declares it under `hold`"
        )


def holding_of(tried: CheckRun) -> Holding:
    """Return what a run of the model holds: nothing if it is not complete."""
    hold, end = tried.scene.base(tried.resolved.structure).holding, tried.record.duration
    declared = None if hold is None else hold.window(tried.resolved.initial)
    # What stands does so while controls rest.
    rests = rest_time(end) if tried.resolved.drive == "exercise" else end
    window = declared or (max(0.0, rests - _WINDOW), rests)
    pairs = held_pairs(tried, *window) if tried.is_complete else ()
    return Holding(window, declared is not None, tuple(pair for pair in pairs if pair.share > 0))


def held_pairs(tried: CheckRun, start: float, stop: float) -> Iterator[HeldPair]:
    """Yield every monitored pair between two times [s] of a run of the model, simulated again."""
    resolved = tried.resolved
    runs = PreparedRuns.of(tried.scene, resolved).repeating([tried.store.controls(tried.record)])
    base, model = runs.base, runs.models[0]
    trace = make_trace(base, runs.prepared, engine_of(resolved).roll_out(runs, Buffers()))
    hold = HoldWindow(np.array([start]), np.array([stop]))
    setup = replace(make_setup(base, None, [resolved], runs.models, {}), hold=hold)
    (inside,) = hold_window(context_of(trace, setup))
    states = (series[0, :-1][inside] for series in (trace.qpos, trace.qvel))
    speeds = pair_speeds(model, base.pairs, *states, mean=True).tolist()
    for pair, speed in zip(trace.pairs, speeds, strict=True):
        context = context_of(replace(trace, pairs=(pair,)), setup)
        normal, mode = (getattr(context.series[0], name)[0, inside] for name in ("normal", "mode"))
        bearing = normal > 0
        with np.errstate(all="ignore"):
            switches, depth, slip = (float(METRICS[name].of(context)[0]) for name in _HELD)
        yield HeldPair(
            name=pair.name,
            share=float(bearing.mean()),
            sliding=float((mode == SLIDE)[bearing].mean()) if bearing.any() else 0.0,
            speed=speed,
            force=float(normal.mean()),
            switches=switches,
            depth=depth,
            slip=slip,
        )


_MOST_STATES_READ = 5000


def pair_speeds(
    model: mujoco.MjModel,
    pairs: Sequence[MonitoredPair],
    qpos: Floats,
    qvel: Floats,
    *,
    mean: bool = False,
    step: float = 1e9,
) -> Floats:
    """Return (P,) a bound on how fast the geoms of each pair move against each other [m/s].

    The relative speed of their centres, and for the rotation of each its angular speed times how
    far off its centre a ball of its least half extent can lie: a sphere that spins goes nowhere.
    Of configurations (N, nq) and velocities (N, nv), at most 5000 count, evenly spaced, and those
    whose bounding spheres can meet within a step [s]. It is the largest, or that of the mean
    velocities, by which what only shakes is at rest.
    """
    geoms = sorted({geom for pair in pairs for side in pair.geoms for geom in side})
    places = {geom: place for place, geom in enumerate(geoms)}
    stride = max(1, -(-len(qpos) // _MOST_STATES_READ))
    centres, velocities = _motion(model, geoms, qpos[::stride], qvel[::stride])
    if mean:
        centres, velocities = (
            vectors.mean(axis=0, keepdims=True) for vectors in (centres, velocities)
        )
    planes = np.asarray(model.geom_type)[geoms] == int(mujoco.mjtGeom.mjGEOM_PLANE)
    bounds = np.where(planes, np.inf, np.asarray(model.geom_rbound)[geoms])
    turning = np.linalg.norm(velocities[..., :3], axis=2) * [_reach(model, geom) for geom in geoms]
    speeds = np.zeros(len(pairs))
    for index, pair in enumerate(pairs):
        first, second = ([places[geom] for geom in side] for side in pair.geoms)
        apart = velocities[:, first, None, 3:] - velocities[:, None, second, 3:]
        moving = np.linalg.norm(apart, axis=3)
        speed = moving + turning[:, first, None] + turning[:, None, second]
        gap = np.linalg.norm(centres[:, first, None] - centres[:, None, second], axis=3)
        near = gap - bounds[first][:, None] - bounds[second] <= speed * step
        speeds[index] = (speed * near).max()
    return speeds


def _motion(
    model: mujoco.MjModel, geoms: Sequence[int], qpos: Floats, qvel: Floats
) -> tuple[Floats, Floats]:
    """Return (N, G, 3) centres of geoms, and (N, G, 6) angular and linear velocities, all world."""
    data = mujoco.MjData(model)
    centres, velocities = np.zeros((len(qpos), len(geoms), 3)), np.zeros((len(qpos), len(geoms), 6))
    for place, row, position, velocity in zip(centres, velocities, qpos, qvel, strict=True):
        data.qpos[:], data.qvel[:] = position, velocity
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        place[:] = data.geom_xpos[list(geoms)]
        for out, geom in zip(row, geoms, strict=True):
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_GEOM, geom, out, 0)
    return centres, velocities


def _reach(model: mujoco.MjModel, geom: int) -> float:
    """Return how far off a geom's centre a ball in it can lie [m]; 0 for a plane."""
    return max(float(model.geom_rbound[geom]) - float(model.geom_aabb[geom, 3:].min()), 0.0)
