"""Bodies that go through each other in a run, since their masks let no contact arise."""

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.budget.force_places import contact_name
from contactlab.budget.motion import Motion
from contactlab.budget.windows import KEPT, Run, body_name, cut_windows
from contactlab.contact.trace_arrays import Floats
from contactlab.modifications.model_predicates import find_disable_bit, is_disabled
from contactlab.rendering.amounts import format_digits, format_others
from contactlab.scene.contact_pairs import geom_pairs, half_extents, mask_overlap, touch_mask
from contactlab.scene.model_names import name_of
from contactlab.schema.examination import Fact
from contactlab.studies.examine.standing_starts import begin_motion, step_first_seed

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
        self._model, self._pairs = model, _list_masked(model)
        self._found = dict[tuple[int, int], _Passage]()

    def enter(self, motion: Motion, run: Run, begin: float) -> None:
        """Look at a phase's first seed, as it was replayed, which begins at that time [s]."""
        if not self._pairs:
            return
        model, step = motion.model, motion.model.opt.timestep
        data, geoms, halves = mujoco.MjData(model), np.array(self._pairs), half_extents(model)
        thin = halves[geoms].min(axis=1)
        apart = np.ones(len(geoms), bool)
        window_seconds = 0.02  # between states that are looked at, as far as the first seed came
        length, begins = cut_windows(motion, window_seconds)
        lost = run.begins[~run.valid[0]]
        if lost.size:
            begins = begins[begins + length <= lost[0]]
        for place in map(int, begins):
            mujoco.mj_setState(model, data, run.velocity_states[0, place], KEPT)
            mujoco.mj_kinematics(model, data)
            near = apart & _are_near(model, data, geoms)
            for pair in np.flatnonzero(near):
                one, other = (int(geom) for geom in geoms[pair])
                depth = -mujoco.mj_geomDistance(model, data, one, other, 0.0, None)
                if not place:
                    # Up to half of half the thinner geom, its middle begins outside of the other.
                    apart[pair] = depth < thin[pair] / 2
                elif depth >= thin[pair]:
                    # The first passage of a pair counts.
                    passage = _Passage((one, other), depth, begin + place * step)
                    self._found.setdefault(passage.geoms, passage)
                    apart[pair] = False

    def facts(self) -> Iterator[Fact]:
        """Yield the first pair that does."""
        if not self._found:
            return
        first = min(self._found.values(), key=lambda passage: passage.time)
        names = {contact_name(self._model, np.array(geoms)) for geoms in self._found}
        name = contact_name(self._model, np.array(first.geoms))
        one, other = name.removeprefix("contact ").split(" - ")
        sentence = (
            f"{one} and {other} go through each other, {format_digits(1e3 * first.depth, 2)} mm at "
            f"{first.time:.2f} s: contype and conaffinity let them have no contact"
        )
        sentence += format_others(len(names) - 1, "pair")
        yield Fact(kind="masks", place=name, value=first.depth, unit="m", sentence=sentence)


class MaskedFall(NamedTuple):
    """A body that falls out of the world, since contacts that would hold it are switched off.

    Attributes:
        sentence: the body, where it falls through, and why.
        widened_masks: geoms that let it have these contacts, their masks, and the new bits; empty
            if the flag for contacts does.
    """

    sentence: str
    widened_masks: tuple[tuple[str, str, int], ...]


def find_masked_fall(motion: Motion) -> MaskedFall | None:
    """Return the first body that falls freely at the end, but is held with all contacts on.

    Both are seen in the first seed. Geoms without any mask are meant to have no contact.
    """
    model = motion.model
    fallen = [body for body in _list_free_bodies(model) if model.body_mass[body] > 0]
    data = begin_motion(motion)
    for _ in step_first_seed(motion, data) if fallen else ():
        pass
    fallen = [body for body in fallen if _falls_freely(model, data, body)]
    whole, is_off = copy(model), is_disabled(model, "contact")
    whole.opt.disableflags &= ~find_disable_bit("contact")
    opened = () if is_off else _open_masks(whole, fallen)
    if not fallen or not (is_off or opened):
        return None
    held_data = begin_motion(replace(motion, model=whole))
    for _ in step_first_seed(replace(motion, model=whole), held_data):
        pass
    mujoco.mj_forward(whole, held_data)
    for body in fallen:
        touched = [pair for pair in held_data.contact.geom if body in model.geom_bodyid[pair]]
        if not touched or _falls_freely(whole, held_data, body):
            continue
        other = next(int(geom) for geom in touched[0] if model.geom_bodyid[geom] != body)
        why = (
            "the flag contact switches all contacts off"
            if is_off
            else "contype and conaffinity let them have no contact"
        )
        return MaskedFall(
            f"{body_name(model, body)} falls through {name_of(model, 'geom', other)}: {why}",
            opened,
        )
    return None


def _list_free_bodies(model: mujoco.MjModel) -> list[int]:
    free = model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)
    return list(map(int, model.jnt_bodyid[free]))


def _falls_freely(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> bool:
    dof, gravity = int(model.body_dofadr[body]), model.opt.gravity
    weight = float(np.linalg.norm(gravity))
    if is_disabled(model, "gravity") or not weight:
        return False
    free_share = 1e-3  # of gravity: largest difference of a falling body's acceleration
    falls = float(np.linalg.norm(data.qacc[dof : dof + 3] - gravity)) < free_share * weight
    return falls and bool(data.qvel[dof : dof + 3] @ gravity > 0)


def _open_masks(model: mujoco.MjModel, bodies: Sequence[int]) -> tuple[tuple[str, str, int], ...]:
    # Let bodies touch all fixed geoms that only masks keep from contact.
    opened = dict[tuple[str, str], int]()
    for pair in _list_masked(model) if bodies else ():
        fixed = [geom for geom in pair if model.body_weldid[model.geom_bodyid[geom]] == 0]
        if len(fixed) != 1 or not {*model.geom_bodyid[list(pair)].tolist()} & {*bodies}:
            continue
        (wall,), (moving,) = fixed, [geom for geom in pair if geom not in fixed]
        own, other = model.geom_conaffinity, model.geom_contype
        mask = "conaffinity" if other[moving] else "contype"
        own, other = (own, other) if other[moving] else (other, own)
        own[wall] |= other[moving]
        # MuJoCo looks at the masks of whole bodies first.
        getattr(model, f"body_{mask}")[model.geom_bodyid[wall]] |= own[wall]
        opened[name_of(model, "geom", wall), mask] = int(own[wall])
    return tuple((*place, bits) for place, bits in opened.items())


def _list_masked(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Return the pairs of geoms that collide with others and that masks alone keep from contact."""
    open_to_all = copy(model)
    solid = (np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)) != 0
    open_to_all.geom_contype[:] = open_to_all.geom_conaffinity[:] = solid
    masked = touch_mask(open_to_all) & ~mask_overlap(model) & ~touch_mask(model)
    masked &= ~np.isin(model.geom_type, _UNMEASURED)
    return geom_pairs(masked)


def _are_near(
    model: mujoco.MjModel, data: mujoco.MjData, geoms: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Return (P,) whether spheres around geoms (P, 2) meet; a plane's is the half space below."""
    centres, radii = np.asarray(data.geom_xpos)[geoms], np.asarray(model.geom_rbound)[geoms]
    lengths: Floats = np.linalg.norm(centres[:, 0] - centres[:, 1], axis=1)
    for side in (0, 1):
        flat = np.asarray(model.geom_type)[geoms[:, side]] == int(mujoco.mjtGeom.mjGEOM_PLANE)
        normals = np.asarray(data.geom_xmat)[geoms[:, side]][:, 2::3]
        heights = ((centres[:, 1 - side] - centres[:, side]) * normals).sum(axis=1)
        lengths = np.where(flat, heights, lengths)
    return lengths < radii.sum(axis=1)
