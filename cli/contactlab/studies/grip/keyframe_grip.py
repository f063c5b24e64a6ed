"""Finds the object that is held in a keyframe, the bodies that press on it, and their frame."""

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from contactlab.errors import SceneError
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.scene.keyframes import place_mocap, start_data
from contactlab.scene.model_names import require_id
from contactlab.scene.task import keyframe_names
from contactlab.studies.grip.closing import Squeeze, measure_squeeze, squeeze_frame
from contactlab.studies.grip.fingers import list_subtree, loose_bodies
from contactlab.studies.grip.grip_fixture import GripFixture, colliding_bounds
from contactlab.studies.grip.rollouts import (
    data_at,
    find_contacts,
    repeat_input,
    roll_out,
    state_row,
)


def find_held_object(
    model: mujoco.MjModel, keyframe: str, body: str | None = None, base: str | None = None
) -> tuple[GripFixture, Squeeze]:
    """Return the object held in a keyframe, after contacts have taken up the squeeze.

    This takes a quarter of a second. Free objects are weightless meanwhile; the model is unchanged.

    Raises:
        SceneError: there is no such keyframe or body, or nothing presses on it from two sides.
    """
    SceneError.unless_known(
        keyframe, keyframe_names(model), f"the model has no keyframe '{keyframe}'"
    )
    place_mocap(model, keyframe)
    row = state_row(model, start_data(model, keyframe))
    control = model.key_ctrl[model.key(keyframe).id].copy()
    settle_seconds = 0.25  # s for contacts to take up their load
    steps = max(1, round(settle_seconds / model.opt.timestep))
    # Free objects are weightless: forces cancel their weight.
    forces = np.zeros((model.nbody, 6))
    loose = [body for root in loose_bodies(model) for body in list_subtree(model, root)]
    weights = model.body_mass[loose] * (1 - model.body_gravcomp[loose])
    forces[loose, :3] = -weights[:, None] * model.opt.gravity
    weightless = repeat_input(forces, 1, steps)
    settled = roll_out(model, row[None], repeat_input(control, 1, steps), weightless)
    if settled.failed[0]:
        raise SceneError(f"MuJoCo gives up within {settle_seconds} s of keyframe '{keyframe}'")
    data = data_at(model, settled.rows[0])
    # The object is the free body with the largest contact force by bodies except the world and
    # other objects: bodies in a row press on each other, and none of them holds another.
    objects = _find_objects(model)
    bodies = [require_id(model, "body", body)] if body else sorted(loose_bodies(model))
    pressing = dict[int, float]()
    for candidate in bodies:
        if not model.body_jntnum[candidate] or model.jnt_type[model.body_jntadr[candidate]] != 0:
            raise SceneError(f"--object {body}: body {body} is not free; name one with a freejoint")
        contacts = find_contacts(model, data, candidate)
        pressing_on = [
            contact.force
            for contact in contacts
            if model.body_weldid[model.geom_bodyid[contact.geom]] != 0
            and int(model.geom_bodyid[contact.geom]) not in objects
        ]
        pressing[candidate] = sum(pressing_on)
    number = max(pressing, key=lambda each: pressing[each], default=-1)
    if number < 0 or pressing[number] <= 0:
        raise SceneError(
            f"keyframe '{keyframe}' holds no free body; name one in which fingers press on an "
            "object, or remove --keyframe"
        )
    body_contacts = find_contacts(model, data, number)
    # The bodies that press are fingers, carried by their nearest common base.
    touching = {int(model.geom_bodyid[contact.geom]) for contact in body_contacts}
    touching = sorted(touching - objects - {0})
    carrier = require_id(model, "body", base) if base else _shared_base(model, touching)
    fingers = [
        tuple(list_subtree(model, root))
        for root in range(1, model.nbody)
        if root != number
        and _carried_by(model, root, carrier)
        and set(list_subtree(model, root)) & set(touching)
    ]
    half, middle = colliding_bounds(model, number)
    fixture = GripFixture(
        model=model,
        base=carrier,
        body=number,
        fingers=tuple(fingers),
        address=int(model.jnt_qposadr[model.body_jntadr[number]]),
        half=half,
        middle=middle,
    )
    # The frame points across the fingers, sideways, and up.
    normals = np.array([contact.normal * np.sqrt(contact.force) for contact in body_contacts])
    across = np.linalg.svd(normals)[2][0]
    up = -model.opt.gravity.copy()
    if not up.any():
        up = data.xpos[fixture.body] - data.xpos[fixture.base]
    up -= across * (up @ across)
    if np.linalg.norm(up) < COARSE_ROUNDING * (1 + np.linalg.norm(model.opt.gravity)):
        up[:] = np.cross(across, np.eye(3)[int(np.argmin(np.abs(across)))])
    turn = squeeze_frame(across, up)
    squeeze = measure_squeeze(fixture, settled.rows[0], control, turn, settled.qpos[0])
    adhesion = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_BODY)
    own = np.isin(model.actuator_trnid[:, 0], [number, *touching])
    squeeze = replace(squeeze, sucks=bool((adhesion & own & (control > 0)).any()))
    if not squeeze.is_held:
        raise SceneError(
            f"keyframe '{keyframe}' presses on {model.body(number).name} from one side only; "
            "name a keyframe in which fingers hold it"
        )
    return fixture, squeeze


def _find_objects(model: mujoco.MjModel) -> set[int]:
    # Free bodies without joints of their own, which cannot close.
    trees = [list_subtree(model, root) for root in loose_bodies(model)]
    return {body for tree in trees if model.body_jntnum[tree].sum() == 1 for body in tree}


def _shared_base(model: mujoco.MjModel, bodies: Sequence[int]) -> int:
    """Return the nearest body that carries all of the given bodies."""
    ways = list[list[int]]()
    for body in bodies:
        way = [body]
        while way[-1]:
            way.append(int(model.body_parentid[way[-1]]))
        ways.append(way)
    shared = set(ways[0]).intersection(*ways[1:])
    return max(shared)


def _carried_by(model: mujoco.MjModel, body: int, base: int) -> bool:
    """Return whether a single joint is between a body and its base."""
    if body == base or not model.body_jntnum[body]:
        return False
    above = int(model.body_parentid[body])
    return int(model.body_weldid[above]) == int(model.body_weldid[base])
