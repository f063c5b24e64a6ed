"""Finds bodies that leave the place where a start puts them, although nothing drives them."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.rendering.amounts import format_amount
from contactlab.scene.model_names import name_of
from contactlab.schema.examination import Cause, Fact
from contactlab.schema.task import QPOS0
from contactlab.studies.examine.standing_starts import begin_motion, step_first_seed

_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_LANDING_SECONDS = 0.03  # a body falls by 4 mm until then, the rounding of a start by hand
_REST_PHASES = ("rest", "held")  # of a task, without pushes and sines


class _Support(NamedTuple):
    """The contact that carries most of a body at its start.

    Attributes:
        geom: of the static body below it.
        slope: of the contact against the horizontal, as a tangent.
        friction: sliding friction of the contact.
    """

    geom: int
    slope: float
    friction: float


def list_departures(motion: Motion, start: str, causes: Sequence[Cause]) -> Iterator[Fact]:
    """Yield the fact that a body does not stay on its support, such as a phone on a steep stand.

    The body floats alone, begins without velocity on static geoms that do not move like a belt, and
    moves farther than its own extent without a touch of another body that moves.
    """
    if motion.name not in _REST_PHASES or any(one.stage in ("file", "start") for one in causes):
        return
    model, data = motion.model, begin_motion(motion)
    before, bodies = data.xpos.copy(), [*_list_resting_bodies(model, data)]
    supports = dict[int, _Support]()
    for step in step_first_seed(motion, data) if bodies else ():
        is_new = step * model.opt.timestep < _LANDING_SECONDS
        for body in bodies if is_new else ():
            if body not in supports and (support := _find_support(model, data, body)):
                supports[body] = support
        if not is_new and not supports:
            break
        for body in _list_touched_bodies(model, data):
            supports.pop(body, None)
    for body, support in supports.items():
        way = float(np.linalg.norm(data.xpos[body] - before[body]))
        own = model.geom_bodyid == body
        extent = 2 * float(model.geom_rbound[own].max())
        if not extent < way < math.inf:
            continue
        name, place = name_of(model, "body", body), name_of(model, "geom", support.geom)
        seconds = motion.inputs.shape[1] * model.opt.timestep
        known = "the default pose" if start == QPOS0 else f"keyframe {start}"
        sentence = (
            f"{name} does not stay where {known} puts it: it moves {format_amount(way, 'mm')} "
            f"within {seconds:g} s, and nothing drives it"
        )
        if support.slope > support.friction:
            sentence += (
                f"; on {place}, at {math.degrees(math.atan(support.slope)):.3g} degrees, it stays "
                f"with friction above {support.slope:.2g}, not {support.friction:.2g}"
            )
        yield Fact(kind="fall", place=name, value=way, unit="m", sentence=sentence)


def _list_resting_bodies(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[int]:
    # Bodies of one free joint, without velocity. One that an equality or an actuator may move, or
    # that carries other bodies, is a part of a machine.
    if model.neq or np.any(model.actuator_trntype == mujoco.mjtTrn.mjTRN_BODY):
        return
    joints = np.bincount(model.body_rootid[model.jnt_bodyid], minlength=model.nbody)
    for joint in np.flatnonzero(model.jnt_type == _FREE).tolist():
        body, dof = int(model.jnt_bodyid[joint]), int(model.jnt_dofadr[joint])
        driven = np.any(model.actuator_trnid[:, 0] == joint) and bool(model.nu)
        if joints[body] == 1 and not driven and not data.qvel[dof : dof + 6].any():
            yield body


def _list_touched_bodies(model: mujoco.MjModel, data: mujoco.MjData) -> list[int]:
    # Roots of bodies that touch a body that moves.
    bodies = model.geom_bodyid[data.contact.geom]  # (ncon, 2)
    touch = (model.body_weldid[bodies] > 0).all(axis=1) & (data.contact.geom >= 0).all(axis=1)
    return np.unique(model.body_rootid[bodies[touch]]).tolist()


def _find_support(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> _Support | None:
    # None if a body that moves touches it, or nothing carries half of its weight.
    best, most, up = None, 0.0, -np.array(model.opt.gravity)
    weight = float(np.linalg.norm(up)) * float(model.body_subtreemass[body])
    up /= float(np.linalg.norm(up)) or 1.0
    belts = getattr(model, "geom_surfacevel", np.zeros((model.ngeom, 1)))
    force, carried = np.empty(6), 0.0
    for place in range(data.ncon):
        contact, geoms = data.contact[place], data.contact.geom[place].tolist()
        bodies = model.body_rootid[model.geom_bodyid[geoms]].tolist()
        if body not in bodies or contact.efc_address < 0:
            continue
        other = geoms[1 - bodies.index(body)]
        if min(geoms) < 0 or model.body_weldid[model.geom_bodyid[other]] or belts[other].any():
            return None
        mujoco.mj_contactForce(model, data, place, force)
        lift = abs(float(contact.frame[:3] @ up))
        carried += float(force[0]) * lift
        if force[0] > most and lift > 0:
            most = float(force[0])
            best = _Support(other, math.sqrt(1 - min(lift, 1) ** 2) / lift, contact.friction[0])
    half = 0.5  # of the weight; a body that only grazes a wall falls past it
    return best if carried > half * weight > 0 else None
