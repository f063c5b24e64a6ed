"""Geoms that collide as the hull of a mesh, and the model in which a primitive does in its place.

A hull touches by points that come and go with its triangles; a box, capsule or cylinder by few that
stay. MuJoCo fits each to the mesh of a geom that says `mesh` and another type.
"""

from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from contactlab.budget import Motion, Verdict
from contactlab.budget.motion import INTEGRATION
from contactlab.contact.trace_arrays import Floats
from contactlab.modifications.modification import Candidate
from contactlab.scene.mesh_hulls import hull_vertices, rotation_matrix
from contactlab.scene.model_draft import PRIMITIVES, ModelEdits, edit_spec
from contactlab.scene.scene import Scene
from contactlab.studies.examine.start_fixes import compile_edited
from contactlab.tasks.session import Values

_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)


def list_primitives(
    scene: Scene, values: Values, motions: Sequence[Motion], verdict: Verdict
) -> Iterator[Candidate]:
    """Yield the change by which the meshes that a verdict's bodies touch by are primitives.

    They are those whose hull a primitive resembles.
    """
    bodies = {reason.body for reason in verdict.reasons if reason.verdict != "depends"}
    touching = sorted(_list_touching(motions[0], bodies)) if verdict.word != "depends" else []
    if not touching:
        return
    nearest = _find_nearest(scene, values, motions[0].model, touching)
    edits = ModelEdits(fitted=tuple(nearest.items()))
    compiled_model = (
        compile_edited(scene, values, lambda spec: edit_spec(spec, edits)) if nearest else None
    )
    if compiled_model is None:
        return
    name, shape = next(iter(nearest.items()))
    more = f", and so of {len(nearest) - 1} more" if len(nearest) > 1 else ""
    article = "an" if shape == "ellipsoid" else "a"
    yield Candidate(
        f"{article} {shape} in place of the hull of {name}{more}",
        "inaccurate",
        apply="primitive",
        edits=edits,
        compiled=compiled_model,
        must_come_nearer=False,
    )


def _list_touching(motion: Motion, bodies: set[str]) -> Iterator[str]:
    """Yield names of mesh geoms that touch in a motion, where one of some bodies takes part."""
    model, data = motion.model, mujoco.MjData(motion.model)
    meshes = (model.geom_type == _MESH) & (model.geom_dataid >= 0)
    if not meshes.any():
        return
    is_of_body = np.array([model.body(body).name in bodies for body in model.geom_bodyid], bool)
    is_touching = np.zeros(model.ngeom, bool)
    mujoco.mj_setState(model, data, motion.starts[0], INTEGRATION)
    rows = motion.rows(0, np.arange(motion.steps))
    for step in range(motion.steps):
        if rows is not None:
            mujoco.mj_setState(model, data, rows[step], motion.spec)
        mujoco.mj_step(model, data)
        pairs = data.contact.geom[(data.contact.geom >= 0).all(axis=1)]
        is_touching[pairs[is_of_body[pairs].any(axis=1)]] = True
    yield from filter(
        None, (model.geom(geom).name for geom in np.flatnonzero(is_touching & meshes))
    )


def _find_nearest(
    scene: Scene, values: Values, own: mujoco.MjModel, geoms: Sequence[str]
) -> dict[str, str]:
    """Return the primitive whose surface is nearest to the hull of each geom that one resembles."""
    apart = {name: dict[str, float]() for name in geoms}
    for shape in PRIMITIVES:
        edits = ModelEdits(fitted=tuple((name, shape) for name in geoms))
        model = compile_edited(scene, values, lambda spec, edits=edits: edit_spec(spec, edits))
        if model is None:
            continue
        for name in geoms:
            # The corners of the hull in the frame of the primitive; both are of one body.
            geom, fitted = own.geom(name), model.geom(name)
            hull = hull_vertices(own, int(geom.dataid[0]))
            corners = hull @ rotation_matrix(geom.quat).T + geom.pos
            corners = (corners - fitted.pos) @ rotation_matrix(fitted.quat)
            off = np.abs(measure_distances(shape, fitted.size, corners)).mean()
            apart[name][shape] = float(off / corners.std(axis=0).max())
    nearest = {name: min(of, key=lambda shape: of[shape]) for name, of in apart.items() if of}
    # Mean distance of the corners of a hull from a primitive, over their widest spread.
    alike = 0.1
    return {name: shape for name, shape in nearest.items() if apart[name][shape] <= alike}


def measure_distances(shape: str, size: Floats, points: Floats) -> Floats:
    """Return how far (N, 3) points are from a primitive's surface (N,), those within below 0 [m].

    That of an ellipsoid is of first order, |x/a| (|x/a| - 1) / |x/a^2|, which is exact on it.
    """
    radius, half = float(size[0]), float(size[1])
    around = np.linalg.norm(points[:, :2], axis=1)
    match shape:
        case "sphere":
            return np.linalg.norm(points, axis=1) - radius
        case "capsule":
            along = np.maximum(np.abs(points[:, 2]) - half, 0)
            return np.hypot(around, along) - radius
        case "cylinder":
            return _measure_outside(
                np.stack([around - radius, np.abs(points[:, 2]) - half], axis=1)
            )
        case "ellipsoid":
            scaled = np.linalg.norm(points / size, axis=1)
            return scaled * (scaled - 1) / np.linalg.norm(points / size**2, axis=1)
        case _:
            return _measure_outside(np.abs(points) - size)


def _measure_outside(beyond: Floats) -> Floats:
    """Return distances from a box, from how far points are beyond each of its sides."""
    return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)
