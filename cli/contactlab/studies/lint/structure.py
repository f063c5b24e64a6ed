"""Structure rules: models with runs that say nothing of the robot that their author meant."""

from collections.abc import Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats
from contactlab.scene.floating_bases import find_driven_joints, list_unsupported_roots
from contactlab.studies.lint.linted_model import Fault, LintedModel
from contactlab.studies.lint.rules import rule

_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)
_SCALAR = (int(mujoco.mjtJoint.mjJNT_SLIDE), _HINGE)


@rule("no-actuators", "warn", voids_postures=True)
def find_missing_actuators(linted: LintedModel) -> Iterator[Fault]:
    """Joints have motors by their attributes or defaults, and no actuator drives any of them.

    The attributes are `actuatorfrcrange`, `actuatorgravcomp`, and the effort of a URDF; or a
    `<default>` has values of actuators. The robot hangs limp: its passive motion is judged, and no
    posture of a keyframe is held. Fix: an `<actuator>` for each joint, in an MJCF that attaches a
    URDF.
    """
    model = linted.model
    if model.nu or model.nplugin:
        return
    motors = model.jnt_actfrclimited.astype(bool) | model.jnt_actgravcomp.astype(bool)
    driven = np.flatnonzero(np.isin(model.jnt_type, _SCALAR) & motors)
    kinds = {"position", "velocity", "motor", "general", "intvelocity", "damper", "cylinder"}
    meant = next(
        (
            child
            for element, _ in linted.tags
            if element.tag == "default"
            for child in element
            if child.tag in kinds and child.attrib
        ),
        None,
    )
    if not model.njnt or (meant is None and not driven.size):
        return
    if meant is not None:
        motors_of = f"a <default> has values of <{meant.tag}>"
        place, remedy = linted.place_of("default"), "add an <actuator> for each joint"
    else:
        first = linted.name("joint", int(driven[0]))
        place = linted.place("joint", int(driven[0]))
        joints = f"{driven.size} joint{'s' if driven.size != 1 else ''}"
        motors_of = f"{joints} such as {first} have motors"
        remedy = (
            "a URDF cannot have one in MuJoCo: write an MJCF that attaches it, with an <actuator> "
            "for each"
            if linted.is_urdf
            else "add an <actuator> for each"
        )
    limp = "and nothing drives them, so the robot hangs limp"
    yield Fault(f"no actuators: {motors_of}, {limp}; {remedy}", place)


@rule("welded-root", "warn", voids_runs=True)
def find_welded_roots(linted: LintedModel) -> Iterator[Fault]:
    """The import welds the root of a URDF to the world, and the robot stands on limbs.

    Below the root end two limbs with wheels, two legs of three joints or more, or three limbs
    around its center of mass. Fix: a floating joint above the root; `--apply freejoint` if links
    overlap, too.
    """
    model = linted.model
    if not linted.is_urdf or (model.jnt_type == _FREE).any():
        return
    data = linted.reference
    lows, extent = _lowest_points(model, data), float(model.stat.extent)
    roots = np.flatnonzero((model.body_parentid == 0) & (np.arange(model.nbody) > 0))
    tree = np.array([_find_root(model, body, roots) for body in range(model.nbody)])
    limbs = [int(root) for root in roots if model.body_dofnum[root] and (tree == root).any()]
    bottom = {limb: lows[tree[model.geom_bodyid] == limb].min(initial=np.inf) for limb in limbs}
    level_share = 0.1  # of the robot's extent; feet of one stance lie within it
    lowest = min(bottom.values(), default=np.inf)
    base = lows[tree[model.geom_bodyid] < 0].min(initial=0.0)
    if not np.isfinite(lowest) or lowest > base - level_share * extent:
        return
    feet = [limb for limb in limbs if bottom[limb] <= lowest + level_share * extent]
    # Three limbs under the center of mass, two with wheels, or two legs of three joints each.
    # A gripper that points down has two fingers of fewer joints.
    joints = {foot: np.flatnonzero(tree[model.jnt_bodyid] == foot) for foot in feet}
    wheels = [foot for foot in feet if _ends_in_wheel(model, data, joints[foot])]
    legs = [foot for foot in feet if len(joints[foot]) > 2]
    if len(wheels) > 1 or len(legs) > 1 or _surround_center(model, data, feet, tree):
        name = linted.name("body", feet[0])
        yield Fault(
            f"the import welds the root of this URDF to the world: the robot hangs in the air on "
            f"its root, and its {len(feet)} limbs such as {name} end "
            f"{1e3 * (base - lowest):.3g} mm below it; add a floating joint above the root, or "
            "attach the URDF to a body with a free joint in MJCF",
            linted.place("body", name),
        )


def _ends_in_wheel(model: mujoco.MjModel, data: mujoco.MjData, joints: NDArray[np.intp]) -> bool:
    if not joints.size:
        return False
    last = int(joints[-1])
    level = abs(float(data.xaxis[last, 2])) < 0.1  # an axle is level, to six degrees
    return model.jnt_type[last] == _HINGE and not model.jnt_limited[last] and level


def _surround_center(
    model: mujoco.MjModel, data: mujoco.MjData, feet: list[int], tree: NDArray[np.intp]
) -> bool:
    # Whether the lowest geoms of at least three limbs lie on all sides of the center of mass.
    if len(feet) < 3:
        return False
    lows = _lowest_points(model, data)
    ends = []
    for foot in feet:
        own = np.flatnonzero(tree[model.geom_bodyid] == foot)
        ends.append(data.geom_xpos[own[lows[own].argmin()], :2])
    masses = model.body_mass[1:, None]
    center = (masses * data.xipos[1:, :2]).sum(axis=0) / max(masses.sum(), mujoco.mjMINVAL)
    away = np.array(ends) - center
    angles = np.sort(np.arctan2(away[:, 1], away[:, 0]))
    gaps = np.diff(np.append(angles, angles[0] + 2 * np.pi))
    return bool(gaps.max() <= np.pi)


def _find_root(model: mujoco.MjModel, body: int, roots: NDArray[np.intp]) -> int:
    # The root below the world that carries a body by a joint; -1 for the world and parts of it.
    root = int(model.body_rootid[body])
    return root if root in roots and model.body_weldid[body] else -1


def _lowest_points(model: mujoco.MjModel, data: mujoco.MjData) -> Floats:
    # Return the least height of each geom's bounding box (ngeom,) [m]; -inf for planes.
    center, half = model.geom_aabb[:, :3], model.geom_aabb[:, 3:]
    third = np.asarray(data.geom_xmat)[:, 6:]
    low = data.geom_xpos[:, 2] + (third * center).sum(axis=1) - np.abs(third * half).sum(axis=1)
    return np.where(model.geom_rbound > 0, low, -np.inf)


@rule("nothing-below", "warn", voids_runs=True)
def find_missing_floor(linted: LintedModel) -> Iterator[Fault]:
    """Nothing can stop the fall of a driven robot with a floating base.

    Robots that float in a medium or by thrusters, or hang from something, pass, as does a model
    without gravity. Fix: examine the scene that includes the robot, or add a floor.
    """
    model = linted.model
    for root in list_unsupported_roots(model):
        if not find_driven_joints(model, root):
            continue
        name = linted.name("body", root)
        yield Fault(
            f"nothing is below the floating base {name}: none of its geoms can "
            "touch a floor or another body, so it falls for ever; examine the scene that includes "
            "it, or add a floor",
            linted.place("body", root),
        )
        return
