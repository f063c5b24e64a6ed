"""Finds geoms that a height field does not hold, by the surface of its own grid.

MuJoCo collides a geom with the prisms of the cells below it. If cells are many times as wide as the
geom, contacts vanish at times, at any step. The surface itself is known in closed form, so no
reference is needed: a geom with its center below it has passed. A geom over many cells gets the
first contacts of them only, and tips over these.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.budget.force_places import contact_name
from contactlab.budget.motion import Motion
from contactlab.budget.windows import KEPT, Run, replay_motion
from contactlab.contact.trace_arrays import Floats
from contactlab.rendering.amounts import format_digits, format_others
from contactlab.scene.contact_pairs import half_extents, touch_mask
from contactlab.schema.examination import Cause

_HFIELD = int(mujoco.mjtGeom.mjGEOM_HFIELD)
_MOST_CONTACTS = int(mujoco.mjMAXCONPAIR)


class FieldPassage(NamedTuple):
    """A geom that is below the surface of a height field, or has as many contacts as a pair may."""

    field: int
    geom: int
    depth: float  # of its center below the surface [m]; 0 with too many contacts
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


def find_field_passages(
    motions: Sequence[Motion], begins: Sequence[float], *, failing: bool = False
) -> list[FieldPassage]:
    """Return the first fault of each geom on a height field in the first seed's run.

    Too few contacts are a fault of `failing` runs only: a body may rest on a part of them.
    """
    model = motions[0].model
    fields = np.flatnonzero(model.geom_type == _HFIELD).tolist()
    touch = touch_mask(model) if fields else np.zeros((0, 0), bool)
    pairs = [(field, geom) for field in fields for geom in np.flatnonzero(touch[field]).tolist()]
    passages = dict[tuple[int, int], FieldPassage]()
    above = set[tuple[int, int]]()
    for motion, begin in zip(motions, begins, strict=True) if pairs else ():
        window_seconds = 0.02  # between states that are looked at
        run = replay_motion(motion, window_seconds, 1)
        for place, depths, crowded in _depths_over_time(motion, run, pairs):
            time = begin + place * model.opt.timestep
            for pair in crowded if failing else ():
                passages.setdefault(pair, FieldPassage(*pair, 0.0, time))
            for pair, depth in depths.items():
                if depth <= 0:
                    above.add(pair)
                # A geom is below the surface if its center is as deep as its half extent.
                elif depth > half_extents(model)[pair[1]] and pair in above:
                    passages.setdefault(pair, FieldPassage(*pair, depth, time))
    return sorted(passages.values(), key=lambda passage: passage.time)


def _depths_over_time(
    motion: Motion, run: Run, pairs: Sequence[tuple[int, int]]
) -> Iterator[tuple[int, dict[tuple[int, int], float], list[tuple[int, int]]]]:
    # Depths of geoms below surfaces [m], and pairs with as many contacts as MuJoCo finds, at the
    # beginning of each window.
    model, data = motion.model, mujoco.MjData(motion.model)
    ends: NDArray[np.intp] = run.begins[run.valid[0]]
    for place in ends.tolist():
        mujoco.mj_setState(model, data, run.velocity_states[0, place], KEPT)
        mujoco.mj_fwdPosition(model, data)
        contacts = Counter(map(tuple, np.sort(data.contact.geom, axis=1).tolist()))
        crowded = [pair for pair in pairs if contacts[min(pair), max(pair)] >= _MOST_CONTACTS]
        depths = dict[tuple[int, int], float]()
        for field, geom in pairs:
            turn = np.asarray(data.geom_xmat[field]).reshape(3, 3)
            local = turn.T @ (data.geom_xpos[geom] - data.geom_xpos[field])
            (height,) = surface_heights(model, field, local[None, :2])
            if np.isfinite(height):
                depths[field, geom] = float(height - local[2])
        yield place, depths, crowded


def judge_fields(
    motions: Sequence[Motion], begins: Sequence[float], *, failing: bool
) -> tuple[list[Cause], str]:
    """Return the cause of the first fault of a height field, and its fix, made by hand."""
    passages = find_field_passages(motions, begins, failing=failing)
    if not passages:
        return [], ""
    first, others = passages[0], len(passages) - 1
    place = contact_name(motions[0].model, np.array([first.field, first.geom]))
    more = format_others(others, "geom")
    if first.depth:
        sentence = (
            f"{place} misses a body that falls through the height field: it is "
            f"{format_digits(1e3 * first.depth, 2)} mm below the surface at {first.time:.2f} s"
            f"{more}"
        )
        remedy = "a finer grid for the height field, or a mesh"
    else:
        sentence = (
            f"{place} misses contacts: MuJoCo finds {_MOST_CONTACTS} of a pair, and more cells of "
            f"the height field touch the geom, from {first.time:.2f} s{more}"
        )
        remedy = "a coarser grid for the height field, or several smaller geoms"
    cause = Cause(stage="collision", sentence=sentence)
    return [cause], f"use {remedy}; no step or solver ends this"
