"""Finds passages of geoms through each other between steps, whether or not a step had a contact.

Seen from one geom, the center of another moves along a line from step to step. If a ray along it
enters the geom and leaves it again, or gets under a surface, the other geom has passed through. The
same holds for vertices and edges of a rope, and for a center that crosses a flex's mid-surface. A
geom that turns far in a step is followed within it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.rotations import rotate_vectors, rotate_vectors_back
from contactlab.contact.trace_arrays import Floats, Passage, squared_lengths
from contactlab.numerical_tolerance import COARSE_ROUNDING, SUM_ROUNDING
from contactlab.scene.contact_pairs import body_reaches, half_extents, touch_places
from contactlab.scene.initial_states import InitialStates, apply_inputs
from contactlab.scene.model_edits import read_flag
from contactlab.scene.model_names import name_of
from contactlab.scene.part_bodies import moving_bodies

_PLANE_TYPE, _HFIELD_TYPE = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD)
_MESH_TYPE, _SPHERE_TYPE = int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_SPHERE)
_TRANSLATIONS = {int(mujoco.mjtJoint.mjJNT_FREE): 3, int(mujoco.mjtJoint.mjJNT_SLIDE): 1}
_UP_AXIS, _ORIGIN, _AXES = np.array([0.0, 0.0, 1.0]), np.zeros(3), np.eye(3).ravel()


@dataclass(frozen=True)
class _SearchLimits:
    """Limits that keep the search for passages short against the steps of a run."""

    least_motion: float = 0.5  # in a step, as a share of the half thickness of two geoms
    most_pairs: int = 200  # of fast geoms in a run
    most_rays: int = 500  # of steps of a pair that are searched
    most_steps: int = 4  # of a fast geom to pass through another


_LIMITS = _SearchLimits()


class Passages:
    """Passages of geoms through each other in runs of one structure, from the poses of bodies.

    Attributes:
        found: the passages in each run, in the order of steps.
    """

    def __init__(self, model: mujoco.MjModel, runs: int) -> None:
        """Prepare the search in n runs; their geoms are those of one model."""
        self._thinnest, self._motion_lengths, self._reach, self._pairs, self._least = (
            _reach_of_steps(model)
        )
        self.found = [tuple[Passage, ...]()] * runs

    def enter_run(
        self, run: int, model: mujoco.MjModel, starts: InitialStates, states: Floats
    ) -> None:
        """Search a run that was just recorded, with its own model and (N + 1, nstate) states."""
        if not np.isfinite(self._thinnest):
            return
        positions, velocities = 1 + model.nq, 1 + model.nq + model.nv
        # No point moves farther than this in a step; the bound is quick to compute.
        fastest = np.abs(states.T[positions:velocities].copy()).max(axis=1)
        if (
            model.nflex
            or fastest @ self._motion_lengths * model.opt.timestep
            > _LIMITS.least_motion * self._thinnest
        ):
            acting = starts.input_rows(run, model.opt.timestep, np.arange(len(states) - 1))
            path = states[:-1, 1:positions]
            data, steps = mujoco.MjData(model), len(path)
            # The poses of bodies, and the vertices of flexes, at the begin of each step.
            position = np.empty((steps, model.nbody, 3))
            rotation = np.empty((steps, model.nbody, 4))
            vertices = np.empty((steps, model.nflexvert, 3))
            for step, data.qpos[:] in enumerate(path):
                if model.nmocap:
                    apply_inputs(model, data, acting[step])
                mujoco.mj_kinematics(model, data)
                position[step], rotation[step] = data.xpos, data.xquat
                if model.nflex:
                    mujoco.mj_flex(model, data)
                    vertices[step] = data.flexvert_xpos
            # The largest rotation of each body in each step [rad].
            cosine = np.abs((rotation[1:] * rotation[:-1]).sum(axis=2))
            turned = 2 * np.arccos(np.minimum(cosine, 1))
            shift = np.sqrt(squared_lengths(np.diff(position, axis=0)))
            moved = shift + turned * self._reach
            # Pairs that can touch, and that a step may carry through each other.
            most = moved.max(axis=0, initial=0)[model.geom_bodyid]
            first, second = self._pairs
            fast = np.flatnonzero(most[first] + most[second] > self._least)[: _LIMITS.most_pairs]
            places = zip(first[fast].tolist(), second[fast].tolist(), strict=True)
            pairs = dict(zip(places, self._least[fast].tolist(), strict=True))
            close = ClosePairs(model, position, rotation, turned)
            passages = [*self._fast_passages(model, pairs, close, turned)]
            within = _StepSearch(model, states[:, 1 : positions + model.nv], acting)
            for pair, least in pairs.items():
                passages += within.find_passages(
                    pair, close, moved[:, model.geom_bodyid[[*pair]]].sum(axis=1), least=least
                )
            passages += _passages_through_flexes(model, position, rotation, vertices)
            self.found[run] = tuple(sorted(passages, key=lambda passage: passage.step))

    def _fast_passages(
        self,
        model: mujoco.MjModel,
        pairs: Mapping[tuple[int, int], float],
        close: "ClosePairs",
        turned: Floats,
    ) -> Iterator[Passage]:
        """Yield the first passage of each fast pair of geoms; pairs have their least motions [m].

        Steps turn bodies by at most `turned` (N - 1, nbody) [rad].
        """
        if not pairs:
            return
        none = np.zeros((model.nbody, 1))
        turned = np.concatenate([none, turned.cumsum(axis=0).T], axis=1)
        for (first, second), least in pairs.items():
            for mover, wall in ((first, second), (second, first)):
                some = close.find_stretch(mover, wall, least)
                if not some.stop:
                    continue
                poses = close.position[some], close.rotation[some]
                shape = _PassableGeom(model, wall, float(model.geom_rbound[mover]))
                steps = list[int]()
                end = _axis_end(model, mover)
                for point in np.array([_ORIGIN, end, -end] if end.any() else [_ORIGIN]):
                    place = _point_positions(model, *poses, mover, point)
                    path = _in_geom_frame(model, *poses, wall, place)
                    own = turned[model.geom_bodyid[mover]] * point.any()
                    turns = own + turned[model.geom_bodyid[wall]] * shape.turns
                    step_of_passage = _first_passage(path, least, shape, turns[some])
                    steps += [(some.start or 0) + step for step in step_of_passage]
                if steps:
                    yield _make_passage(model, mover, wall, min(steps))
                    break


def _axis_end(model: mujoco.MjModel, geom: int) -> Floats:
    # (3,) of a geom's axis of symmetry, off its center [m]; zeros for a ball.
    half = model.geom_aabb[geom, 3:]
    length = half.max() - half.min() if int(model.geom_type[geom]) != _MESH_TYPE else 0.0
    return length * (np.arange(3) == half.argmax())


class ClosePairs:
    """How close the centers of geoms come in a run, which rules most pairs out."""

    def __init__(
        self, model: mujoco.MjModel, position: Floats, rotation: Floats, turned: Floats
    ) -> None:
        """Take poses (N, nbody, 3 and 4), and the angles of steps (N - 1, nbody) [rad]."""
        self._model, self.position, self.rotation = model, position, rotation
        self._turned = turned
        # Pairs are sorted by their first geom.
        self._center = lru_cache(2)(partial(_point_positions, model, position, rotation))
        self._apart = lru_cache(1)(self._measure_distance)

    def _measure_distance(self, first: int, second: int) -> tuple[Floats, Floats, Floats]:
        # (N, 3) how centers are apart, (N,) their distance, and (N - 1,) their relative motion [m].
        apart = self._center(first) - self._center(second)
        moved = np.sqrt(squared_lengths(np.diff(apart, axis=0)))
        return apart, np.sqrt(squared_lengths(apart)), moved

    def find_near_steps(self, first: int, second: int, within: Floats) -> NDArray[np.bool_]:
        """Return (N - 1,) whether centers are closer than `within` (N - 1,) [m] before a step."""
        apart, _, _ = self._apart(first, second)
        return np.linalg.norm(apart[:-1], axis=1) < within

    def find_stretch(self, mover: int, wall: int, least: float) -> slice:
        """Return the stretch where a point on a geom's axis may pass through another.

        Steps shorter than `least` [m] do not count. `_first_passage` finds the same in the stretch
        as in the whole run: nothing if it is empty.
        """
        model, kind = self._model, int(self._model.geom_type[wall])
        if model.geom_type[mover] in (_PLANE_TYPE, _HFIELD_TYPE):
            return slice(0)
        apart, distance, relative = self._apart(*sorted((mover, wall)))
        end, below_one = np.linalg.norm(_axis_end(model, mover)), 1 - COARSE_ROUNDING
        if kind == _PLANE_TYPE:
            up = rotate_vectors(model.geom_quat[wall], _UP_AXIS)
            normal = rotate_vectors(self.rotation[:, model.geom_bodyid[wall]], up)
            height = (apart * normal).sum(axis=1) * (1 if mover < wall else -1)
            # A point is beneath a plane if it is lower by the radius of its geom.
            beneath = height.min() - end < -below_one * model.geom_rbound[mover]
            return slice(len(apart) if beneath else 0)
        # Neither moves nor nears more than this in the frame of the wall.
        moved = relative + self._turned[:, model.geom_bodyid[mover]] * end
        moved += self._turned[:, model.geom_bodyid[wall]] * (distance[:-1] + end)
        reach = model.geom_rbound[wall] + _LIMITS.most_steps * moved.max(initial=0)
        near = below_one * (distance[:-1] - end) < reach
        fast = moved > below_one * least
        if not (near & fast).any():
            return slice(0)
        if kind == _HFIELD_TYPE:  # A point beneath one may be far from it.
            return slice(len(apart))
        # A passage begins near the wall, and one of its steps is fast.
        around = _LIMITS.most_steps
        begins = np.flatnonzero(near & (np.convolve(fast, np.ones(around))[around - 1 :] > 0))
        return slice(int(begins[0]), int(begins[-1]) + around + 1)


class _StepSearch:
    """Searches for geoms that pass through each other within one step of a run."""

    def __init__(self, model: mujoco.MjModel, states: Floats, acting: Floats) -> None:
        """Take states (N + 1, nq + nv) and the inputs (N, ...) of each step."""
        self._model, self._data = model, mujoco.MjData(model)
        self._states, self._acting = states, acting

    def find_passages(
        self, pair: tuple[int, int], close: ClosePairs, moved: Floats, *, least: float
    ) -> list[Passage]:
        """Return the first passage of two geoms, if any.

        Each step moves them by at most `moved` (N - 1,) [m]; less than `least` does not matter.
        """
        model = self._model
        if any(model.geom_type[geom] in (_PLANE_TYPE, _HFIELD_TYPE) for geom in pair):
            return []
        bound = float(model.geom_rbound[[*pair]].sum())
        near = close.find_near_steps(*pair, bound + moved)
        for step in np.flatnonzero(near & (moved > least))[: _LIMITS.most_rays].tolist():
            if self._overlaps_within(pair, step, float(moved[step]), least):
                return [_make_passage(model, *pair, step)]
        return []

    def _overlaps_within(
        self, pair: tuple[int, int], step: int, moved: float, least: float
    ) -> bool:
        """Return whether geoms separated before and after a step half overlap within it."""
        model, data = self._model, self._data
        if model.nmocap:
            apply_inputs(model, data, self._acting[step])
        velocity = self._states[step + 1, model.nq :]
        max_instants_per_step = 200  # largest number of instants checked within a step
        ahead = max(least / 2, moved / max_instants_per_step)
        share, deepest = 0.0, 0.0
        while share < 1:
            data.qpos[:] = self._states[step, : model.nq]
            mujoco.mj_integratePos(model, data.qpos, velocity, share * model.opt.timestep)
            distance = self._geom_distance(pair)
            if distance <= 0 and share == 0:
                return False
            deepest = max(deepest, -distance)
            share += max(distance, ahead) / moved
        data.qpos[:] = self._states[step + 1, : model.nq]
        min_overlap = 0.5  # smallest overlap of passing geoms, in half extents of the thinner
        return (
            deepest > min_overlap * half_extents(model)[[*pair]].min()
            and self._geom_distance(pair) > 0
        )

    def _geom_distance(self, pair: tuple[int, int]) -> float:
        mujoco.mj_kinematics(self._model, self._data)
        return mujoco.mj_geomDistance(self._model, self._data, *pair, 1e3, None)


def _make_passage(model: mujoco.MjModel, mover: int, wall: int, step: int) -> Passage:
    bodies = moving_bodies(model, model.geom_bodyid[[mover, wall]])
    return Passage(name_of(model, "geom", mover), name_of(model, "geom", wall), step, bodies)


class _ReachOfSteps(NamedTuple):
    """How far steps may move parts of a model before they pass through others."""

    thinnest: float  # the thinnest half extent [m]
    motion_lengths: Floats  # see `_motion_lengths`
    reaches: Floats  # (nbody,) see `body_reaches` [m]
    pairs: tuple[NDArray[np.intp], NDArray[np.intp]]  # (P,) geoms that may touch
    least: Floats  # (P,) their smallest relevant motion in a step [m]


@lru_cache(maxsize=1)
def _reach_of_steps(model: mujoco.MjModel) -> _ReachOfSteps:
    first, second = touch_places(model)
    on = read_flag(model, "contact") and (len(first) or model.nflex)
    # Half the smallest extents [m]; infinite for geoms that cannot collide.
    meets = (np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)) != 0
    meets[[*model.pair_geom1, *model.pair_geom2]] = True
    half = np.where(meets, half_extents(model), np.inf)
    thinnest = float(half.min(initial=np.inf)) if on else np.inf
    half[np.isin(model.geom_type, (_PLANE_TYPE, _HFIELD_TYPE))] = 0
    least = _LIMITS.least_motion * (half[first] + half[second])
    reaches = body_reaches(model)
    return _ReachOfSteps(thinnest, _motion_lengths(model), reaches, (first, second), least)


def _passages_through_flexes(
    model: mujoco.MjModel, position: Floats, rotation: Floats, vertices: Floats
) -> Iterator[Passage]:
    """Yield the first passage of each geom through each surface of a flex; vertices (N, V, 3)."""
    meets = np.asarray(model.flex_contype)[:, None] & np.asarray(model.geom_conaffinity)
    meets |= np.asarray(model.flex_conaffinity)[:, None] & np.asarray(model.geom_contype)
    endless = np.isin(model.geom_type, (_PLANE_TYPE, _HFIELD_TYPE))
    # A geom that passed a flex is off it by this distance, in half extents, after this time [s].
    clear_seconds, clear_distance = 0.1, 1.5
    for flex, geom in np.argwhere((meets != 0) & ~endless).tolist():
        first = model.flex_vertadr[flex]
        own = model.flex_vertbodyid[first : first + model.flex_vertnum[flex]]
        # The vertices of a cloth's elements, or of a body's shell; none for ropes.
        kind = int(model.flex_dim[flex])
        if kind == 3:
            numbers, starts, data = model.flex_shellnum, model.flex_shelldataadr, model.flex_shell
        else:
            numbers, starts, data = model.flex_elemnum, model.flex_elemdataadr, model.flex_elem
        count = 3 * int(numbers[flex]) if kind > 1 else 0
        faces = data[starts[flex] : starts[flex] + count].reshape(-1, 3)
        if model.geom_bodyid[geom] in own:
            continue
        name = mujoco.mj_id2name(model, int(mujoco.mjtObj.mjOBJ_FLEX), flex) or f"flex[{flex}]"
        thick = float(half_extents(model)[geom] + model.flex_radius[flex])
        if not len(faces):
            # The vertices of a rope, and the middle of each edge.
            edges = model.flex_edgeadr[flex]
            places = [*np.moveaxis(vertices[:, first : first + len(own)], 1, 0)]
            places += [
                vertices[:, first + ends].mean(axis=1)
                for ends in model.flex_edge[edges : edges + model.flex_edgenum[flex]]
            ]
            wall, steps = _PassableGeom(model, geom, float(model.flex_radius[flex])), list[int]()
            for place in places:
                path = _in_geom_frame(model, position, rotation, geom, place)
                steps += _first_passage(path, _LIMITS.least_motion * thick, wall)
            if steps:
                yield Passage(name, name_of(model, "geom", geom), min(steps))
            continue
        corners = vertices[:, first + faces]
        centre = _point_positions(model, position, rotation, geom)
        relative = centre[:, None] - corners.mean(axis=2)
        step = _first_crossing(relative, corners - corners.mean(axis=2, keepdims=True))
        if step is None:
            continue
        # A geom that has only rolled over an edge still lies on it soon after.
        soon = min(step + int(clear_seconds / model.opt.timestep), len(position) - 1)
        way = vertices[soon, first : first + len(own)] - centre[soon]
        if np.linalg.norm(way, axis=1).min() > clear_distance * thick:
            yield Passage(name_of(model, "geom", geom), name, step)


def _first_crossing(points: Floats, corners: Floats) -> int | None:
    """Return the first step where a point crosses a triangle; None if it never does.

    `points` (N, F, 3) of its path and `corners` (N, F, 3, 3) are relative to the triangles' centers
    [m].
    """
    normal = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    height = (points * normal).sum(axis=2)
    for step, face in np.argwhere(height[:-1] * height[1:] < 0).tolist():
        before, after = height[step : step + 2, face]
        crossing = points[step, face] + (points[step + 1, face] - points[step, face]) * before / (
            before - after
        )
        sides = np.roll(corners[step, face], -1, axis=0) - corners[step, face]
        inside = np.cross(sides, crossing - corners[step, face]) @ normal[step, face]
        if (inside >= 0).all():
            return step
    return None


def _motion_lengths(model: mujoco.MjModel) -> Floats:
    """Return (nv,) the distance that each coordinate at unit speed moves a point in 1 s [m]."""
    reach = body_reaches(model)
    for body in range(model.nbody - 1, 0, -1):
        joints = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        slides = any(int(model.jnt_type[joint]) in _TRANSLATIONS for joint in joints)
        beyond = 2 * model.stat.extent if slides else np.linalg.norm(model.body_pos[body])
        parent = model.body_parentid[body]
        reach[parent] = max(reach[parent], beyond + reach[body])
    lengths = reach[model.dof_bodyid] + np.linalg.norm(model.jnt_pos[model.dof_jntid], axis=1)
    for kind, dof in zip(model.jnt_type, model.jnt_dofadr, strict=True):
        lengths[dof : dof + _TRANSLATIONS.get(int(kind), 0)] = 1
    return lengths


def _point_positions(
    model: mujoco.MjModel, position: Floats, rotation: Floats, geom: int, point: Floats = _ORIGIN
) -> Floats:
    """Return (N, 3) the position of a point of a geom, by default its center."""
    body, place = int(model.geom_bodyid[geom]), model.geom_pos[geom]
    if point.any():
        place = place + rotate_vectors(model.geom_quat[geom], point)
    return position[:, body] + rotate_vectors(rotation[:, body], place)


def _in_geom_frame(
    model: mujoco.MjModel, position: Floats, rotation: Floats, wall: int, place: Floats
) -> Floats:
    """Return (N, 3) positions in the frame of a geom; the frame of a sphere is not rotated."""
    body = int(model.geom_bodyid[wall])
    if model.geom_type[wall] == _SPHERE_TYPE:
        return place - _point_positions(model, position, rotation, wall)
    in_body = rotate_vectors_back(rotation[:, body], place - position[:, body])
    return rotate_vectors_back(model.geom_quat[wall], in_body - model.geom_pos[wall])


def _first_passage(
    path: Floats, least: float, wall: "_PassableGeom", turned: Floats | None = None
) -> list[int]:
    """Return the step that ends a point's first passage through a geom, if it ever does.

    The path (N, 3) [m] is in the frame of the geom. Steps shorter than `least` [m] do not count,
    nor those that turn by more than a radian: `turned` (N,) is the angle since the start.
    """
    squares = (np.diff(path, axis=0) ** 2).sum(axis=1)
    fast = squares > least**2
    reach = wall.bound + _LIMITS.most_steps * np.sqrt(squares.max(initial=0))
    if not (fast & ((path[:-1] ** 2).sum(axis=1) < reach**2)).any():
        return []
    max_line_angle_rad = 1.0  # largest angle [rad] for a path of a point that is nearly a line
    for steps in range(1, 1 + _LIMITS.most_steps):
        begin, end = path[:-steps], path[steps:]
        moving = np.convolve(fast, np.ones(steps))[steps - 1 : len(fast)] > 0
        near = np.linalg.norm(begin, axis=1) < np.linalg.norm(end - begin, axis=1) + wall.bound
        if turned is not None:
            near &= turned[steps:] - turned[:-steps] < max_line_angle_rad
        for step in np.flatnonzero(moving & near)[: _LIMITS.most_rays].tolist():
            if wall.has_passed(begin[step], end[step]):
                return [step + steps - 1]
    return []


class _PassableGeom:
    """A geom in its own frame, its reach `bound` [m], and the size of the passing geom."""

    def __init__(self, model: mujoco.MjModel, geom: int, size: float) -> None:
        self._model, self._geom, self._size = model, geom, size
        self._kind = int(model.geom_type[geom])
        self.turns = self._kind != _SPHERE_TYPE
        self.bound = np.inf if self._kind == _PLANE_TYPE else float(model.geom_rbound[geom])
        self._data = mujoco.MjData(model) if self._kind in (_MESH_TYPE, _HFIELD_TYPE) else None
        if self._data is not None:
            self._data.geom_xpos[geom], self._data.geom_xmat[geom] = 0, np.eye(3).ravel()

    def has_passed(self, begin: Floats, end: Floats) -> bool:
        """Return whether the path between points passes through it or ends beneath a surface."""
        if self._kind == _PLANE_TYPE:
            return bool(begin[2] > 0 and end[2] < -self._size)
        if self._kind == _HFIELD_TYPE and self._depth_below(begin) >= 0:
            return False
        if self._kind == _HFIELD_TYPE and self._depth_below(end) > self._size:
            return True
        entry_distance, exit_distance = (
            self._ray_distance(begin, end - begin),
            self._ray_distance(end, begin - end),
        )
        return (
            min(entry_distance, exit_distance) >= 0
            and entry_distance + exit_distance < 1 - SUM_ROUNDING
        )

    def _depth_below(self, point: Floats) -> float:
        """Return the depth of a point beneath a height field [m]; negative if it is above."""
        return self._ray_distance(point, _UP_AXIS)

    def _ray_distance(self, begin: Floats, way: Floats) -> float:
        """Return the share of a ray up to the geom, above 1 if it ends before; -1 if it misses."""
        if self._data is None:
            size = self._model.geom_size[self._geom]
            return mujoco.mju_rayGeom(_ORIGIN, _AXES, size, begin, way, self._kind)
        ray = mujoco.mj_rayMesh if self._kind == _MESH_TYPE else mujoco.mj_rayHfield
        return ray(self._model, self._data, self._geom, begin, way)
