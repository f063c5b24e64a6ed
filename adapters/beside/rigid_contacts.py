"""Rigid contacts of a model, as the adapters of engines that have such take them.

A pair of geoms has the friction that MuJoCo mixes for it, and the restitution that the closed form
of its solref has, whose spring only pushes: for damping ratios zeta below 1 it is
`exp(-2 zeta acos(zeta) / sqrt(1 - zeta^2))`, and `exp(-2)` at 1. Softness is left out.
"""

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import mujoco
import numpy as np

IGNORED = (
    dict.fromkeys(("solimp", "impratio", "cone", "elliptic", "refsafe"), "its contacts are rigid")
    | dict.fromkeys(
        ("solver", "iterations", "tolerance", "jacobian", "noslip", "noslip_iterations",
         "warmstart", "ls_iterations", "ls_tolerance"), "it has a solver of its own",
    )
    | dict.fromkeys(("integrator", "eulerdamp"), "it has a scheme of its own")
)  # fmt: skip
BOUNCES_FROM = 0.1
"""Speed of approach [m/s] below which nothing bounces: else what rests would bounce for ever."""
PLANE, SPHERE, CAPSULE, CYLINDER, BOX, MESH = (
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}"))
    for name in ("PLANE", "SPHERE", "CAPSULE", "CYLINDER", "BOX", "MESH")
)
_SHAPES = (PLANE, SPHERE, CAPSULE, CYLINDER, BOX, MESH)
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_OFF = mujoco.mjtDisableBit
_LEAST = 1e-15  # mixing weight, as in MuJoCo
_EXACT = 1e-9  # of a friction, that numbers of the geoms are to give
NO_NUMBERS = "it combines what two geoms have, and no numbers of theirs give what these pairs mix"
_OVERLOOKED = 1e-3  # overlap [m] in which an engine cannot but find a contact


class Pair(NamedTuple):
    """What two geoms that may touch do to each other."""

    friction: float
    torsion: float  # torque about the normal over the normal force [m]
    rolling: float  # torque across the normal over the normal force [m]
    restitution: float
    solref: tuple[float, float]
    solimp: tuple[float, ...]  # (5,)


class Contact(NamedTuple):
    """A contact in a step of an engine, between geoms in ascending order."""

    geoms: tuple[int, int]
    force: np.ndarray  # (3,) in the world, on the second geom [N]
    position: np.ndarray  # (3,) [m]
    normal: np.ndarray  # (3,) from the first geom to the second
    distance: float  # negative where they overlap [m]

    @classmethod
    def of(cls, first: int, second: int, *rest: Any) -> "Contact":
        """Return a contact of two geoms in either order, told of the order given."""
        force, position, normal, distance = rest
        force, position, normal = (np.array(each) for each in (force, position, normal))
        sign = 1 if first < second else -1
        geoms = min(first, second), max(first, second)
        return cls(geoms, sign * force, position, sign * normal, float(distance))


def refusals(model: mujoco.MjModel) -> list[tuple[Any, str]]:
    """Return what rigid contacts cannot be, each with whether a model needs it."""
    pairs = pairs_of(model)
    touching = sorted({geom for pair in pairs for geom in pair})
    free = np.repeat(model.jnt_type == _FREE, _dofs(model))
    given = model.pair_friction
    return [
        (
            not np.isin(model.geom_type[touching], _SHAPES).all(),
            "its shapes are planes, spheres, capsules, cylinders, boxes and convex hulls",
        ),
        (
            pairs and (model.geom_margin[touching].any() or model.pair_margin.any()),
            "it knows no margin of contacts; set margin to 0",
        ),
        (
            (given[:, [0, 3]] != given[:, [1, 4]]).any(),
            "its friction is alike in all directions; give a pair one coefficient for both",
        ),
        (model.nmocap, "it moves no mocap bodies here; take a slide with a servo"),
        (
            model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE,
            "it knows no override of contacts; turn that off",
        ),
        (
            model.dof_damping[free].any() or model.dof_frictionloss[free].any(),
            "it knows no damping and no dry friction of free joints here",
        ),
    ]


def _dofs(model: mujoco.MjModel) -> np.ndarray:
    """Return (njnt,) degrees of freedom of each joint."""
    return np.diff([*model.jnt_dofadr, model.nv])


def pairs_of(model: mujoco.MjModel) -> dict[tuple[int, int], Pair]:
    """Return the pairs of geoms that may touch, in ascending order, by MuJoCo's rules."""
    if model.opt.disableflags & (_OFF.mjDSBL_CONTACT | _OFF.mjDSBL_CONSTRAINT):
        return {}
    count = model.ngeom
    found = {
        (one, other): _mixed(model, one, other)
        for one in range(count)
        for other in range(one + 1, count)
        if _may_touch(model, one, other)
    }
    for each in range(model.npair):
        one, other = sorted((int(model.pair_geom1[each]), int(model.pair_geom2[each])))
        friction = model.pair_friction[each, [0, 2, 3]]
        springs = model.pair_solref[each], model.pair_solimp[each]
        found[one, other] = _pair(int(model.pair_dim[each]), friction, *springs)
    return found


def _may_touch(model: mujoco.MjModel, one: int, other: int) -> bool:
    kinds, masks = model.geom_contype, model.geom_conaffinity
    if not (kinds[one] & masks[other] or kinds[other] & masks[one]):
        return False
    first, second = sorted((int(model.geom_bodyid[one]), int(model.geom_bodyid[other])))
    if (first << 16) + second in model.exclude_signature:
        return False
    ends = [int(model.body_weldid[body]) for body in (first, second)]
    parents = [int(model.body_weldid[model.body_parentid[end]]) for end in ends]
    related = all(ends) and (ends[0] == parents[1] or ends[1] == parents[0])
    filtered = related and not model.opt.disableflags & _OFF.mjDSBL_FILTERPARENT
    return ends[0] != ends[1] and not filtered


def _mixed(model: mujoco.MjModel, one: int, other: int) -> Pair:
    """Return what MuJoCo mixes for two geoms: the one of higher priority decides, or both."""
    priority = model.geom_priority
    if priority[one] != priority[other]:
        decides = one if priority[one] > priority[other] else other
        dimensions, friction = model.geom_condim[decides], model.geom_friction[decides]
        return _pair(
            int(dimensions), friction, model.geom_solref[decides], model.geom_solimp[decides]
        )
    both, weights = [one, other], model.geom_solmix[[one, other]]
    weights = weights * (weights >= _LEAST)
    weights = weights / weights.sum() if weights.any() else np.full(2, 0.5)
    solref = model.geom_solref[both]
    mixed = weights @ solref if (solref[:, 0] > 0).all() else solref.min(axis=0)
    dimensions, friction = model.geom_condim[both].max(), model.geom_friction[both].max(axis=0)
    return _pair(int(dimensions), friction, mixed, weights @ model.geom_solimp[both])


def _pair(dimensions: int, friction: np.ndarray, solref: np.ndarray, solimp: np.ndarray) -> Pair:
    sliding, torsion, rolling = friction.tolist()
    return Pair(
        sliding * (dimensions > 1), torsion * (dimensions > 3), rolling * (dimensions > 4),
        restitution_of(*solref.tolist()), tuple(solref.tolist()), tuple(solimp.tolist()),
    )  # fmt: skip


def masks_of(model: mujoco.MjModel) -> dict[int, tuple[int, int]]:
    """Return by geom the bit of its sort, and those of the sorts that it touches.

    Geoms that touch the same others are of one sort, whether or not they touch each other.
    """
    partners: dict[int, set[int]] = {}
    for one, other in pairs_of(model):
        partners.setdefault(one, set()).add(other)
        partners.setdefault(other, set()).add(one)
    closed = {geom: frozenset({geom, *its}) for geom, its in partners.items()}
    among = Counter(closed.values())
    keys = {
        geom: closed[geom] if among[closed[geom]] > 1 else frozenset(its)
        for geom, its in partners.items()
    }
    bits = {key: 1 << number for number, key in enumerate(dict.fromkeys(keys.values()))}
    return {
        geom: (bits[keys[geom]], sum({bits[keys[other]] for other in its}))
        for geom, its in partners.items()
    }


def sorts_of(model: mujoco.MjModel) -> int:
    """Return how many sorts of geoms `masks_of` tells apart."""
    return len({own for own, _ in masks_of(model).values()})


def hull_of(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return (n, 3) the corners of the convex hull of a mesh, in the geom's frame."""
    mesh = int(model.geom_dataid[geom])
    first, graph = int(model.mesh_vertadr[mesh]), int(model.mesh_graphadr[mesh])
    count = int(model.mesh_vertnum[mesh])
    vertices = model.mesh_vert[first : first + count].astype(float)
    if graph < 0:
        return vertices
    # Of the hull: its counts of corners and faces, where each corner's edges begin, its number.
    corners = int(model.mesh_graph[graph])
    return vertices[model.mesh_graph[graph + 2 + corners : graph + 2 + 2 * corners]]


def restitution_of(first: float, second: float) -> float:
    """Return the ratio of rebound to approach speed of a solref; 0 where nothing springs back."""
    zeta = second if first > 0 else -second / (2 * math.sqrt(-first)) if first else math.inf
    if zeta == 1:
        return math.exp(-2)
    if zeta < 1:
        return math.exp(-2 * zeta * math.acos(zeta) / math.sqrt(1 - zeta**2))
    slope = math.sqrt(1 - zeta**-2)
    return math.exp(-2 * math.acosh(zeta) / slope) if math.isfinite(zeta) else 0.0


def as_products(wanted: Mapping[tuple[int, int], float]) -> dict[int, float]:
    """Return a number for each geom, of which the products are what pairs of them want.

    A ValueError says that there are none. Geoms of pairs that want 0 alone have none.
    """
    geoms, matrix = incidence_of([pair for pair, value in wanted.items() if value])
    logs = np.log([value for value in wanted.values() if value])
    found = np.exp(np.linalg.lstsq(matrix, logs, rcond=None)[0]) if geoms else np.zeros(0)
    told = dict(zip(geoms, found.tolist(), strict=True))
    for (one, other), value in wanted.items():
        if abs(told.get(one, 0.0) * told.get(other, 0.0) - value) > _EXACT:
            raise ValueError(NO_NUMBERS)
    return told


def as_sums(wanted: Mapping[tuple[int, int], float]) -> dict[int, float]:
    """Return a number for each geom, at least 0, of which the sums are what pairs of them want.

    A ValueError says that there are none.
    """
    from scipy.optimize import nnls  # commands that list engines do not load it

    geoms, matrix = incidence_of(list(wanted))
    found, rest = nnls(matrix, list(wanted.values())) if geoms else (np.zeros(0), 0.0)
    if rest > _EXACT:
        raise ValueError(NO_NUMBERS)
    return dict(zip(geoms, found.tolist(), strict=True))


def incidence_of(pairs: Sequence[tuple[int, int]]) -> tuple[list[int], np.ndarray]:
    """Return the geoms of pairs, and (pairs, geoms) which of them each has."""
    geoms = sorted({geom for pair in pairs for geom in pair})
    return geoms, np.array([[float(geom in pair) for geom in geoms] for pair in pairs])


def check_contacts(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    contacts: Sequence[Contact],
    pairs: Mapping[Any, Any],
) -> None:
    """Raise a ValueError where an engine has contacts that it must not have, or lacks one.

    The data is of the state in which the engine found them.
    """
    found = {contact.geoms for contact in contacts}
    for one, other in sorted(found - pairs.keys()):
        raise ValueError(
            f"{_geom(model, one)} and {_geom(model, other)} touch, which the model filters"
        )
    for contact in data.contact[: data.ncon]:
        both = tuple(sorted(contact.geom.tolist()))
        least = 0.1 * min(model.geom_rbound[geom] or math.inf for geom in both)
        if contact.dist < -min(_OVERLOOKED, least) and both not in found:
            first, second = (_geom(model, geom) for geom in both)
            raise ValueError(f"{first} and {second} overlap by {-contact.dist:g} m without contact")


def _geom(model: mujoco.MjModel, geom: int) -> str:
    return f"geom '{model.geom(geom).name or geom}'"


_FULL, _NEAREST = 23, 2  # numbers of a slot that has all fields, or found and distance alone


class World(Protocol):
    """A model as an engine has it."""

    def set(self, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Set its state, as MuJoCo has it."""

    def drive(self, state: np.ndarray, control: np.ndarray, applied: np.ndarray) -> None:
        """Apply the inputs of the next step, which starts in a state."""

    def step(self) -> None:
        """Make a step."""

    def contacts(self) -> list[Any]:
        """Return the contacts of the last step."""

    def state(self) -> np.ndarray:
        """Return positions and velocities, as MuJoCo has them."""


def simulated(
    request: dict[str, Any],
    world_of: Callable[[mujoco.MjModel], World],
    tick: Callable[[], None],
) -> dict[str, Any]:
    """Simulate runs one after the other, each in a world of its own; the cost is of steps alone."""
    import serve

    def run(request: dict[str, Any], run: int, tick: Callable[[], None]) -> dict[str, Any]:
        model = serve.model_of(request, run)
        controls, applied, _ = serve.inputs_of(request, run, model)
        world = world_of(model)
        world.set(request["qpos"][run], request["qvel"][run])
        states = [np.concatenate([request["qpos"][run], request["qvel"][run]])]
        contacts, cost = [], 0.0
        for control, forces in zip(controls, applied, strict=True):
            world.drive(states[-1], control, forces)
            begin = time.process_time()
            world.step()
            cost += time.process_time() - begin
            contacts.append(world.contacts())
            states.append(world.state())
        tick()
        state = np.array(states)
        sensors = measured(model, state, controls, contacts)
        return {"state": state, "sensors": sensors, "cost": cost}

    return {name: np.array(rows) for name, rows in serve.of_each(request, run, tick).items()}


def measured(
    model: mujoco.MjModel,
    state: np.ndarray,
    controls: np.ndarray,
    contacts: Sequence[Sequence[Contact]],
) -> np.ndarray:
    """Return (N, nsensordata) what sensors measure in states before N steps, contacts the engine's.

    All that is not of contacts is MuJoCo's measure of the engine's states. A ValueError says that
    a pair of geoms touches, or does not, other than the model says.
    """
    data, sensors = mujoco.MjData(model), np.zeros((len(controls), model.nsensordata))
    pairs, slots = pairs_of(model), _contact_sensors(model)
    for row, control in enumerate(controls):
        data.qpos[:], data.qvel[:], _ = np.split(state[row], [model.nq, model.nq + model.nv])
        data.ctrl[:] = control
        mujoco.mj_forward(model, data)
        check_contacts(model, data, contacts[row], pairs)
        sensors[row] = data.sensordata
        for sensor, sides in slots:
            place = int(model.sensor_adr[sensor])
            told = sensors[row, place : place + int(model.sensor_dim[sensor])]
            told[:] = 0
            if sides is None:
                told[:] = (
                    len(contacts[row]),
                    min((contact.distance for contact in contacts[row]), default=0.0),
                )
            else:
                _fill(model, data, told.reshape(-1, _FULL), contacts[row], sides)
    return sensors


def _contact_sensors(model: mujoco.MjModel) -> list[tuple[int, Any]]:
    """Return sensors of contacts, with the geoms of both sides; None of those that only count."""
    kind, body = int(mujoco.mjtSensor.mjSENS_CONTACT), int(mujoco.mjtObj.mjOBJ_BODY)
    found: list[tuple[int, Any]] = []
    for sensor in np.flatnonzero(model.sensor_type == kind).tolist():
        ends = [
            (model.sensor_objtype[sensor], int(model.sensor_objid[sensor])),
            (model.sensor_reftype[sensor], int(model.sensor_refid[sensor])),
        ]
        if model.sensor_dim[sensor] == _NEAREST:
            found.append((sensor, None))
        elif model.sensor_dim[sensor] % _FULL == 0:
            sides = [
                set(np.flatnonzero(model.geom_bodyid == each).tolist()) if of == body else {each}
                for of, each in ends
            ]
            found.append((sensor, sides))
    return found


def _fill(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    slots: np.ndarray,
    contacts: Sequence[Contact],
    sides: Sequence[set[int]],
) -> None:
    """Fill slots (S, 23) with the contacts between two sides, those that press most."""
    ours: list[tuple[Contact, int]] = []
    for contact in contacts:
        one, other = contact.geoms
        for first, second, sign in ((one, other, 1), (other, one, -1)):
            if first in sides[0] and second in sides[1]:
                ours.append((contact, sign))
    ours.sort(key=lambda each: -float(np.abs(each[0].force @ each[0].normal)))
    for slot, (contact, sign) in zip(slots, ours, strict=False):
        normal = sign * contact.normal / np.linalg.norm(contact.normal)
        tangent = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        tangent /= np.linalg.norm(tangent)
        frame = np.array([normal, tangent, np.cross(normal, tangent)])
        moving = [
            _velocity(model, data, int(model.geom_bodyid[geom]), contact.position)
            for geom in contact.geoms
        ]
        linear, angular = np.split(sign * (moving[1] - moving[0]), 2)
        force = frame @ (sign * contact.force)
        slot[:8] = [len(ours), *force, 0, 0, 0, contact.distance]
        slot[8:] = [*contact.position, *normal, *tangent, *(frame @ linear), *(frame @ angular)]


def _velocity(
    model: mujoco.MjModel, data: mujoco.MjData, body: int, point: np.ndarray
) -> np.ndarray:
    """Return (6,) the velocity of a body's point in the world, and its spin."""
    told = np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, told, 0)
    spin, linear = np.split(told, 2)
    return np.concatenate([linear + np.cross(spin, point - data.xipos[body]), spin])
