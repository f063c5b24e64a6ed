"""Bodies that go through each other in a run, since their masks let no contact arise."""

from collections.abc import Iterator, Sequence
from copy import copy
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.budget.force_places import contact_name
from contactlab.budget.motion import Motion
from contactlab.budget.windows import KEPT, Run, cut
from contactlab.contact.trace_arrays import Floats
from contactlab.rendering.amounts import format_digits
from contactlab.scene.contact_pairs import geom_pairs, half_extents, mask_overlap, touch_mask
from contactlab.schema.examination import Fact

_WINDOW = 0.02  # between states that are looked at [s]
_OUTSIDE = 0.5  # of half the thinner geom, up to which its middle begins outside of the other
_UNMEASURED = (int(mujoco.mjtGeom.mjGEOM_HFIELD), int(mujoco.mjtGeom.mjGEOM_SDF))


class _Passage(NamedTuple):
    """Two geoms, one of which is in the other to its middle or beyond."""

    geoms: tuple[int, int]
    depth: float  # [m]
    time: float  # [s], of the run


class MaskedPassages:
    """Pairs that go through each other where only masks forbid a contact.

    The geoms collide with others, are apart or touch where a phase begins, and one is in the other
    up to its middle later. Pairs that <exclude> names, and links and their parents, are left out:
    that is written on purpose.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """Look for passages of a model's geoms."""
        self._model, self._pairs = model, _masked(model)
        self._found = dict[tuple[int, int], _Passage]()

    def enter(self, motion: Motion, run: Run, begin: float) -> None:
        """Look at a phase's first seed, as it was replayed, which begins at that time [s]."""
        for passage in _passages(motion, run, self._pairs, begin) if self._pairs else ():
            self._found.setdefault(passage.geoms, passage)

    def facts(self) -> Iterator[Fact]:
        """Yield the first pair that does."""
        if not self._found:
            return
        first = min(self._found.values(), key=lambda passage: passage.time)
        names = {contact_name(self._model, np.array(geoms)) for geoms in self._found}
        name = contact_name(self._model, np.array(first.geoms))
        one, other = name.removeprefix("contact ").split(" - ")
        others = len(names) - 1
        more = f"; so do {others} more pairs of bodies" if others > 1 else "; so does another pair"
        sentence = (
            f"{one} and {other} go through each other, {format_digits(1e3 * first.depth, 2)} mm at "
            f"{first.time:.2f} s: contype and conaffinity let them have no contact"
        )
        sentence += more if others else ""
        yield Fact(kind="masks", place=name, value=first.depth, unit="m", sentence=sentence)


def _masked(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Return the pairs of geoms that collide with others and that masks alone keep from contact."""
    open_to_all = copy(model)
    solid = (np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)) != 0
    open_to_all.geom_contype[:] = open_to_all.geom_conaffinity[:] = solid
    masked = touch_mask(open_to_all) & ~mask_overlap(model) & ~touch_mask(model)
    masked &= ~np.isin(model.geom_type, _UNMEASURED)
    return geom_pairs(masked)


def _passages(
    motion: Motion, run: Run, pairs: Sequence[tuple[int, int]], begin: float
) -> Iterator[_Passage]:
    """Yield the passages of a phase's first seed, the earliest of a pair first."""
    model, step = motion.model, motion.model.opt.timestep
    data, geoms, halves = mujoco.MjData(model), np.array(pairs), half_extents(model)
    thin = halves[geoms].min(axis=1)
    apart = np.ones(len(pairs), bool)
    for place in map(int, _looks(motion, run)):
        mujoco.mj_setState(model, data, run.kept[0, place], KEPT)
        mujoco.mj_kinematics(model, data)
        near = apart & _near(model, data, geoms)
        for pair in np.flatnonzero(near):
            one, other = (int(geom) for geom in geoms[pair])
            depth = -mujoco.mj_geomDistance(model, data, one, other, 0.0, None)
            if not place:
                apart[pair] = depth < _OUTSIDE * thin[pair]
            elif depth >= thin[pair]:
                yield _Passage((one, other), depth, begin + place * step)
                apart[pair] = False


def _looks(motion: Motion, run: Run) -> NDArray[np.intp]:
    """Return the steps before which a phase is looked at, as far as its first seed came."""
    length, begins = cut(motion, _WINDOW)
    lost = run.begins[~run.valid[0]]
    return begins[begins + length <= lost[0]] if lost.size else begins


def _near(model: mujoco.MjModel, data: mujoco.MjData, geoms: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return (P,) whether spheres around geoms (P, 2) meet; a plane's is the half space below."""
    centres, radii = np.asarray(data.geom_xpos)[geoms], np.asarray(model.geom_rbound)[geoms]
    lengths: Floats = np.linalg.norm(centres[:, 0] - centres[:, 1], axis=1)
    for side in (0, 1):
        flat = np.asarray(model.geom_type)[geoms[:, side]] == int(mujoco.mjtGeom.mjGEOM_PLANE)
        normals = np.asarray(data.geom_xmat)[geoms[:, side]][:, 2::3]
        heights = ((centres[:, 1 - side] - centres[:, side]) * normals).sum(axis=1)
        lengths = np.where(flat, heights, lengths)
    return lengths < radii.sum(axis=1)
