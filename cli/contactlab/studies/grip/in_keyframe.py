"""What a keyframe holds: the object, the bodies that press on it, and their frame."""

from collections.abc import Sequence

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError
from contactlab.scene.keyframes import place_mocap, start_data
from contactlab.scene.model_names import known_id
from contactlab.scene.task import keyframe_names
from contactlab.studies.grip.bench import Rig, bounds
from contactlab.studies.grip.closing import Squeeze, frame, pressing
from contactlab.studies.grip.fingers import loose_bodies, subtree
from contactlab.studies.grip.rollouts import (
    BodyContact,
    constant,
    contacts_of,
    placed,
    roll,
    row_of,
)

_SETTLE = 0.25  # s, in which contacts take up what they bear


def held_in(
    model: mujoco.MjModel, keyframe: str, body: str | None = None, base: str | None = None
) -> tuple[Rig, Squeeze]:
    """Return what a keyframe holds, once contacts have taken up what squeezes it.

    That is a quarter of a second, in which free objects have no weight; the model stays as it is.

    Raises:
        SceneError: there is no such keyframe or body, or nothing presses on it from two sides.
    """
    SceneError.unless_known(
        keyframe, keyframe_names(model), f"the model has no keyframe '{keyframe}'"
    )
    place_mocap(model, keyframe)
    row = row_of(model, start_data(model, keyframe))
    control = model.key_ctrl[model.key(keyframe).id].copy()
    steps = max(1, round(_SETTLE / model.opt.timestep))
    weightless = constant(_lifted(model), 1, steps)
    settled = roll(model, row[None], constant(control, 1, steps), weightless)
    if settled.failed[0]:
        raise SceneError(f"MuJoCo gives up within {_SETTLE} s of keyframe '{keyframe}'")
    data = placed(model, settled.rows[0])
    number = _object(model, data, keyframe, body)
    found = contacts_of(model, data, number)
    rig = _rig(model, number, found, base)
    turn = _turn(model, data, rig, found)
    held = pressing(rig, settled.rows[0], control, turn, settled.qpos[0])
    if not held.is_held:
        raise SceneError(
            f"keyframe '{keyframe}' presses on {model.body(number).name} from one side alone; "
            "name a keyframe in which fingers hold it"
        )
    return rig, held


def _lifted(model: mujoco.MjModel) -> Floats:
    """Return (nbody, 6) forces that take the weight of free objects away [N]."""
    forces = np.zeros((model.nbody, 6))
    loose = [body for root in loose_bodies(model) for body in subtree(model, root)]
    weights = model.body_mass[loose] * (1 - model.body_gravcomp[loose])
    forces[loose, :3] = -weights[:, None] * model.opt.gravity
    return forces


def _object(model: mujoco.MjModel, data: mujoco.MjData, keyframe: str, name: str | None) -> int:
    """Return the free body that is pressed hardest by bodies that are not the world's."""
    bodies = [known_id(model, "body", name)] if name else sorted(loose_bodies(model))
    forces = dict[int, float]()
    for body in bodies:
        if not model.body_jntnum[body] or model.jnt_type[model.body_jntadr[body]] != 0:
            raise SceneError(f"--object {name}: body {name} is not free; name one with a freejoint")
        contacts = contacts_of(model, data, body)
        pressing_on = [
            contact.force
            for contact in contacts
            if model.body_weldid[model.geom_bodyid[contact.geom]] != 0
        ]
        forces[body] = sum(pressing_on)
    best = max(forces, key=lambda body: forces[body], default=-1)
    if best < 0 or forces[best] <= 0:
        raise SceneError(
            f"keyframe '{keyframe}' holds no free body; name one in which fingers press on an "
            "object, or leave --keyframe out"
        )
    return best


def _rig(model: mujoco.MjModel, body: int, found: Sequence[BodyContact], base: str | None) -> Rig:
    """Return a rig of the bodies that press, carried by the nearest body that carries them all."""
    touching = sorted({int(model.geom_bodyid[contact.geom]) for contact in found} - {0})
    number = known_id(model, "body", base) if base else _shared(model, touching)
    fingers = [
        tuple(subtree(model, root))
        for root in range(1, model.nbody)
        if root != body
        and _carried_by(model, root, number)
        and set(subtree(model, root)) & set(touching)
    ]
    half, middle = bounds(model, body)
    return Rig(
        model=model,
        base=number,
        body=body,
        fingers=tuple(fingers),
        address=int(model.jnt_qposadr[model.body_jntadr[body]]),
        half=half,
        middle=middle,
    )


def _shared(model: mujoco.MjModel, bodies: Sequence[int]) -> int:
    """Return the nearest body that carries all of some, without being one that a joint moves."""
    ways = list[list[int]]()
    for body in bodies:
        way = [body]
        while way[-1]:
            way.append(int(model.body_parentid[way[-1]]))
        ways.append(way)
    shared = set(ways[0]).intersection(*ways[1:])
    return max(shared)


def _carried_by(model: mujoco.MjModel, body: int, base: int) -> bool:
    """Return whether a joint is the only one between a body and its base."""
    if body == base or not model.body_jntnum[body]:
        return False
    above = int(model.body_parentid[body])
    return int(model.body_weldid[above]) == int(model.body_weldid[base])


def _turn(
    model: mujoco.MjModel, data: mujoco.MjData, rig: Rig, found: Sequence[BodyContact]
) -> Floats:
    """Return a turn as Squeeze has it: across the fingers, sideways, up."""
    normals = np.array([contact.normal * np.sqrt(contact.force) for contact in found])
    across = np.linalg.svd(normals)[2][0]
    up = -model.opt.gravity.copy()
    if not up.any():
        up = data.xpos[rig.body] - data.xpos[rig.base]
    up -= across * (up @ across)
    if np.linalg.norm(up) < 1e-6 * (1 + np.linalg.norm(model.opt.gravity)):
        up[:] = np.cross(across, np.eye(3)[int(np.argmin(np.abs(across)))])
    return frame(across, up)
