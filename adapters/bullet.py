"""PyBullet: all joints, primitives and hulls in rigid contact, built by its own API."""

from collections.abc import Callable
from pathlib import Path
from runpy import run_path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np

PACKAGE = "pybullet"
REQUIREMENTS = ("pybullet>=3.2.7,<4", "mujoco=={mujoco}", "numpy", "scipy")
_JOINTS, _CONTACTS, _POSES, _ARRIVALS = (
    SimpleNamespace(**run_path(str(Path(__file__).parent / "beside" / name)))
    for name in ("joints.py", "rigid_contacts.py", "poses.py", "arrivals.py")
)
IGNORED = _CONTACTS.IGNORED
_NOWHERE, _UNTURNED = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]
_UNLIMITED = 1e12  # speed of joints [m/s, rad/s], which Bullet cuts at 100 by itself
_WORLD = -1  # the link that is a multibody's base


def refusal(model: mujoco.MjModel) -> str | None:
    """Return why it cannot simulate a model; None if it can."""
    refusals = [*_JOINTS.refusals(model), *_CONTACTS.refusals(model), *_refusals(model)]
    return next((why for applies, why in refusals if applies), None)


def _refusals(model: mujoco.MjModel) -> list[tuple[Any, str]]:
    """Return what Bullet alone cannot do."""
    try:
        _laws(model)
    except ValueError as error:
        return [(True, f"{error}; give geoms one friction and one solref")]
    static = (model.body_weldid == 0)[model.geom_bodyid]
    planes = model.geom_type == _CONTACTS.PLANE
    balls = np.isin(model.dof_jntid, np.flatnonzero(model.jnt_type == _JOINTS.BALL))
    return [
        (model.dof_frictionloss[balls].any(), "its ball joints have no dry friction"),
        (model.dof_armature.any(), "it knows no armature; set armature to 0"),
        ((planes & ~static).any(), "its planes are fixed; take a box for one that moves"),
    ]


def _laws(model: mujoco.MjModel) -> dict[str, dict[int, float]]:
    """Return what each geom has, so that Bullet combines it to what MuJoCo mixes.

    Friction f and restitution are multiplied; torsion and rolling r of two geoms are
    `r1 f2 + r2 f1`, so that r is a length of the geom's own times its friction.
    """
    pairs = _CONTACTS.pairs_of(model)
    friction = {pair: law.friction for pair, law in pairs.items()}
    told = {
        "friction": _CONTACTS.as_products(friction),
        "restitution": _CONTACTS.as_products(
            {pair: law.restitution for pair, law in pairs.items()}
        ),
    }
    for name in ("torsion", "rolling"):
        wanted = {pair: getattr(law, name) for pair, law in pairs.items()}
        if any(value and not friction[pair] for pair, value in wanted.items()):
            raise ValueError(f"it has {name} only beside sliding friction")
        lengths = {pair: value / friction[pair] for pair, value in wanted.items() if friction[pair]}
        its = _CONTACTS.as_sums(lengths)
        told[name] = {geom: length * told["friction"][geom] for geom, length in its.items()}
    return told


def simulate(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    """Simulate runs one after the other."""
    return _CONTACTS.simulated(request, World, tick)


class World:
    """A model as Bullet has it: a multibody for each tree, with a link for each joint and geom.

    A link's frame is that of MuJoCo's body, moved to the joint's anchor; a body with several joints
    has links without mass before its own, one with several geoms such after it.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        import pybullet
        from pybullet_utils.bullet_client import BulletClient

        self._model, self._names = model, pybullet
        self._bullet = BulletClient(pybullet.DIRECT)
        self._bullet.setGravity(*_JOINTS.gravity_of(model))
        self._bullet.setPhysicsEngineParameter(
            fixedTimeStep=float(model.opt.timestep),
            restitutionVelocityThreshold=_CONTACTS.BOUNCES_FROM,
            deterministicOverlappingPairs=1,
        )
        self._pairs = _CONTACTS.pairs_of(model)
        self._touching = sorted({geom for pair in self._pairs for geom in pair})
        self._geoms: dict[tuple[int, int], int] = {}  # of (multibody, link)
        self._joints: dict[int, tuple[int, int]] = {}  # MuJoCo's, to (multibody, link)
        self._bodies: dict[int, tuple[int, int]] = {}  # that move
        for body in range(1, model.nbody):
            if not model.body_parentid[body] and model.body_weldid[self._tree(body)].any():
                self._add_tree(body)
        for geom in self._touching:
            if not model.body_weldid[model.geom_bodyid[geom]]:
                self._add_fixed(geom)
        self._set_laws()
        self._check_arrived()

    def _add_fixed(self, geom: int) -> None:
        data = mujoco.MjData(self._model)
        mujoco.mj_kinematics(self._model, data)
        turn = np.zeros(4)
        mujoco.mju_mat2Quat(turn, data.geom_xmat[geom])
        shape = self._shape(geom, _POSES.IDENTITY)
        place = [*data.geom_xpos[geom]]
        made = self._bullet.createMultiBody(0, shape, -1, place, _bullets(turn))
        self._geoms[made, _WORLD] = geom

    def _add_tree(self, root: int) -> None:
        """Add the multibody of a tree, whose base is its free body, or a fixed one without shape.

        Of a body that does not move, shapes are fixed ones.
        """
        model, links = self._model, _Links()
        # Of each body: its link, and where the body is in the link's frame.
        carried: dict[int, tuple[int, Any]] = {0: (_WORLD, _POSES.IDENTITY)}
        joints: dict[int, int] = {}
        for body in self._tree(root):
            link, place = carried[int(model.body_parentid[body])]
            place = _POSES.then(place, (model.body_pos[body], model.body_quat[body]))
            first = int(model.body_jntadr[body])
            moving = range(first, first + int(model.body_jntnum[body]))
            if moving and model.jnt_type[first] == _JOINTS.FREE:
                link, place, joints[first], moving = _WORLD, _POSES.IDENTITY, _WORLD, range(0)
            elif not moving:
                link, place = links.add(link, place, self._names.JOINT_FIXED), _POSES.IDENTITY
            for joint in moving:
                anchor = np.array(model.jnt_pos[joint])
                link = links.add(
                    link, _POSES.then(place, (anchor, _POSES.STRAIGHT)), *self._kind(joint)
                )
                place, joints[joint] = (-anchor, _POSES.STRAIGHT), link
            carried[body] = link, place
            self._fill(links, link, body, place)
        made = self._make(links)
        self._geoms |= {(made, link): geom for link, geom in links.geoms.items()}
        self._joints |= {joint: (made, link) for joint, link in joints.items()}
        self._bodies |= {body: (made, link) for link, body in links.bodies.items()}

    def _fill(self, links: "_Links", link: int, body: int, place: Any) -> None:
        """Give a link the mass and the shapes of a body, which is at a place in its frame."""
        model = self._model
        own = _POSES.then(place, (model.body_ipos[body], model.body_iquat[body]))
        links.bodies[link], links.inertial[link] = body, (float(model.body_mass[body]), own)
        for geom in self._touching:
            if model.geom_bodyid[geom] != body or not model.body_weldid[body]:
                continue
            shape = _POSES.then(place, (model.geom_pos[geom], model.geom_quat[geom]))
            if link in links.shapes:
                link = links.add(link, _POSES.IDENTITY, self._names.JOINT_FIXED)
            links.geoms[link], links.shapes[link] = geom, self._shape(geom, shape)

    def _tree(self, root: int) -> list[int]:
        return [body for body in range(root, self._model.nbody)
                if self._model.body_rootid[body] == root]  # fmt: skip

    def _kind(self, joint: int) -> tuple[int, np.ndarray]:
        """Return Bullet's kind of a joint, and its axis."""
        kinds = {
            _JOINTS.HINGE: self._names.JOINT_REVOLUTE,
            _JOINTS.SLIDE: self._names.JOINT_PRISMATIC,
            _JOINTS.BALL: self._names.JOINT_SPHERICAL,
        }
        return kinds[int(self._model.jnt_type[joint])], np.array(self._model.jnt_axis[joint])

    def _shape(self, geom: int, place: Any) -> int:
        """Return a shape at a place in its link's frame."""
        bullet, names, kind = self._bullet, self._names, int(self._model.geom_type[geom])
        size = self._model.geom_size[geom]
        there = {
            "collisionFramePosition": list(place[0]),
            "collisionFrameOrientation": _bullets(place[1]),
        }
        if kind == _CONTACTS.PLANE:
            return bullet.createCollisionShape(names.GEOM_PLANE, planeNormal=[0, 0, 1])
        if kind == _CONTACTS.SPHERE:
            return bullet.createCollisionShape(names.GEOM_SPHERE, radius=size[0], **there)
        if kind == _CONTACTS.BOX:
            return bullet.createCollisionShape(names.GEOM_BOX, halfExtents=list(size), **there)
        if kind == _CONTACTS.MESH:
            hull = _CONTACTS.hull_of(self._model, geom).tolist()
            return bullet.createCollisionShape(names.GEOM_MESH, vertices=hull, **there)
        round_ = names.GEOM_CAPSULE if kind == _CONTACTS.CAPSULE else names.GEOM_CYLINDER
        return bullet.createCollisionShape(round_, radius=size[0], height=2 * size[1], **there)

    def _make(self, links: "_Links") -> int:
        """Return a multibody of links, with the inertias of their bodies, all else of them off."""
        bullet, model = self._bullet, self._model
        flags = (
            self._names.URDF_USE_SELF_COLLISION | self._names.URDF_USE_SELF_COLLISION_INCLUDE_PARENT
        )
        base = links.bodies.get(_WORLD, 0)  # MuJoCo's world has no mass
        made = bullet.createMultiBody(
            baseMass=float(model.body_mass[base]),
            baseCollisionShapeIndex=links.shapes.get(_WORLD, -1),
            baseInertialFramePosition=list(model.body_ipos[base]),
            baseInertialFrameOrientation=_bullets(model.body_iquat[base]),
            flags=flags,
            **links.told(),
        )
        for link, body in links.bodies.items():
            # One by one: several in one call are not all taken.
            inertia = list(model.body_inertia[body])
            bullet.changeDynamics(made, link, localInertiaDiagonal=inertia)
        for link in range(_WORLD, bullet.getNumJoints(made)):
            bullet.changeDynamics(made, link, linearDamping=0)
            bullet.changeDynamics(made, link, angularDamping=0)
            bullet.changeDynamics(made, link, maxJointVelocity=_UNLIMITED)
        return made

    def _set_laws(self) -> None:
        bullet, model, laws = self._bullet, self._model, _laws(self._model)
        given = {"friction": "lateralFriction", "torsion": "spinningFriction",
                 "rolling": "rollingFriction", "restitution": "restitution"}  # fmt: skip
        for (made, link), geom in self._geoms.items():
            for name, its in given.items():
                bullet.changeDynamics(made, link, **{its: laws[name].get(geom, 0.0)})
        off = model.opt.disableflags
        for joint, (made, link) in self._joints.items():
            if link == _WORLD:
                continue
            dof = model.jnt_dofadr[joint]
            damping = model.dof_damping[dof] * (not off & _JOINTS.OFF.mjDSBL_DAMPER)
            bullet.changeDynamics(made, link, jointDamping=float(damping))
            dry = model.dof_frictionloss[dof] * (not off & _JOINTS.OFF.mjDSBL_FRICTIONLOSS)
            # Bullet's joints have a motor that holds them, unless told otherwise.
            if model.jnt_type[joint] == _JOINTS.BALL:
                bullet.setJointMotorControlMultiDof(
                    made, link, self._names.POSITION_CONTROL, _UNTURNED, force=_NOWHERE
                )
            else:
                bullet.setJointMotorControl2(
                    made, link, self._names.VELOCITY_CONTROL, targetVelocity=0, force=float(dry)
                )
        places = {geom: place for place, geom in self._geoms.items()}
        for number, one in enumerate(self._touching):
            for other in self._touching[number + 1 :]:
                (first, its), (second, others) = places[one], places[other]
                touch = int((one, other) in self._pairs)
                bullet.setCollisionFilterPair(first, second, its, others, touch)

    def _check_arrived(self) -> None:
        """Compare what Bullet has with the model: bodies, shapes, frictions, where links are."""
        bullet, model, compare = self._bullet, self._model, _ARRIVALS.compare
        bodies = [body for body in self._bodies if body]
        names = [f"body '{model.body(body).name or body}'" for body in bodies]
        told = [bullet.getDynamicsInfo(*self._bodies[body]) for body in bodies]
        compare("the mass", model.body_mass[bodies], [each[0] for each in told], names)
        compare("the inertia", model.body_inertia[bodies], [each[2] for each in told], names)
        geoms, places = list(self._geoms.values()), list(self._geoms)
        names, laws = [f"geom '{model.geom(geom).name or geom}'" for geom in geoms], _laws(model)
        told = [bullet.getDynamicsInfo(*place) for place in places]
        order = {"friction": 1, "restitution": 5, "rolling": 6, "torsion": 7}
        for name, number in order.items():
            sent = [laws[name].get(geom, 0.0) for geom in geoms]
            compare(f"the {name}", sent, [each[number] for each in told], names)
        sizes = [bullet.getCollisionShapeData(*place)[0][3] for place in places]
        compare("the size", [self._size(geom) for geom in geoms], sizes, names)
        set_up = bullet.getPhysicsEngineParameters()
        gravity = [set_up[f"gravityAcceleration{axis}"] for axis in "XYZ"]
        compare("the acceleration", _JOINTS.gravity_of(model), gravity, ["gravity"])
        compare("the timestep", model.opt.timestep, set_up["fixedTimeStep"], ["the model"])
        self._check_places()

    def _size(self, geom: int) -> list[float]:
        """Return a size as Bullet tells it."""
        size, kind = self._model.geom_size[geom].tolist(), int(self._model.geom_type[geom])
        if kind in (_CONTACTS.CAPSULE, _CONTACTS.CYLINDER):
            return [2 * size[1], size[0], 0]
        told = {
            _CONTACTS.SPHERE: [size[0]] * 3,
            _CONTACTS.BOX: [2 * each for each in size],
            _CONTACTS.PLANE: [0, 0, 1],
        }
        return told.get(kind, [1.0, 1.0, 1.0])

    def _check_places(self) -> None:
        """Compare where bodies are, away from where the joints have their zero."""
        model, data = self._model, _POSES.away_from_zero(self._model)
        self.set(data.qpos, data.qvel)
        bodies = [body for body in self._bodies if body]
        places = [self._centre(body) for body in bodies]
        names = [f"body '{model.body(body).name or body}'" for body in bodies]
        scale = max(1.0, float(np.abs(data.xipos).max(initial=0)))
        _ARRIVALS.compare("the place", data.xipos[bodies], places, names, scale)
        sent = np.concatenate([data.qpos, data.qvel])
        _ARRIVALS.compare("the state", sent, self.state(), ["the model"], scale)

    def _centre(self, body: int) -> Any:
        made, link = self._bodies[body]
        if link == _WORLD:
            return self._bullet.getBasePositionAndOrientation(made)[0]
        return self._bullet.getLinkState(made, link, computeForwardKinematics=1)[0]

    def set(self, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Set coordinates and velocities."""
        bullet, model = self._bullet, self._model
        self._last = qpos.copy()
        for joint, (made, link) in self._joints.items():
            q, v = qpos[model.jnt_qposadr[joint] :], qvel[model.jnt_dofadr[joint] :]
            if link == _WORLD:
                body = int(model.jnt_bodyid[joint])
                own = model.body_ipos[body], model.body_iquat[body]
                place, turn = _POSES.then((q[:3], q[3:7]), own)
                bullet.resetBasePositionAndOrientation(made, list(place), _bullets(turn))
                linear, spin = _POSES.at_centre(model, body, q[3:7], v)
                bullet.resetBaseVelocity(made, list(linear), list(spin))
            elif model.jnt_type[joint] == _JOINTS.BALL:
                bullet.resetJointStateMultiDof(made, link, _bullets(q[:4]), list(v[:3]))
            else:
                start = model.qpos0[model.jnt_qposadr[joint]]
                bullet.resetJointState(made, link, float(q[0] - start), float(v[0]))

    def state(self) -> np.ndarray:
        """Return coordinates and velocities, as MuJoCo has them."""
        bullet, model = self._bullet, self._model
        qpos, qvel = model.qpos0.copy(), np.zeros(model.nv)
        for joint, (made, link) in self._joints.items():
            at, dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
            if link == _WORLD:
                body = int(model.jnt_bodyid[joint])
                place, turn = bullet.getBasePositionAndOrientation(made)
                back = _POSES.inverse((model.body_ipos[body], model.body_iquat[body]))
                own = _POSES.then((np.array(place), _mujocos(turn)), back)
                qpos[at : at + 7] = [*own[0], *self._near(at + 3, own[1])]
                moving = bullet.getBaseVelocity(made)
                qvel[dof : dof + 6] = _POSES.at_origin(model, body, own[1], moving)
            elif model.jnt_type[joint] == _JOINTS.BALL:
                turn, spin = bullet.getJointStateMultiDof(made, link)[:2]
                qpos[at : at + 4] = self._near(at, _mujocos(turn))
                qvel[dof : dof + 3] = spin
            else:
                moved, speed = bullet.getJointState(made, link)[:2]
                qpos[at], qvel[dof] = moved + model.qpos0[at], speed
        self._last = qpos
        return np.concatenate([qpos, qvel])

    def _near(self, at: int, turn: np.ndarray) -> np.ndarray:
        """Return the one of a quaternion's two signs that is nearer to the last state's."""
        return turn if turn @ self._last[at : at + 4] >= 0 else -turn

    def drive(self, state: np.ndarray, control: np.ndarray, applied: np.ndarray) -> None:
        """Apply what acts in the next step: springs, actuators, (nbody, 6) forces on bodies."""
        bullet, model, names = self._bullet, self._model, self._names
        qpos, qvel = np.split(state, [model.nq])
        forces = _JOINTS.joint_forces(model, qpos, qvel, control)
        for joint, (made, link) in self._joints.items():
            force = float(forces[model.jnt_dofadr[joint]])
            if link != _WORLD and force:
                bullet.setJointMotorControl2(made, link, names.TORQUE_CONTROL, force=force)
        for body in np.flatnonzero(applied.any(axis=1)).tolist():
            if body not in self._bodies:
                continue
            force, torque = np.split(applied[body], 2)
            place = self._centre(body)
            bullet.applyExternalForce(*self._bodies[body], list(force), place, names.WORLD_FRAME)
            bullet.applyExternalTorque(*self._bodies[body], list(torque), names.WORLD_FRAME)

    def step(self) -> None:
        """Make a step."""
        self._bullet.stepSimulation()

    def contacts(self) -> list[Any]:
        """Return the contacts of the step, where they were at its start."""
        found: list[Any] = []
        for point in self._bullet.getContactPoints():
            _, one, other, its, others, _, place, normal, distance, push, *rest = point
            force = push * np.array(normal)
            for rub, way in zip(rest[::2], rest[1::2], strict=True):
                force += rub * np.array(way)
            geoms = self._geoms[other, others], self._geoms[one, its]
            found.append(_CONTACTS.Contact.of(*geoms, force, place, normal, distance))
        return found


class _Links:
    """Links of a multibody while it is made, by number; -1 is its base."""

    def __init__(self) -> None:
        self._rows: list[tuple[int, Any, int, np.ndarray]] = []  # parent, place, kind, axis
        self.inertial: dict[int, tuple[float, Any]] = {}  # mass, and place of its centre
        self.bodies: dict[int, int] = {}
        self.geoms: dict[int, int] = {}
        self.shapes: dict[int, int] = {}

    def add(self, parent: int, place: Any, kind: int, axis: Any = (0, 0, 1)) -> int:
        self._rows.append((parent, place, kind, axis))
        return len(self._rows) - 1

    def told(self) -> dict[str, list[Any]]:
        """Return what Bullet is told of them."""
        count = range(len(self._rows))
        inertial = [self.inertial.get(link, (0.0, _POSES.IDENTITY)) for link in count]
        return {
            "linkMasses": [mass for mass, _ in inertial],
            "linkCollisionShapeIndices": [self.shapes.get(link, -1) for link in count],
            "linkVisualShapeIndices": [-1 for _ in count],
            "linkPositions": [list(place[0]) for _, place, _, _ in self._rows],
            "linkOrientations": [_bullets(place[1]) for _, place, _, _ in self._rows],
            "linkInertialFramePositions": [list(place[0]) for _, place in inertial],
            "linkInertialFrameOrientations": [_bullets(place[1]) for _, place in inertial],
            "linkParentIndices": [parent + 1 for parent, *_ in self._rows],
            "linkJointTypes": [kind for _, _, kind, _ in self._rows],
            "linkJointAxis": [list(axis) for *_, axis in self._rows],
        }


def _bullets(turn: np.ndarray) -> list[float]:
    """Return a quaternion with its scalar last."""
    return np.roll(turn, -1).tolist()


def _mujocos(turn: Any) -> np.ndarray:
    return np.roll(turn, 1)
