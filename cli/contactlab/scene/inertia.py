"""Masses and inertias that no real body has, found in a model or in what was written of it."""

from collections.abc import Iterator, Mapping

import mujoco
import numpy as np

from contactlab.errors import SceneError
from contactlab.scene.compile import compile_model
from contactlab.scene.inertia_rules import (
    Body,
    InertiaFault,
    closes,
    density_faults,
    not_positive,
    open_triangle,
    shape_faults,
)
from contactlab.scene.shape import rotation
from contactlab.scene.source import SceneSource
from contactlab.scene.written import written_inertia_faults

_FATAL = ("not_positive", "triangle")
# A plate closes the triangle to rounding.
_ROUNDING = 1e-9


def scene_inertia_faults(
    source: SceneSource, structure: Mapping[str, object] | None = None
) -> tuple[InertiaFault, ...]:
    """Return the faults of a scene's model, also of one that does not compile because of them.

    Args:
        source: the scene.
        structure: structure values; as written in the model if left out.

    Raises:
        SceneError: the model does not compile for another reason.
    """
    written: list[InertiaFault] = []

    def inspect(spec: mujoco.MjSpec) -> None:
        written.extend(written_inertia_faults(spec))

    try:
        model = compile_model(source, structure or {}, inspect)
    except SceneError:
        fatal = tuple(each for each in written if each.kind in _FATAL)
        if not fatal:
            raise
        return fatal
    return (*written, *inertia_faults(model))


def inertia_faults(model: mujoco.MjModel) -> tuple[InertiaFault, ...]:
    """Return the faults of a compiled model's moving bodies, in their order."""
    moving = np.flatnonzero(model.body_weldid != 0).tolist()
    return tuple(fault for body in moving for fault in _body_faults(model, body))


def _body_faults(model: mujoco.MjModel, index: int) -> Iterator[InertiaFault]:
    body = Body(
        model.body(index).name or f"body {index}",
        float(model.body_mass[index]),
        np.array(model.body_inertia[index]),
        rotation(model.body_iquat[index]),
        np.array(model.body_ipos[index]),
    )
    if body.mass < 0 or body.moments.min() < 0:
        yield not_positive(body.name, body.mass, body.moments)
    elif body.mass > 0:
        # A model may be edited after it was compiled.
        if not closes(body.moments + _ROUNDING * body.moments.max()):
            yield open_triangle(body.name, body.moments, balanced=False)
        yield from density_faults(model, index, body)
        yield from shape_faults(model, index, body)
