"""SAPIEN (PhysX): hinges, slides, primitives and hulls in rigid contact, in single precision."""

from collections.abc import Callable
from pathlib import Path
from runpy import run_path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np

PACKAGE = "sapien"
REQUIREMENTS = ("sapien>=3.0.3,<4", "mujoco=={mujoco}", "numpy", "scipy")
_JOINTS, _CONTACTS, _POSES, _ARRIVALS = (
    SimpleNamespace(**run_path(str(Path(__file__).parent / "beside" / name)))
    for name in ("joints.py", "rigid_contacts.py", "poses.py", "arrivals.py")
)
IGNORED = _CONTACTS.IGNORED
_UNLIMITED = 1e12  # speeds [m/s, rad/s], which PhysX cuts at 100 rad/s by itself
_SORTS = 32  # bits of a mask
# PhysX has planes, capsules and cylinders along x, MuJoCo along z.
_X_TO_Z = np.array([0.5**0.5, 0, -(0.5**0.5), 0])


def refusal(model: mujoco.MjModel) -> str | None:
    """Return why it cannot simulate a model; None if it can."""
    refusals = [*_JOINTS.refusals(model), *_CONTACTS.refusals(model), *_refusals(model)]
    return next((why for applies, why in refusals if applies), None)


def _refusals(model: mujoco.MjModel) -> list[tuple[Any, str]]:
    """Return what SAPIEN alone cannot do."""
    pairs = _CONTACTS.pairs_of(model)
    try:
        _laws(model)
    except ValueError as error:
        return [(True, f"{error}; give geoms one friction and one solref")]
    moves = model.body_weldid > 0
    planes = model.geom_type == _CONTACTS.PLANE
    off = _JOINTS.OFF.mjDSBL_FRICTIONLOSS | _JOINTS.OFF.mjDSBL_CONSTRAINT
    related = [
        tuple(sorted(int(model.body_weldid[model.geom_bodyid[geom]]) for geom in pair))
        for pair in pairs
    ]
    parents = model.body_weldid[model.body_parentid]
    return [
        ((model.jnt_type == _JOINTS.BALL).any(), "it has no ball joints; take three hinges"),
        ((model.body_jntnum > 1).any(), "it has one joint a body; give each a body of its own"),
        (
            not model.opt.disableflags & off and model.dof_frictionloss.any(),
            "it knows no dry friction of joints; set frictionloss to false",
        ),
        (
            any(law.torsion or law.rolling for law in pairs.values()),
            "it has friction against sliding alone; set condim to 3",
        ),
        ((planes & moves[model.geom_bodyid]).any(), "its planes are fixed; take a box"),
        (
            any(one and parents[other] == one for one, other in related),
            "neighbours in a tree never touch; leave filterparent on, and exclude them",
        ),
        (
            _CONTACTS.sorts_of(model) > _SORTS,
            f"its masks tell {_SORTS} sorts of geoms apart",
        ),
    ]


def _laws(model: mujoco.MjModel) -> dict[str, dict[int, float]]:
    """Return friction and restitution of each geom, whose means are what MuJoCo mixes."""
    pairs, told = _CONTACTS.pairs_of(model), {}
    for name in ("friction", "restitution"):
        wanted = {pair: 2 * getattr(law, name) for pair, law in pairs.items()}
        told[name] = _CONTACTS.as_sums(wanted)
    return told


def simulate(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    """Simulate runs one after the other."""
    return _CONTACTS.simulated(request, World, tick)


class World:
    """A model as SAPIEN has it: actors for what is fixed and for bodies that fly alone, else trees.

    The frame of a body is MuJoCo's; of a joint x is the axis.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        import sapien
        from sapien import physx

        self._model, self._sapien, self._physx = model, sapien, physx
        gravity = _JOINTS.gravity_of(model)
        physx.set_scene_config(gravity=gravity, bounce_threshold=_CONTACTS.BOUNCES_FROM)
        self._system = physx.PhysxCpuSystem()
        self._scene = sapien.Scene([self._system])
        self._scene.set_timestep(float(model.opt.timestep))
        self._laws, self._masks = _laws(model), _CONTACTS.masks_of(model)
        self._shapes: list[tuple[int, Any]] = []  # of geoms
        self._bodies: dict[int, Any] = {}  # components of those that move
        self._trees: list[Any] = []  # articulations
        self._add_fixed()
        for root in np.flatnonzero(model.body_parentid[1:] == 0) + 1:
            tree = np.flatnonzero(model.body_rootid == root).tolist()
            if model.body_weldid[tree].any():
                self._add_tree(tree)
        self._check_arrived()

    def _add_fixed(self) -> None:
        model, data = self._model, mujoco.MjData(self._model)
        mujoco.mj_kinematics(model, data)
        fixed = self._physx.PhysxRigidStaticComponent()
        for geom in self._masks:
            if not model.body_weldid[model.geom_bodyid[geom]]:
                turn = np.zeros(4)
                mujoco.mju_mat2Quat(turn, data.geom_xmat[geom])
                fixed.attach(self._shape(geom, (data.geom_xpos[geom], turn)))
        self._add(fixed)

    def _add(self, component: Any, place: Any = _POSES.IDENTITY) -> Any:
        entity = self._sapien.Entity()
        entity.add_component(component)
        entity.set_pose(self._pose(place))
        self._scene.add_entity(entity)
        return entity

    def _pose(self, place: Any) -> Any:
        return self._sapien.Pose(np.array(place[0]), np.array(place[1]))

    def _add_tree(self, tree: list[int]) -> None:
        """Add a body that flies alone, or the articulation of a tree, on a fixed link or a free."""
        model, physx = self._model, self._physx
        flies = model.body_dofnum[tree[0]] == 6
        if flies and len(tree) == 1:
            self._fill(tree[0], physx.PhysxRigidDynamicComponent())
            self._add(self._bodies[tree[0]])
            return
        links: dict[int, Any] = {}
        if not flies:
            links[0] = physx.PhysxArticulationLinkComponent()
            links[0].joint.type = "fixed"
        for body in tree:
            parent = links.get(int(model.body_parentid[body]))
            links[body] = physx.PhysxArticulationLinkComponent(parent)
            if parent is not None:
                self._join(body, links[body].joint)
            self._fill(body, links[body])
        for link in links.values():
            self._add(link)
        self._trees.append(links[tree[0]].articulation)

    def _join(self, body: int, joint: Any) -> None:
        """Set the joint by which a link moves in its parent."""
        model, own = self._model, (self._model.body_pos[body], self._model.body_quat[body])
        number = int(model.body_jntadr[body])
        if number < 0:
            joint.type, joint.pose_in_parent = "fixed", self._pose(own)
            return
        slides = model.jnt_type[number] == _JOINTS.SLIDE
        turn, axis = np.zeros(4), np.array(model.jnt_axis[number])
        mujoco.mju_quatZ2Vec(turn, axis)
        _, turn = _POSES.then((np.zeros(3), turn), (np.zeros(3), _X_TO_Z))
        anchor = np.array(model.jnt_pos[number]), turn
        joint.name, joint.type = str(number), "prismatic" if slides else "revolute_unwrapped"
        joint.pose_in_child = self._pose(anchor)
        joint.pose_in_parent = self._pose(_POSES.then(own, anchor))
        joint.limit = np.array([-np.inf, np.inf])
        off = model.opt.disableflags & _JOINTS.OFF.mjDSBL_DAMPER
        dof = int(model.jnt_dofadr[number])
        joint.set_drive_properties(0, 0.0 if off else float(model.dof_damping[dof]))
        joint.set_armature([float(model.dof_armature[dof])])
        joint.set_friction(0)
        joint.set_max_velocity(_UNLIMITED)

    def _fill(self, body: int, component: Any) -> None:
        """Give a body its mass and its shapes, and nothing that MuJoCo's has not."""
        model = self._model
        for geom in self._masks:
            if model.geom_bodyid[geom] == body and model.body_weldid[body]:
                place = model.geom_pos[geom], model.geom_quat[geom]
                component.attach(self._shape(geom, place))
        # A mass of 0 is refused, an inertia of 0 taken for 1.
        masses, inertias = map(_ARRIVALS.positive, (model.body_mass, model.body_inertia))
        component.set_mass(float(masses[body]))
        component.set_cmass_local_pose(self._pose((model.body_ipos[body], model.body_iquat[body])))
        component.set_inertia(inertias[body])
        component.set_linear_damping(0)
        component.set_angular_damping(0)
        component.set_max_angular_velocity(_UNLIMITED)
        if hasattr(component, "set_sleep_threshold"):
            component.set_sleep_threshold(0)
        self._bodies[body] = component

    def _shape(self, geom: int, place: Any) -> Any:
        """Return a shape at a place in its body's frame, with its material and masks."""
        model, physx = self._model, self._physx
        kind, size = int(model.geom_type[geom]), model.geom_size[geom].tolist()
        friction, restitution = (self._laws[name].get(geom, 0.0) for name in self._laws)
        material = physx.PhysxMaterial(friction, friction, restitution)
        if kind == _CONTACTS.SPHERE:
            shape = physx.PhysxCollisionShapeSphere(size[0], material)
        elif kind == _CONTACTS.BOX:
            shape = physx.PhysxCollisionShapeBox(np.array(size), material)
        elif kind == _CONTACTS.MESH:
            hull = _CONTACTS.hull_of(model, geom)
            shape = physx.PhysxCollisionShapeConvexMesh(hull, np.ones(3), material)
        elif kind == _CONTACTS.PLANE:
            shape = physx.PhysxCollisionShapePlane(material)
        elif kind == _CONTACTS.CAPSULE:
            shape = physx.PhysxCollisionShapeCapsule(size[0], size[1], material)
        else:
            shape = physx.PhysxCollisionShapeCylinder(size[0], size[1], material)
        if kind in (_CONTACTS.PLANE, _CONTACTS.CAPSULE, _CONTACTS.CYLINDER):
            place = _POSES.then(place, (np.zeros(3), _X_TO_Z))
        shape.set_local_pose(self._pose(place))
        shape.set_collision_groups([*self._masks[geom], 0, 0])
        self._shapes.append((geom, shape))
        return shape

    def _check_arrived(self) -> None:
        """Compare what SAPIEN has with the model: bodies, shapes, materials, where bodies are."""
        model, compare = self._model, _ARRIVALS.compare
        bodies = [body for body in self._bodies if model.body_weldid[body]]
        told = [self._bodies[body] for body in bodies]
        names = [f"body '{model.body(body).name or body}'" for body in bodies]
        compare("the mass", model.body_mass[bodies], [each.mass for each in told], names)
        compare("the inertia", model.body_inertia[bodies], [each.inertia for each in told], names)
        geoms, shapes = [geom for geom, _ in self._shapes], [shape for _, shape in self._shapes]
        names = [f"geom '{model.geom(geom).name or geom}'" for geom in geoms]
        for name, its in (("friction", "dynamic_friction"), ("restitution", "restitution")):
            sent = [_laws(model)[name].get(geom, 0.0) for geom in geoms]
            arrived = [getattr(shape.physical_material, its) for shape in shapes]
            compare(f"the {name}", sent, arrived, names)
        sent = [[*_CONTACTS.masks_of(model)[geom], 0, 0] for geom in geoms]
        compare("the mask", sent, [shape.collision_groups for shape in shapes], names)
        sizes = [self._size(geom, shape) for geom, shape in self._shapes]
        compare("the size", [each[0] for each in sizes], [each[1] for each in sizes], names)
        gravity = _JOINTS.gravity_of(model)
        compare("the acceleration", gravity, self._system.config.gravity, ["gravity"])
        compare("the timestep", model.opt.timestep, self._scene.timestep, ["the model"])
        self._check_places(bodies)

    def _size(self, geom: int, shape: Any) -> tuple[list[float], list[float]]:
        """Return a size (3,) as it was sent, and as SAPIEN tells it; of meshes their corners."""
        kind, size = int(self._model.geom_type[geom]), self._model.geom_size[geom].tolist()
        if kind == _CONTACTS.SPHERE:
            return [size[0], 0, 0], [shape.radius, 0, 0]
        if kind == _CONTACTS.BOX:
            return size, list(shape.half_size)
        if kind in (_CONTACTS.CAPSULE, _CONTACTS.CYLINDER):
            return [*size[:2], 0], [shape.radius, shape.half_length, 0]
        if kind == _CONTACTS.MESH:
            hull = _CONTACTS.hull_of(self._model, geom)
            corners = np.ptp(hull, axis=0), np.ptp(np.array(shape.vertices), axis=0)
            return corners[0].tolist(), corners[1].tolist()
        return [0, 0, 1], [0, 0, 1]

    def _check_places(self, bodies: list[int]) -> None:
        """Compare where bodies are, away from where the joints have their zero."""
        model, data = self._model, _POSES.away_from_zero(self._model)
        self.set(data.qpos, data.qvel)
        scale = max(1.0, float(np.abs(data.xipos).max(initial=0)))
        names = [f"body '{model.body(body).name or body}'" for body in bodies]
        poses = [self._bodies[body].entity_pose for body in bodies]
        centres = [
            _POSES.then(
                (pose.p.astype(float), pose.q.astype(float)),
                (model.body_ipos[body], _POSES.STRAIGHT),
            )[0]
            for pose, body in zip(poses, bodies, strict=True)
        ]
        _ARRIVALS.compare("the place", data.xipos[bodies], centres, names, scale)
        self._last = data.qpos
        sent = np.concatenate([data.qpos, data.qvel])
        _ARRIVALS.compare("the state", sent, self.state(), ["the model"], scale)

    def _dofs(self, tree: Any) -> list[tuple[int, int]]:
        """Return MuJoCo's joints of an articulation in its order: place and degree of freedom."""
        model = self._model
        numbers = [int(joint.name) for joint in tree.active_joints]
        return [(int(model.jnt_qposadr[each]), int(model.jnt_dofadr[each])) for each in numbers]

    def set(self, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Set coordinates and velocities."""
        model = self._model
        self._last = qpos.copy()
        for joint in np.flatnonzero(model.jnt_type == _JOINTS.FREE).tolist():
            body = int(model.jnt_bodyid[joint])
            q, v = qpos[model.jnt_qposadr[joint] :], qvel[model.jnt_dofadr[joint] :]
            pose, moving = self._pose((q[:3], q[3:7])), _POSES.at_centre(model, body, q[3:7], v)
            component = self._bodies[body]
            if hasattr(component, "articulation"):
                component.articulation.set_root_pose(pose)
                component.articulation.set_root_linear_velocity(moving[0])
                component.articulation.set_root_angular_velocity(moving[1])
            else:
                component.entity.set_pose(pose)
                component.set_linear_velocity(moving[0])
                component.set_angular_velocity(moving[1])
        for tree in self._trees:
            dofs = self._dofs(tree)
            tree.set_qpos(np.array([qpos[at] - model.qpos0[at] for at, _ in dofs]))
            tree.set_qvel(np.array([qvel[dof] for _, dof in dofs]))

    def state(self) -> np.ndarray:
        """Return coordinates and velocities, as MuJoCo has them."""
        model = self._model
        qpos, qvel = model.qpos0.copy(), np.zeros(model.nv)
        for joint in np.flatnonzero(model.jnt_type == _JOINTS.FREE).tolist():
            body, at = int(model.jnt_bodyid[joint]), int(model.jnt_qposadr[joint])
            component, dof = self._bodies[body], int(model.jnt_dofadr[joint])
            pose = component.entity_pose
            turn = pose.q.astype(float) / np.linalg.norm(pose.q)
            turn = turn if turn @ self._last[at + 3 : at + 7] >= 0 else -turn
            qpos[at : at + 7] = [*pose.p, *turn]
            moving = component.linear_velocity, component.angular_velocity
            qvel[dof : dof + 6] = _POSES.at_origin(model, body, turn, moving)
        for tree in self._trees:
            told = tree.get_qpos(), tree.get_qvel()
            for (at, dof), moved, speed in zip(self._dofs(tree), *told, strict=True):
                qpos[at], qvel[dof] = moved + model.qpos0[at], speed
        self._last = qpos
        return np.concatenate([qpos, qvel])

    def drive(self, state: np.ndarray, control: np.ndarray, applied: np.ndarray) -> None:
        """Apply what acts in the next step: springs, actuators, (nbody, 6) forces on bodies."""
        model = self._model
        qpos, qvel = np.split(state, [model.nq])
        forces = _JOINTS.joint_forces(model, qpos, qvel, control)
        for tree in self._trees:
            tree.set_qf(np.array([forces[dof] for _, dof in self._dofs(tree)]))
        for body in np.flatnonzero(applied.any(axis=1)).tolist():
            if body in self._bodies:
                self._bodies[body].add_force_torque(applied[body, :3], applied[body, 3:])

    def step(self) -> None:
        """Make a step."""
        self._scene.step()

    def contacts(self) -> list[Any]:
        """Return the contacts of the step; of forces SAPIEN tells those along normals alone."""
        found: list[Any] = []
        for contact in self._system.get_contacts():
            first, second = (self._geom(shape) for shape in contact.shapes)
            for point in contact.points:
                force = np.array(point.impulse, dtype=float) / self._model.opt.timestep
                rest = force, point.position, point.normal, point.separation
                found.append(_CONTACTS.Contact.of(second, first, *rest))
        return found

    def _geom(self, shape: Any) -> int:
        return next(geom for geom, own in self._shapes if own == shape)
