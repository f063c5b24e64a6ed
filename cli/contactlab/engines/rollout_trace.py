"""Converts an engine's recording into a Trace, and computes its hash."""

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from contactlab.contact.trace_arrays import (
    SLOT_WIDTH,
    EngineOutputs,
    Floats,
    HeldPose,
    PairTrace,
    Trace,
    hash_of_states,
)
from contactlab.engines.engine import Rollout
from contactlab.scene.compiled_scene import CompiledScene, PreparedModel


def make_trace(base: CompiledScene, models: Sequence[PreparedModel], rollout: Rollout) -> Trace:
    """Return the trace of n runs, views of the rollout where NumPy allows.

    Rows of runs that stopped early are not valid beyond `rollout.steps`; cut them with `pick`.
    """
    model, layout, sensors = base.model, base.layout, rollout.sensors
    if rollout.slots is not None:
        layout = layout.from_contacts()
    velocity = 1 + model.nq
    # MuJoCo returns the largest possible number of islands; there is at most one per tree.
    iterations = rollout.iterations[:, :, : max(1, model.ntree)]
    mass = np.array([compiled.model.body_subtreemass[0] for compiled in models])
    friction = np.stack([compiled.friction for compiled in models])
    pairs = list[PairTrace]()
    for index, (pair, address) in enumerate(zip(base.pairs, base.layout.pairs, strict=True)):
        if rollout.slots is None:
            block = sensors[:, :, address : address + pair.slots * SLOT_WIDTH]
            slots = block.reshape(*block.shape[:2], pair.slots, SLOT_WIDTH)
        else:
            slots = rollout.slots[index]
        pairs.append(PairTrace(pair.name, slots, friction[:, index]))
    held_pose = None
    if layout.held is not None:
        pose = sensors[:, :, layout.held : layout.held + 7]
        held_pose = HeldPose(pose[:, :, :3], pose[:, :, 3:])
    return Trace(
        timestep=np.array([compiled.model.opt.timestep for compiled in models]),
        steps_asked=sensors.shape[1],
        time=rollout.state[:, :, 0],
        qpos=rollout.state[:, :, 1:velocity],
        qvel=rollout.state[:, :, velocity : velocity + model.nv],
        kinetic=_sensor_values(sensors, layout.kinetic),
        potential=_sensor_values(sensors, layout.potential),
        contacts=sensors[:, :, layout.contacts].astype(np.int32),
        least_distance=sensors[:, :, layout.contacts + 1],
        iterations=iterations.sum(axis=2, dtype=np.int32),
        iterations_most=iterations.max(axis=2),
        momentum=_sensor_vectors(sensors, layout.momentum, mass[:, None, None]),
        angular_momentum=_sensor_vectors(sensors, layout.angular_momentum, np.ones((1, 1, 1))),
        pairs=tuple(pairs),
        warnings=rollout.warnings,
        held_pose=held_pose,
        forces=sensors[:, :, layout.forces : layout.forces + model.nu],
        lengths=sensors[:, :, layout.lengths : layout.lengths + model.ntendon],
        **{field.name: getattr(rollout, field.name) for field in fields(EngineOutputs)},
    )


def trajectory_hash(rollout: Rollout, run: int) -> str:
    """Return the hash of a run's valid state rows."""
    return hash_of_states(rollout.state[run, : rollout.steps[run] + 1])


def _sensor_values(sensors: Floats, address: int | None) -> Floats:
    """Return a sensor's values, NaN if the sensor does not exist."""
    return np.full(sensors.shape[:2], np.nan) if address is None else sensors[:, :, address]


def _sensor_vectors(sensors: Floats, address: int | None, factor: Floats) -> Floats | None:
    return None if address is None else sensors[:, :, address : address + 3] * factor
