"""The contact or joint where forces of two models differ most, both begun in one state."""

from collections import defaultdict
from itertools import pairwise
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.budget.motion import INTEGRATION
from contactlab.budget.windows import body_name, gyration_radii, joint_name
from contactlab.contact.trace_arrays import Floats

_CONTACTS = tuple(
    int(getattr(mujoco.mjtConstraint, f"mjCNSTR_CONTACT_{kind}"))
    for kind in ("FRICTIONLESS", "PYRAMIDAL", "ELLIPTIC")
)
_DOF = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
_JOINT = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)
_EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)


class Stretch(NamedTuple):
    """A window that two models go through: its first state, and inputs of its steps, if any."""

    state: Floats  # (nstate,) of mjSTATE_INTEGRATION
    inputs: Floats | None  # (n, width)
    spec: int
    steps: int  # n, of the run


Impulses = dict[str, Floats]
"""(n, nv) generalized impulses since the start, after each step of the run, by their source."""


def find_force_place(
    stretch: Stretch, model: mujoco.MjModel, impulses: tuple[Impulses, Impulses], body: int
) -> str:
    """Find the contact, joint, tendon or equality with the largest difference of impulse.

    Impulses are compared by their effect on that body: J M^-1 of their sums since the window began,
    at its first state, as velocity and spin times radius of gyration. So forces, torques and
    tendons have one unit. `model` is that of the first impulses.
    """
    one, other = impulses
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, stretch.state, INTEGRATION)
    mujoco.mj_forward(model, data)
    jacobian = np.zeros((6, model.nv))
    mujoco.mj_jacBodyCom(model, data, jacobian[:3], jacobian[3:], body)
    jacobian[3:] *= gyration_radii(model)[body]
    moved = np.zeros((6, model.nv))
    mujoco.mj_solveM(model, data, moved, jacobian)
    if not one.keys() | other.keys():
        return ""
    nothing = np.zeros((stretch.steps, model.nv))
    with np.errstate(invalid="ignore", over="ignore"):
        sizes = {
            name: np.linalg.norm(
                (one.get(name, nothing) - other.get(name, nothing)) @ moved.T, axis=1
            )
            for name in sorted(one.keys() | other.keys())
        }
    # A motion that diverges counts until its first number that is not finite.
    whole = [
        all(np.isfinite(size[step]) for size in sizes.values()) for step in range(stretch.steps)
    ]
    until = stretch.steps if all(whole) else max(1, whole.index(False))
    largest = {name: float(np.nan_to_num(size[:until]).max()) for name, size in sizes.items()}
    name = max(largest, key=lambda key: largest[key], default="")
    return name if largest.get(name, 0) > 0 else ""


def sum_impulses(stretch: Stretch, model: mujoco.MjModel, timestep: float) -> Impulses:
    """Return the impulses of a model in a stretch; `timestep` is the run's."""
    data, rate = mujoco.MjData(model), max(1, round(timestep / model.opt.timestep))
    mujoco.mj_setState(model, data, stretch.state, INTEGRATION)
    sums: dict[str, Floats] = defaultdict(lambda: np.zeros(model.nv))
    impulses: dict[str, Floats] = defaultdict(lambda: np.zeros((stretch.steps, model.nv)))
    joints = [
        (joint_name(model, joint), slice(begin, end))
        for joint, (begin, end) in enumerate(pairwise([*model.jnt_dofadr.tolist(), model.nv]))
    ]
    for step in range(stretch.steps):
        for _ in range(rate):
            if stretch.inputs is not None:
                mujoco.mj_setState(model, data, stretch.inputs[step], stretch.spec)
            mujoco.mj_step(model, data)
            # A joint has the forces of its limit, servo and spring.
            pushing = np.flatnonzero(data.efc_force)
            kinds, sources = data.efc_type[pushing].tolist(), data.efc_id[pushing].tolist()
            rows_of_source: dict[str, list[int]] = defaultdict(list)
            for row, kind, source in zip(pushing.tolist(), kinds, sources, strict=True):
                rows_of_source[_name_source(model, data, kind, source)].append(row)
            for name, rows in rows_of_source.items():
                loaded, general = np.zeros(data.nefc), np.zeros(model.nv)
                loaded[rows] = data.efc_force[rows]
                mujoco.mj_mulJacTVec(model, data, general, loaded)
                sums[name] += general * model.opt.timestep
            mine = data.qfrc_actuator + data.qfrc_passive
            for name, dofs in joints:
                if mine[dofs].any():
                    alone = np.zeros(model.nv)
                    alone[dofs] = mine[dofs]
                    sums[name] += alone * model.opt.timestep
        for name, total in sums.items():
            impulses[name][step] = total
    return dict(impulses)


def _name_source(model: mujoco.MjModel, data: mujoco.MjData, kind: int, source: int) -> str:
    if kind in _CONTACTS:
        return contact_name(model, data.contact.geom[source])
    if kind == _DOF:
        return joint_name(model, int(model.dof_jntid[source]))
    if kind == _JOINT:
        return joint_name(model, source)
    if kind == _EQUALITY:
        return f"equality {model.equality(source).name or f'[{source}]'}"
    return f"tendon {model.tendon(source).name or f'[{source}]'}"


def contact_name(model: mujoco.MjModel, geoms: np.ndarray) -> str:
    """Return how a contact is spoken of: its bodies, in the order of their numbers."""
    bodies = sorted(int(model.geom_bodyid[geom]) if geom >= 0 else -1 for geom in geoms)
    names = [body_name(model, body) if body >= 0 else "flex" for body in bodies]
    return f"contact {names[0]} - {names[1]}"
