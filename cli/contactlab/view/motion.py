"""From a stored run to what is drawn of it: poses by kinematics, forces from the trace."""

from collections.abc import Sequence

import numpy as np

from contactlab.contact import BodyMotion
from contactlab.engines import body_names, moving_bodies, poses, shapes
from contactlab.errors import StoreError
from contactlab.scene import Prepared
from contactlab.store.mcap import StoredTrace
from contactlab.view.forces import frame_rows, peak_forces
from contactlab.view.stage import arrow_scale, stage


def make_motion(
    prepared: Prepared, trace: StoredTrace, rate: float, moments: Sequence[float] = ()
) -> BodyMotion:
    """Return what is drawn of a run, up to its first state that is not finite.

    The trace holds every configuration, so that nothing is simulated again.

    Args:
        prepared: the run's model.
        trace: its stored trace.
        rate: frames per simulated second.
        moments: times that get frames of their own [s].

    Raises:
        StoreError: not even the start state is finite.
    """
    model = prepared.model
    broken = np.flatnonzero(~np.isfinite(trace.qpos).all(axis=1))
    sound = int(broken[0]) if len(broken) else len(trace.qpos)
    if not sound:
        raise StoreError(f"run {trace.metadata['run_id']} has no finite state to draw")
    rows = frame_rows(trace.time[:sound], rate, moments)
    positions, rotations = poses(model, trace.qpos[rows])
    parts, moving = shapes(model), moving_bodies(model)
    forces = peak_forces(trace.pairs, rows)
    centre, radius = stage(parts, moving, positions, forces.position)
    scale, longest = arrow_scale(forces.force, radius)
    return BodyMotion(
        bodies=body_names(model),
        moving=moving,
        shapes=parts,
        rows=rows,
        time=trace.time[rows],
        positions=positions,
        rotations=rotations,
        pairs=tuple(pair.name for pair in trace.pairs),
        forces=forces,
        centre=centre,
        radius=radius,
        scale=scale,
        longest=longest,
    )
