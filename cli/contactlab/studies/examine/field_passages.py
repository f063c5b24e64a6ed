"""Finds geoms that fall through a height field, by the surface of its own grid.

MuJoCo collides a geom with the prisms of the cells below it. If cells are many times as wide as the
geom, contacts vanish at times, at any step. The surface itself is known in closed form, so no
reference is needed: a geom with its center below it has passed.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.budget.force_places import contact_name
from contactlab.budget.motion import Motion
from contactlab.budget.windows import KEPT, Run, replay
from contactlab.contact.trace_arrays import Floats
from contactlab.rendering.amounts import format_digits
from contactlab.scene.contact_pairs import half_extents, touch_mask
from contactlab.schema.examination import Cause

_HFIELD = int(mujoco.mjtGeom.mjGEOM_HFIELD)


class FieldPassage(NamedTuple):
    """A geom that is below the surface of a height field, and began above it."""

    field: int
    geom: int
    depth: float  # of its center below the surface [m]
    time: float  # of the run [s]


def surface_heights(model: mujoco.MjModel, field: int, places: Floats) -> Floats:
    """Return the height of a field's surface at places (n, 2) in its frame (n,) [m]; NaN outside.

    A cell is two triangles; the lower of the two ways to cut it counts.
    """
    data = int(model.geom_dataid[field])
    rows, columns = int(model.hfield_nrow[data]), int(model.hfield_ncol[data])
    first = int(model.hfield_adr[data])
    wide, long, high, _ = model.hfield_size[data]
    grid = high * model.hfield_data[first : first + rows * columns].reshape(rows, columns)
    across = (places[:, 0] + wide) / (2 * wide) * (columns - 1)
    along = (places[:, 1] + long) / (2 * long) * (rows - 1)
    inside = (across >= 0) & (across <= columns - 1) & (along >= 0) & (along <= rows - 1)
    column = np.clip(across.astype(int), 0, columns - 2)
    row = np.clip(along.astype(int), 0, rows - 2)
    x, y = across - column, along - row
    near, right = grid[row, column], grid[row, column + 1]
    far, corner = grid[row + 1, column], grid[row + 1, column + 1]
    rising = np.where(
        x >= y, near + x * (right - near) + y * (corner - right),
        near + y * (far - near) + x * (corner - far),
    )  # fmt: skip
    falling = np.where(
        x + y <= 1, near + x * (right - near) + y * (far - near),
        corner + (1 - x) * (far - corner) + (1 - y) * (right - corner),
    )  # fmt: skip
    return np.where(inside, np.minimum(rising, falling), np.nan)


def find_field_passages(motions: Sequence[Motion], begins: Sequence[float]) -> list[FieldPassage]:
    """Return the first passage of each geom through a height field in the first seed's run."""
    model = motions[0].model
    fields = np.flatnonzero(model.geom_type == _HFIELD).tolist()
    touch = touch_mask(model) if fields else np.zeros((0, 0), bool)
    pairs = [(field, geom) for field in fields for geom in np.flatnonzero(touch[field]).tolist()]
    found = dict[tuple[int, int], FieldPassage]()
    above = set[tuple[int, int]]()
    for motion, begin in zip(motions, begins, strict=True) if pairs else ():
        window_seconds = 0.02  # between states that are looked at
        run = replay(motion, window_seconds, 1)
        for place, depths in _depths_over_time(motion, run, pairs):
            for pair, depth in depths.items():
                if depth <= 0:
                    above.add(pair)
                # A geom is below the surface if its center is as deep as its half extent.
                elif depth > half_extents(model)[pair[1]] and pair in above:
                    time = begin + place * model.opt.timestep
                    found.setdefault(pair, FieldPassage(*pair, depth, time))
    return sorted(found.values(), key=lambda passage: passage.time)


def _depths_over_time(
    motion: Motion, run: Run, pairs: Sequence[tuple[int, int]]
) -> Iterator[tuple[int, dict[tuple[int, int], float]]]:
    # Depths of geoms below surfaces [m], at the beginning of each window.
    model, data = motion.model, mujoco.MjData(motion.model)
    ends: NDArray[np.intp] = run.begins[run.valid[0]]
    for place in ends.tolist():
        mujoco.mj_setState(model, data, run.velocity_states[0, place], KEPT)
        mujoco.mj_kinematics(model, data)
        depths = dict[tuple[int, int], float]()
        for field, geom in pairs:
            turn = np.asarray(data.geom_xmat[field]).reshape(3, 3)
            local = turn.T @ (data.geom_xpos[geom] - data.geom_xpos[field])
            (height,) = surface_heights(model, field, local[None, :2])
            if np.isfinite(height):
                depths[field, geom] = float(height - local[2])
        yield place, depths


def list_passage_causes(model: mujoco.MjModel, passages: Sequence[FieldPassage]) -> Iterator[Cause]:
    """Yield the cause of the first passage."""
    if not passages:
        return
    first = passages[0]
    place = contact_name(model, np.array([first.field, first.geom]))
    more = f"; so do {len(passages) - 1} more geoms" if len(passages) > 1 else ""
    yield Cause(
        stage="collision",
        sentence=f"{place} misses a body that falls through the height field: it is "
        f"{format_digits(1e3 * first.depth, 2)} mm below the surface at {first.time:.2f} s{more}",
    )


FINER_GRID = "use a finer grid for the height field, or a mesh; no step or solver ends this"
"""The fix of a passage."""
