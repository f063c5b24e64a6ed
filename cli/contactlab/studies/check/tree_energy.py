"""The energy of each kinematic tree of a model."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats


@dataclass(frozen=True)
class Tree:
    """Bodies that move together, and no others with them.

    Attributes:
        name: of its root body.
        dofs: (nv,) whether each degree of freedom is its.
        bodies: (nbody,) whether each body is its.
        mass: of its bodies [kg].
        floats: whether gravity would move its root freely.
    """

    name: str
    dofs: NDArray[np.bool_]
    bodies: NDArray[np.bool_]
    mass: float
    floats: bool


def trees_of(model: mujoco.MjModel) -> list[Tree]:
    """Return the kinematic trees of a model; one if tendons with stiffness couple them."""
    dofs, bodies = np.array(model.dof_treeid), np.array(model.body_treeid)
    if model.ntree > 1 and model.tendon_stiffness.any():
        dofs, bodies = np.minimum(dofs, 0), np.minimum(bodies, 0)
    return [_tree(model, dofs == each, bodies == each) for each in sorted(set(dofs.tolist()))]


def _tree(model: mujoco.MjModel, dofs: NDArray[np.bool_], bodies: NDArray[np.bool_]) -> Tree:
    root = int(np.flatnonzero(bodies)[0])
    joints = np.flatnonzero(model.jnt_bodyid == root)
    return Tree(
        name=model.body(root).name,
        dofs=dofs,
        bodies=bodies,
        mass=float(model.body_mass[bodies].sum()),
        floats=any(_falls(model, joint) for joint in joints.tolist()),
    )


def _falls(model: mujoco.MjModel, joint: int) -> bool:
    """Say whether gravity moves a root along its joint: free, or a slide without a spring."""
    kind = int(model.jnt_type[joint])
    if kind != mujoco.mjtJoint.mjJNT_SLIDE:
        return kind == mujoco.mjtJoint.mjJNT_FREE
    along = np.array(model.jnt_axis[joint]) @ np.array(model.opt.gravity)
    steep = abs(along) > 0.1 * np.linalg.norm(model.opt.gravity)
    return bool(steep and not np.any(model.jnt_stiffness[joint]))


def tree_energies(
    model: mujoco.MjModel, trees: Sequence[Tree], qpos: Floats, qvel: Floats
) -> tuple[Floats, Floats]:
    """Return the kinetic and the potential energy of each tree [J], (T, N) each.

    The mass matrix does not couple trees, so that a tree's kinetic energy is v' M v / 2 of its own
    velocities. Its potential energy is that of a model where only its bodies have weight and only
    its joints have springs. Configurations are (N, nq), velocities (N, nv).
    """
    data = mujoco.MjData(model)
    alone = [_alone(model, tree) for tree in trees] if len(trees) > 1 else [model]
    kinetic, potential = np.zeros((2, len(trees), len(qpos)))
    product = np.zeros(model.nv)
    for row, (position, velocity) in enumerate(zip(qpos, qvel, strict=True)):
        data.qpos[:], data.qvel[:] = position, velocity
        mujoco.mj_fwdPosition(model, data)
        for place, (tree, own) in enumerate(zip(trees, alone, strict=True)):
            moving = velocity * tree.dofs
            mujoco.mj_mulM(model, data, product, moving)
            kinetic[place, row] = moving @ product / 2
            mujoco.mj_energyPos(own, data)
            potential[place, row] = data.energy[0]
    return kinetic, potential


def _alone(model: mujoco.MjModel, tree: Tree) -> mujoco.MjModel:
    own = copy.copy(model)
    own.body_mass[~tree.bodies] = 0
    own.jnt_stiffness[~tree.bodies[model.jnt_bodyid]] = 0
    return own
