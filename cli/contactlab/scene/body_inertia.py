"""Rules that the mass and inertia of every physical body obey, and where a model violates them.

For a body of mass m and principal moments A <= B <= C about its center of mass:

* A > 0 and A + B >= C, since moments are integrals of squared distances;
* m over the volume of its geoms is the density of some material;
* (A + B + C) / 2 minus one moment is m times the mean square distance from the plane normal to
  that moment's axis, which in a shape of length L is at most (L / 2)^2 (Popoviciu's inequality);
* (A + B + C) / 2 is m times the mean square distance from the center, smallest for a ball, and at
  most that of the farthest point of the machine.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import mujoco
import numpy as np

from contactlab.contact.rotations import rotation_matrices
from contactlab.contact.trace_arrays import Floats
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.scene.compile_model import (
    InertiaFault,
    nonpositive_inertia_fault,
    read_spec,
    satisfies_triangle,
    triangle_inertia_fault,
    written_inertia_faults,
)
from contactlab.scene.scene_source import SceneSource

IMPOSSIBLE = ("not_positive", "triangle", "balanced", "beyond")
"""Faults of an inertia itself, or beyond the machine; others compare it with simplified shapes."""

LIGHTEST, DENSEST = 50.0, 20000.0
"""Densities [kg/m^3] from foam and hollow shells to osmium, rounded."""
_SLACK = 2.0  # rms distances may exceed those that fit into a shape by this factor


def in_words(faults: Iterable[InertiaFault]) -> Iterator[str]:
    """Yield faults in words; bodies beyond the same limit are listed by name after the first."""
    alike: dict[tuple[str, float], list[InertiaFault]] = {}
    for fault in faults:
        alike.setdefault((fault.kind, fault.limit), []).append(fault)
    most_named = 6
    for first, *others in alike.values():
        bodies = [f"'{other.body}'" for other in others]
        more = [f"{len(bodies) - most_named} more"] if len(bodies) > most_named else []
        likewise = f"; likewise {', '.join([*bodies[:most_named], *more])}" if bodies else ""
        yield f"body '{first.body}': {first.reason}{likewise}"


def density_faults(model: mujoco.MjModel, body: int) -> Iterator[InertiaFault]:
    """Yield a fault if no material has the density of a body's geoms."""
    space, mass = (
        sum(geom_volume(model, geom) for geom in solid_geoms(model, body)),
        _body_mass(model, body),
    )
    density = mass / space if space else LIGHTEST
    if LIGHTEST <= density <= DENSEST:
        return
    light = density < LIGHTEST
    limit, words = (LIGHTEST, "lighter than foam") if light else (DENSEST, "denser than any metal")
    reason = (
        f"its mass of {mass:g} kg in the {space:.3g} m^3 of its geoms makes "
        f"{density:.3g} kg/m^3, {words} ({limit:g})"
    )
    yield InertiaFault(model.body(body).name, "density", density, limit, "kg/m^3", reason)


def shape_faults(model: mujoco.MjModel, body: int) -> Iterator[InertiaFault]:
    """Yield faults if the mass of a body would lie outside its shape, or in a tiny part of it."""
    name, moments, mass = model.body(body).name, model.body_inertia[body], _body_mass(model, body)
    spreads = np.sqrt(np.maximum(moments.sum() / 2 - moments, 0) / mass)
    length = 0.0
    if solid_geoms(model, body):
        axes = rotation_matrices(model.body_iquat[[body]])[0]
        # The extents of the body's geoms along the axes [m]: (3, 2).
        own = np.isin(model.geom_type, list(_SOLIDS)) & (model.geom_bodyid == body)
        geoms: list[int] = np.flatnonzero(own).tolist()
        each = np.array([[_shape_span(model, geom, axis) for axis in axes.T] for geom in geoms])
        spans = np.stack([each[..., 0].min(axis=0), each[..., 1].max(axis=0)], axis=1)
        lengths = np.ptp(spans, axis=1)
        length = float(lengths.max())

        # Shapes are simplified, so a center of mass may lie outside of them by a share of them.
        most_outside = 0.05
        places = axes.T @ model.body_ipos[body]
        distances = np.maximum(spans[:, 0] - places, places - spans[:, 1])
        worst = int(np.argmax(distances))
        beyond, allowed = float(distances[worst]), float(most_outside * np.ptp(spans[worst]))
        if beyond > allowed:
            reason = f"its center of mass lies {beyond:.3g} m outside its geoms"
            yield InertiaFault(name, "outside", beyond, allowed, "m", reason)

        worst = int(np.argmax(spreads / lengths))
        widest, fits = float(spreads[worst]), float(lengths[worst]) / 2
        if spreads[worst] > _SLACK * lengths[worst] / 2:
            reason = (
                f"its inertia puts its mass {widest:.3g} m (rms) from its center along an axis on "
                f"which its geoms are {lengths[worst]:.3g} m long, where at most {fits:.3g} m "
                "would fit"
            )
            limit = _SLACK * float(lengths[worst]) / 2
            yield InertiaFault(name, "too_large", widest, limit, "m", reason)

    spread = float(np.sqrt((spreads**2).sum()))
    ball = math.sqrt(3 / 5) * (3 * mass / (4 * math.pi * DENSEST)) ** (1 / 3)
    # Smallest rms distance over length; 0.29 for a uniform rod, and 1/10 for any real body.
    least_spread = 1 / 30
    # A body without moments is a point mass that is fixed to others.
    limit = max(ball, least_spread * length)
    if 0 < spread < limit:
        reason = f"its inertia puts its mass within {spread:.3g} m (rms) of its center; " + (
            f"a ball of {mass:g} kg of the densest metal has {ball:.3g} m"
            if limit == ball
            else f"its geoms are {length:.3g} m long"
        )
        yield InertiaFault(name, "too_small", spread, limit, "m", reason)


def _body_mass(model: mujoco.MjModel, body: int) -> float:
    return float(model.body_mass[body])


def scene_inertia_faults(
    source: SceneSource, structure: Mapping[str, object], compiled: mujoco.MjModel
) -> tuple[InertiaFault, ...]:
    """Return the inertia faults of a scene's structure, in its file and compiled."""
    with read_spec(source, structure) as spec:
        written_faults = tuple(written_inertia_faults(spec))
    return (*written_faults, *inertia_faults(compiled))


def inertia_faults(model: mujoco.MjModel) -> tuple[InertiaFault, ...]:
    """Return the inertia faults of the moving bodies of a compiled model, in order."""
    moving = np.flatnonzero(model.body_weldid != 0).tolist()
    faults = {body: [*_body_faults(model, body)] for body in moving}
    # If a body has no geoms of its own, the machine bounds how far its mass can lie.
    large = [
        body
        for body, own in faults.items()
        if any(fault.kind == "too_large" for fault in own)
        or (model.body_mass[body] > 0 and not solid_geoms(model, body))
    ]
    for body, fault in _find_beyond(model, large):
        faults[body] = [fault, *(one for one in faults[body] if one.kind != "too_large")]
    return tuple(fault for own in faults.values() for fault in own)


def _find_beyond(
    model: mujoco.MjModel, bodies: Sequence[int], least_share: float = 0.1
) -> Iterator[tuple[int, InertiaFault]]:
    """Yield each body with mass that would lie outside its machine in any pose.

    The root mean square distance of its mass from its center exceeds that of the farthest point of
    the machine's geoms, and a joint feels it. Inertias of motors belong into `armature`.

    Args:
        model: compiled.
        bodies: to judge.
        least_share: least share of the inertia at any joint that would not fit.
    """
    if not bodies:
        return
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_crb(model, data)
    mass, turn = np.zeros((model.nv, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_fullM(model, data, mass)
    for body in bodies:
        moments = model.body_inertia[body]
        spread = math.sqrt(moments.sum() / 2 / _body_mass(model, body))
        reach = _find_machine_reach(model, body)
        if not 0 < _SLACK * reach < spread:
            continue
        mujoco.mj_jacBodyCom(model, data, None, turn, body)
        own = np.asarray(data.ximat[body]).reshape(3, 3).T @ turn
        excess = (1 - (reach / spread) ** 2) * (moments[:, None] * own**2).sum(axis=0)
        if (excess > least_share * np.diag(mass)).any():
            parents = model.body_parentid
            is_alone = not parents[body] and not (parents[1:] == body).any()
            reason = (
                f"its inertia puts its mass {spread:.3g} m (rms) from its center; the farthest "
                f"point of {'its geoms' if is_alone else 'the machine'} is {reach:.3g} m away"
            )
            name = model.body(body).name
            yield body, InertiaFault(name, "beyond", spread, _SLACK * reach, "m", reason)


def _find_machine_reach(model: mujoco.MjModel, body: int) -> float:
    """Return the largest distance from a body's center of mass to its machine's geoms [m].

    It holds in any pose: distances add up from body to body. 0 without geoms.
    """
    distances, places = {body: float(np.linalg.norm(model.body_ipos[body]))}, [body]
    while places:
        place = places.pop()
        children = np.flatnonzero(model.body_parentid == place).tolist()
        for other in (int(model.body_parentid[place]), *children):
            if other and other not in distances:
                lower = max(other, place)  # bodies are numbered from root to leaf
                # Largest distance between the frames of a body and its parent.
                length = float(np.linalg.norm(model.body_pos[lower]))
                first, count = int(model.body_jntadr[lower]), int(model.body_jntnum[lower])
                for joint in range(first, first + count):
                    length += 2 * float(np.linalg.norm(model.jnt_pos[joint]))
                    if (
                        model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
                        and model.jnt_limited[joint]
                    ):
                        length += float(np.abs(model.jnt_range[joint]).max())
                distances[other] = distances[place] + length
                places.append(other)
    reach = 0.0
    for geom in np.flatnonzero(model.geom_rbound > 0).tolist():
        owner = int(model.geom_bodyid[geom])
        if owner in distances:
            center = model.body_ipos[body] if owner == body else np.zeros(3)
            away = np.linalg.norm(model.geom_pos[geom] - center)
            before = 0.0 if owner == body else distances[owner]
            reach = max(reach, before + float(away + model.geom_rbound[geom]))
    return reach


def _body_faults(model: mujoco.MjModel, body: int) -> Iterator[InertiaFault]:
    name, mass, moments = model.body(body).name, _body_mass(model, body), model.body_inertia[body]
    if mass < 0 or moments.min() < 0:
        yield nonpositive_inertia_fault(name, mass, moments)
    elif mass > 0:
        # A model may be edited after compilation.
        if not satisfies_triangle(moments + SUM_ROUNDING * moments.max()):
            yield triangle_inertia_fault(name, moments, balanced=False)
        yield from density_faults(model, body)
        yield from shape_faults(model, body)


_GEOM = mujoco.mjtGeom


def solid_geoms(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the geoms of a body with a volume: those that collide if any, otherwise all."""
    geoms: list[int] = np.flatnonzero(model.geom_bodyid == body).tolist()
    solid = [geom for geom in geoms if int(model.geom_type[geom]) in _SOLIDS]
    touching = [geom for geom in solid if model.geom_contype[geom] or model.geom_conaffinity[geom]]
    return touching or solid


def geom_volume(model: mujoco.MjModel, geom: int) -> float:
    """Return the volume of a geom [m^3]; for a mesh, that of its convex hull."""
    shape = _SHAPES.get(int(model.geom_type[geom]))
    return shape[0](*model.geom_size[geom]) if shape else hull_volume(model, _mesh_of(model, geom))


def _shape_span(model: mujoco.MjModel, geom: int, direction: Floats) -> tuple[float, float]:
    local = rotation_matrices(model.geom_quat[[geom]])[0].T @ direction
    centre = float(model.geom_pos[geom] @ direction)
    shape = _SHAPES.get(int(model.geom_type[geom]))
    if shape is None:
        along = mesh_vertices(model, _mesh_of(model, geom)) @ local
        return centre + float(along.min()), centre + float(along.max())
    reach = float(shape[1](np.array(model.geom_size[geom]), np.abs(local)))
    return centre - reach, centre + reach


def _mesh_of(model: mujoco.MjModel, geom: int) -> int:
    return int(model.geom_dataid[geom])


def mesh_vertices(model: mujoco.MjModel, mesh: int) -> Floats:
    """Return (n, 3) the vertices of a mesh in its frame [m]."""
    first = int(model.mesh_vertadr[mesh])
    return np.array(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])], np.float64)


def hull_volume(model: mujoco.MjModel, mesh: int) -> float:
    """Return the volume of a mesh's convex hull [m^3], MuJoCo's own if there is one; 0 if flat."""
    points = mesh_vertices(model, mesh)
    if model.mesh_graphadr[mesh] < 0:
        from scipy.spatial import ConvexHull, QhullError  # noqa: PLC0415 - it takes a while to load

        try:
            return float(ConvexHull(points).volume)
        except QhullError:
            return 0.0
    begin = int(model.mesh_graphadr[mesh])
    vertices, faces = model.mesh_graph[begin : begin + 2].tolist()
    first = begin + 2 + 3 * vertices + 3 * faces
    corners = points[np.array(model.mesh_graph[first : first + 3 * faces]).reshape(-1, 3)]
    # sum over pyramids on its faces, from a point inside
    corners = corners - corners.mean(axis=(0, 1))
    heights = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return float(np.abs(heights).sum() / 6)


_BALL = 4 / 3 * math.pi
_Shape = tuple[Callable[[float, float, float], float], Callable[[Floats, Floats], float]]
# The volume from the sizes of a geom, and its reach from sizes and magnitudes of a direction.
_SHAPES: dict[int, _Shape] = {
    int(_GEOM.mjGEOM_SPHERE): (lambda r, _, __: _BALL * r**3, lambda size, _: float(size[0])),
    int(_GEOM.mjGEOM_CAPSULE): (
        lambda r, half, _: _BALL * r**3 + 2 * math.pi * r**2 * half,
        lambda size, along: size[0] + size[1] * along[2],
    ),
    int(_GEOM.mjGEOM_CYLINDER): (
        lambda r, half, _: 2 * math.pi * r**2 * half,
        lambda size, along: size[0] * math.hypot(*along[:2]) + size[1] * along[2],
    ),
    int(_GEOM.mjGEOM_BOX): (lambda a, b, c: 8 * a * b * c, lambda size, along: float(size @ along)),
    int(_GEOM.mjGEOM_ELLIPSOID): (
        lambda a, b, c: _BALL * a * b * c,
        lambda size, along: math.hypot(*(size * along)),
    ),
}
_SOLIDS = {*_SHAPES, int(_GEOM.mjGEOM_MESH), int(_GEOM.mjGEOM_SDF)}
