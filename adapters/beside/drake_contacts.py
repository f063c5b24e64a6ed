"""Free bodies in contact, as Drake's adapter simulates them."""

import math
from itertools import combinations
from pathlib import Path
from runpy import run_path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np

_RIGID, _JOINTS, _ARRIVALS = (
    SimpleNamespace(**run_path(str(Path(__file__).parent / name)))
    for name in ("rigid_contacts.py", "joints.py", "arrivals.py")
)
_MODULUS = 1e6  # of boxes [Pa]: one of 10 cm and 1 kg sinks by 50 um
_FREE, _PLANE, _SPHERE, _BOX = (
    int(mujoco.mjtJoint.mjJNT_FREE),
    int(mujoco.mjtGeom.mjGEOM_PLANE),
    int(mujoco.mjtGeom.mjGEOM_SPHERE),
    int(mujoco.mjtGeom.mjGEOM_BOX),
)

_FREE_ALONE = (
    "its contacts are of free bodies in no medium; take a model without joints, welds, actuators, "
    "pairs and exclusions, or set contact to false"
)
_ONE_FRICTION = (
    "it combines friction otherwise, and all its shapes collide; give geoms one friction, no "
    "margin, and leave contype and conaffinity"
)


def refusal(model: mujoco.MjModel) -> str | None:
    """Return why it cannot simulate a model; None if it can."""
    return next((why for applies, why in _refusals(model) if applies), None)


def _refusals(model: mujoco.MjModel) -> list[tuple[Any, str]]:
    """Return what it cannot do of contacts, each with whether a model needs it."""
    moves, kinds = model.body_weldid[model.geom_bodyid] > 0, model.geom_type
    balls, boxes = moves & (kinds == _SPHERE), moves & (kinds == _BOX)
    plain = (model.geom_contype & 1) & (model.geom_conaffinity & 1)
    beside = (model.nu, model.ntendon, model.neq, model.nflex, model.nplugin, model.npair,
              model.nexclude, model.nmocap)  # fmt: skip
    medium = model.opt.density or model.opt.viscosity or model.body_gravcomp.any()
    welded = (model.body_weldid > 0) & (model.body_weldid != np.arange(model.nbody))
    several = (model.geom_condim > 3).any()
    frictions = model.geom_friction[:, 0] * (model.geom_condim > 1)
    default = (model.geom_solref[boxes] == (0.02, 1)).all()
    return [
        (
            model.opt.integrator != mujoco.mjtIntegrator.mjINT_EULER,
            "it integrates as MuJoCo's Euler does; set integrator to Euler",
        ),
        (
            (model.jnt_type != _FREE).any() or welded.any() or any(beside) or medium,
            _FREE_ALONE,
        ),
        (
            model.dof_damping.any() or model.dof_armature.any() or model.dof_frictionloss.any(),
            "its free joints have no damping, armature and dry friction",
        ),
        (
            not (np.isin(kinds[~moves], (_PLANE, _BOX)).all() and (balls | boxes)[moves].all()),
            "contacts are of one ball or of boxes, above fixed planes and boxes",
        ),
        (
            balls.any() and (balls.sum() > 1 or boxes.any() or (kinds[~moves] != _PLANE).any()),
            "a ball is alone above planes: its damping would count twice elsewhere",
        ),
        (
            np.ptp(frictions) > 0 or not plain.all() or model.geom_margin.any(),
            _ONE_FRICTION,
        ),
        (several, "it has friction against sliding alone; set condim to 3"),
        (not default, f"its boxes press by an elasticity of {_MODULUS:g} Pa; leave solref"),
    ]


class Contacts:
    """Free bodies above what is fixed, as Drake has them, stepped or, without a step, continuous.

    A ball is a point contact, with the stiffness of its solref times its mass; stepped it is by
    SAP, with the damping of solref likewise. Continuous it is damped by Hunt and Crossley's law, so
    that what comes at 1 m/s leaves with the restitution of its solref. Boxes are hydroelastic, of
    one modulus, and stepped lagged: by SAP what slides fast glides above the floor. On both presses
    all of gravity, not the share that solimp leaves.
    """

    def __init__(self, model: mujoco.MjModel, timestep: float) -> None:
        from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
        from pydrake.systems.framework import DiagramBuilder

        self._model, self._builder, self._stepped = model, DiagramBuilder(), timestep > 0
        self._ball = bool((model.geom_type == _SPHERE).any())
        config = MultibodyPlantConfig(
            time_step=timestep,
            discrete_contact_approximation="sap" if self._ball else "lagged",
            contact_model="point" if self._ball else "hydroelastic",
            sap_near_rigid_threshold=0.0,
        )
        self._plant, scene_graph = AddMultibodyPlant(config, self._builder)
        self._plant.mutable_gravity_field().set_gravity_vector(_JOINTS.gravity_of(model))
        self._bodies = {int(body): self._body(int(body)) for body in model.jnt_bodyid}
        self._geoms = {self._shape(geom): geom for geom in range(model.ngeom)}
        if self._stepped:
            self._plant.SetUseSampledOutputPorts(False)
        self._plant.Finalize()
        self.diagram = self._builder.Build()
        self.root = self.diagram.CreateDefaultContext()
        self._context = self._plant.GetMyMutableContextFromRoot(self.root)
        self._forces: list[dict[tuple[int, int], np.ndarray]] = []
        self._check_bodies()
        self._check_shapes(scene_graph.model_inspector())

    def _body(self, body: int) -> Any:
        from pydrake.multibody.tree import RotationalInertia, SpatialInertia

        model, turn = self._model, np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.body_iquat[body])
        turn = turn.reshape(3, 3)
        inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
        rotational = RotationalInertia(*np.diag(inertia), *inertia[[0, 0, 1], [1, 2, 2]])
        mass, centre = float(model.body_mass[body]), model.body_ipos[body]
        whole = SpatialInertia.MakeFromCentralInertia(mass, centre, rotational)
        return self._plant.AddRigidBody(f"body_{body}", whole)

    def _shape(self, geom: int) -> Any:
        from pydrake.geometry import Box, HalfSpace, Sphere

        model = self._model
        body, kind = int(model.geom_bodyid[geom]), model.geom_type[geom]
        place = _transform(model.geom_pos[geom], model.geom_quat[geom])
        while body not in self._bodies and body:
            place = _transform(model.body_pos[body], model.body_quat[body]) @ place
            body = int(model.body_parentid[body])
        size = model.geom_size[geom]
        shapes = {_PLANE: HalfSpace, _SPHERE: Sphere, _BOX: Box}
        sizes = {_PLANE: (), _SPHERE: (size[0],), _BOX: 2 * size}
        return self._plant.RegisterCollisionGeometry(
            self._bodies.get(body, self._plant.world_body()),
            place,
            shapes[kind](*sizes[kind]),
            f"geom_{geom}",
            self._properties(geom, body),
        )

    def _properties(self, geom: int, body: int) -> Any:
        """Return what a contact is made of: MuJoCo's spring for a ball, one modulus for boxes."""
        from pydrake import geometry
        from pydrake.multibody.plant import CoulombFriction

        model, made = self._model, geometry.ProximityProperties()
        friction = float(model.geom_friction[geom, 0] * (model.geom_condim[geom] > 1))
        stiffness, damping = _spring(model, geom)
        # Two in series: what does not give leaves the other's.
        given = model.body_mass[body] * stiffness if body in self._bodies else 1e30
        point = {"point_stiffness": given} if self._ball else {}
        if self._ball and not self._stepped:
            point["dissipation"] = dissipation(_RIGID.restitution_of(-stiffness, -damping))
        coulomb = CoulombFriction(friction, friction)
        geometry.AddContactMaterial(properties=made, friction=coulomb, **point)
        if self._ball:
            relaxation = damping / stiffness if self._stepped and body in self._bodies else 0.0
            made.AddProperty("material", "relaxation_time", relaxation)
        elif body in self._bodies:
            geometry.AddCompliantHydroelasticProperties(
                float(model.geom_size[geom].min()), _MODULUS, made
            )
        else:
            geometry.AddRigidHydroelasticProperties(float(model.geom_size[geom].max() or 1), made)
        return made

    def _check_bodies(self) -> None:
        """Raise a ValueError unless masses, inertias and gravity arrived as they were sent."""
        model, data = self._model, mujoco.MjData(self._model)
        data.qpos[model.jnt_qposadr[:, None] + np.arange(3, 7)] = (1, 0, 0, 0)
        mujoco.mj_forward(model, data)
        whole = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, whole)
        sent = [whole[dof : dof + 6, dof : dof + 6] for dof in model.jnt_dofadr]
        told = [each.CalcSpatialInertiaInBodyFrame(self._context) for each in self._bodies.values()]
        # Drake's has turns first, MuJoCo's places.
        arrived = [np.roll(each.CopyToFullMatrix6(), 3, (0, 1)) for each in told]
        names = [f"body '{model.body(body).name or body}'" for body in self._bodies]
        masses = [each.get_mass() for each in told]
        _ARRIVALS.compare("the mass", model.body_mass[[*self._bodies]], masses, names)
        _ARRIVALS.compare("the inertia", sent, arrived, names)
        gravity = self._plant.gravity_field().gravity_vector()
        _ARRIVALS.compare("the acceleration", _JOINTS.gravity_of(model), gravity, ["gravity"])

    def _check_shapes(self, inspector: Any) -> None:
        """Raise a ValueError unless sizes, frictions and what may touch arrived as they were sent.

        Of two frictions Drake takes the harmonic mean.
        """
        model, ids = self._model, {geom: each for each, geom in self._geoms.items()}
        names = {geom: f"geom '{model.geom(geom).name or geom}'" for geom in ids}
        solid = [geom for geom in ids if model.geom_type[geom] != _PLANE]
        shapes = [inspector.GetShape(ids[geom]) for geom in solid]
        sizes = [
            [each.radius(), 0, 0] if hasattr(each, "radius") else each.size() / 2 for each in shapes
        ]
        solid_names = [names[geom] for geom in solid]
        _ARRIVALS.compare("the size", model.geom_size[solid], sizes, solid_names)
        pairs = _RIGID.pairs_of(model)
        for one, other in combinations(sorted(ids), 2):
            if inspector.CollisionFiltered(ids[one], ids[other]) == ((one, other) in pairs):
                raise ValueError(f"{names[one]} and {names[other]} are filtered otherwise")
        surfaces = {
            geom: inspector.GetProximityProperties(each)
            .GetProperty("material", "coulomb_friction")
            .static_friction()
            for geom, each in ids.items()
        }
        means = [
            2 * surfaces[one] * surfaces[other] / ((surfaces[one] + surfaces[other]) or 1)
            for one, other in pairs
        ]
        between = [f"{names[one]} and {names[other]}" for one, other in pairs]
        sent = [pair.friction for pair in pairs.values()]
        _ARRIVALS.compare("the friction", sent, means, between)

    def step(
        self, qpos: np.ndarray, qvel: np.ndarray, applied: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return coordinates and velocities one step later, under forces (nbody, 6) on bodies.

        It keeps the contact forces of the step.
        """
        self.apply(applied)
        self.put(qpos, qvel)
        plant, context = self._plant, self._context
        after = plant.EvalUniquePeriodicDiscreteUpdate(context).get_vector(0).get_value().copy()
        self._forces.append(self._pressed())
        plant.SetPositionsAndVelocities(context, after)
        return self._told(qpos)

    def own(self, root: Any) -> np.ndarray:
        """Return the state of a context as Drake has it."""
        return self._plant.GetPositionsAndVelocities(self._plant.GetMyContextFromRoot(root)).copy()

    def rates(self, own: np.ndarray) -> np.ndarray:
        """Return how the coordinates of a state of Drake's change [1/s]."""
        self._plant.SetPositionsAndVelocities(self._context, own)
        return self._plant.MapVelocityToQDot(self._context, own[self._plant.num_positions() :])

    def put(self, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Set coordinates and velocities."""
        from pydrake.multibody.math import SpatialVelocity

        model, plant, context = self._model, self._plant, self._context
        for joint, body in enumerate(self._bodies.values()):
            q, v = qpos[model.jnt_qposadr[joint] :][:7], qvel[model.jnt_dofadr[joint] :][:6]
            pose = _transform(q[:3], q[3:])
            plant.SetFreeBodyPose(context, body, pose)
            spin = pose.rotation().matrix() @ v[3:]
            plant.SetFreeBodySpatialVelocity(body, SpatialVelocity(spin, v[:3]), context)

    def take(self, own: np.ndarray, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Set a state as Drake has it, keep its contact forces, and return it as MuJoCo does.

        Of the two quaternions of a turn it is the one nearer to those of `qpos`.
        """
        self._plant.SetPositionsAndVelocities(self._context, own)
        self._forces.append(self._pressed())
        return self._told(qpos)

    def _told(self, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return coordinates, with the quaternions nearer to these, and velocities."""
        model, plant, context = self._model, self._plant, self._context
        qpos, qvel = qpos.copy(), np.zeros(model.nv)
        for joint, body in enumerate(self._bodies.values()):
            place, dof = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
            pose = plant.EvalBodyPoseInWorld(context, body)
            velocity = plant.EvalBodySpatialVelocityInWorld(context, body)
            turn = pose.rotation().ToQuaternion().wxyz()
            same = float(np.dot(turn, qpos[place + 3 : place + 7])) >= 0
            qpos[place : place + 7] = [*pose.translation(), *(turn if same else -turn)]
            spin = pose.rotation().matrix().T @ velocity.rotational()
            qvel[dof : dof + 6] = [*velocity.translational(), *spin]
        return qpos, qvel

    def apply(self, applied: np.ndarray) -> None:
        """Apply force and torque at the centre of mass of each body, in the world, as MuJoCo."""
        from pydrake.common.value import Value
        from pydrake.multibody.math import SpatialForce
        from pydrake.multibody.plant import ExternallyAppliedSpatialForce

        given: list[Any] = []
        for number, body in self._bodies.items():
            each = ExternallyAppliedSpatialForce()
            each.body_index, each.p_BoBq_B = body.index(), self._model.body_ipos[number]
            each.F_Bq_W = SpatialForce(applied[number, 3:], applied[number, :3])
            given.append(each)
        port = self._plant.get_applied_spatial_force_input_port()
        port.FixValue(self._context, Value[list[ExternallyAppliedSpatialForce]](given))

    def _pressed(self) -> dict[tuple[int, int], np.ndarray]:
        """Return the force (3,) in the world on the second geom of each pair that touches."""
        results = self._plant.get_contact_results_output_port().Eval(self._context)
        found: dict[tuple[int, int], np.ndarray] = {}
        for each in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(each)
            pair = info.point_pair()
            found[self._geoms[pair.id_A], self._geoms[pair.id_B]] = info.contact_force()
        for each in range(results.num_hydroelastic_contacts()):
            info = results.hydroelastic_contact_info(each)
            surface, force = info.contact_surface(), info.F_Ac_W().translational()
            found[self._geoms[surface.id_N()], self._geoms[surface.id_M()]] = force
        return found | {(b, a): -force for (a, b), force in found.items()}

    def measured(self, state: np.ndarray, controls: np.ndarray) -> np.ndarray:
        """Return what MuJoCo's sensors measure in Drake's states, contact forces being Drake's.

        A pair's force is shared by the contacts that MuJoCo finds there, in equal parts.
        """
        import serve

        model, sensors = self._model, serve.measured(self._model, state, controls)
        slot = 23  # found, force, torque, dist, pos, normal, tangent, linvel, angvel
        for each in np.flatnonzero(model.sensor_dim % slot == 0):
            pair = int(model.sensor_objid[each]), int(model.sensor_refid[each])
            first, count = model.sensor_adr[each], model.sensor_dim[each] // slot
            rows = sensors[:, first : first + count * slot].reshape(len(sensors), count, slot)
            for row, forces in zip(rows, self._forces[: len(rows)], strict=True):
                acting = row[:, 0] > 0
                share = forces.get(pair, np.zeros(3)) / max(1, acting.sum())
                for contact in np.flatnonzero(acting):
                    normal, tangent = row[contact, 11:14], row[contact, 14:17]
                    row[contact, 1:4] = (
                        np.array([normal, tangent, np.cross(normal, tangent)]) @ share
                    )
                    row[contact, 4:7] = 0
        return sensors


def dissipation(restitution: float) -> float:
    """Return Hunt and Crossley's [s/m] by which what comes at v = 1 m/s leaves with e of it.

    A spring of any stiffness with force k x (1 + d x') takes as much of the speed as
    d v (1 + e) = log((1 + d v) / (1 - d e v)) says.
    """
    if restitution >= 1:
        return 0.0
    low, high = 0.0, 1 / restitution
    for _ in range(60):
        middle = (low + high) / 2
        loss = math.log1p(middle) - math.log1p(-middle * restitution)
        low, high = (low, middle) if loss > middle * (1 + restitution) else (middle, high)
    return low


def _spring(model: mujoco.MjModel, geom: int) -> tuple[float, float]:
    """Return stiffness [1/s^2] and damping [1/s] of a geom's solref, at full impedance."""
    first, second = model.geom_solref[geom].tolist()
    if first <= 0:
        return -first, -second
    if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE:
        first = max(first, 2 * model.opt.timestep)
    return (first * second) ** -2, 2 / first


def _transform(place: np.ndarray, turn: np.ndarray) -> Any:
    from pydrake.common.eigen_geometry import Quaternion
    from pydrake.math import RigidTransform

    return RigidTransform(Quaternion(turn / np.linalg.norm(turn)), place)
