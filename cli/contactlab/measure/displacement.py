"""How far bodies move and turn, and labels of those that should have stayed where they were."""

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.contact.trace_setup import FreeBody
from contactlab.measure.context import Context, down, first_step, speed_squared, worst_body
from contactlab.measure.entries import Finding, Findings, MeasuredRuns, Threshold, label, metric


@metric(unit="m", better="lower", resolution=1e-12)
def drift(context: Context) -> Floats:
    """Distance across gravity between a free body's first and last position.

    The body that moved most counts. For bodies at rest it is creep, which grows with time and
    vanishes with impratio; for a stack that collapsed it is the fall.
    """
    below = down(context)
    return np.sqrt(worst_body(context, lambda body: _across(_displacement(context, body), below)))


@metric(unit="m", better="lower", resolution=1e-12)
def drop(context: Context) -> Floats:
    """Distance along gravity between a free body's first and last position.

    The body that sank most counts; negative where all rose.
    """
    below = down(context)
    return worst_body(context, lambda body: (_displacement(context, body) * below).sum(axis=1))


@metric(unit="m/s", better="lower", resolution=1e-12)
def rest_speed(context: Context) -> Floats:
    """Largest speed of a free body in the last fifth of the run.

    Bodies at rest still creep.
    """
    last = slice(context.last_fifth.start + 1, None)
    return np.sqrt(
        worst_body(context, lambda body: speed_squared(context, body)[:, last].max(axis=1))
    )


@metric(unit="any", resolution=1e-9)
def joint_travel(context: Context) -> Floats:
    """Speed summed over time of the degree of freedom that moves most, there and back.

    Free bodies do not count. In m for slides, in rad for hinges and ball joints.
    """
    free = {body.dof + place for body in context.setup.free_bodies for place in range(6)}
    jointed = [place for place in range(context.trace.qvel.shape[2]) if place not in free]
    if not jointed:
        return context.undefined()
    speeds = np.abs(context.trace.qvel[:, 1:][:, :, jointed])
    return speeds.sum(axis=1).max(axis=1) * context.trace.timestep


@metric(unit="any", resolution=1e-9)
def actuator_effort(context: Context) -> Floats:
    """Root mean square over time of the forces of all actuators together.

    In N and N m, as each actuator has it; it shows what the motion asks of them.
    """
    forces = context.trace.forces
    if forces is None or not forces.shape[2]:
        return context.undefined()
    return np.sqrt((forces * forces).sum(axis=2).mean(axis=1))


@metric(unit="rad", resolution=1e-9)
def turn(context: Context) -> Floats:
    """Angular speed summed over time of the free body that turns most."""

    def angle(body: FreeBody) -> Floats:
        rate = context.trace.qvel[:, 1:, body.dof + 3 : body.dof + 6]
        return np.sqrt((rate * rate).sum(axis=2)).sum(axis=1)

    return worst_body(context, angle) * context.trace.timestep


@label(
    name="drift",
    severity=44,
    thresholds=(
        Threshold(
            "drift", None, "m", "Largest metric drift; only scenes whose bodies should stay set it."
        ),
    ),
)
def drifting(runs: MeasuredRuns) -> Findings:
    """A body that should stay ended farther from its start than the scene accepts."""
    return {
        run: Finding(
            f"a body ended {moved:.3g} m away from its start (limit {limit:g} m)",
            _first_step_away(runs.context, run, limit),
        )
        for run, moved, limit in runs.over("drift")
    }


@label(
    severity=32,
    thresholds=(
        Threshold(
            "rest_speed",
            None,
            "m/s",
            "Largest metric rest_speed; only scenes whose bodies should come to rest set it.",
        ),
    ),
)
def unsettled(runs: MeasuredRuns) -> Findings:
    """A body still moves in the last fifth of the run, where the scene says that all rest."""
    return {
        run: Finding(
            f"a body moved at {speed:.3g} m/s in the last fifth (limit {limit:g} m/s)",
            _first_moving_step(runs.context, run, limit),
        )
        for run, speed, limit in runs.over("rest_speed")
    }


def _first_step_away(context: Context, run: int, limit: float) -> int:
    """Return the first step after which some free body is as far away as that."""
    below = down(context)[run]
    steps: list[int] = []
    for body in context.setup.free_bodies:
        place = context.trace.qpos[run, :, body.qpos : body.qpos + 3]
        steps.append(first_step(np.sqrt(_across(place - place[0], below)) > limit))
    return min(step - 1 for step in steps if step > 0)


def _first_moving_step(context: Context, run: int, limit: float) -> int:
    """Return the first step of the last fifth after which some free body is as fast as that."""
    start = context.last_fifth.start
    fast = [
        speed_squared(context, body)[run, start + 1 :] > limit**2
        for body in context.setup.free_bodies
    ]
    return start + min(first_step(each) for each in fast if each.any())


def _displacement(context: Context, body: FreeBody) -> Floats:
    """Return (n, 3) the displacement [m] of a free body from its first to its last position."""
    place = context.trace.qpos[:, :, body.qpos : body.qpos + 3]
    return place[:, -1] - place[:, 0]


def _across(vectors: Floats, below: Floats) -> Floats:
    """Return the squared length of vectors (..., 3) across a unit vector or zero (..., 3)."""
    across = vectors - (vectors * below).sum(axis=-1, keepdims=True) * below
    return (across * across).sum(axis=-1)
