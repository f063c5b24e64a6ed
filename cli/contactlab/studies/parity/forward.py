"""Quantities of a state before its step, by MuJoCo and by another engine, in order."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.engines.adapted_engine import AdaptedEngine
from contactlab.engines.engine import PreparedRuns, SimulationEngine
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.judge.limits import Limit
from contactlab.scene.initial_states import apply_inputs
from contactlab.scene.model_names import name_of
from contactlab.studies.parity.parity_report import Divergence, Stage

Forward = Mapping[str, Sequence[Floats]]  # fields of MuJoCo's data, and `contacts`, of K states

_STAGES: Mapping[Stage, Sequence[str]] = {
    "kinematics": ("xpos", "xquat"),
    "contacts": ("contacts",),
    "forces": ("qfrc_bias", "qfrc_passive", "qfrc_actuator"),
    "smooth acceleration": ("qacc_smooth",),
    "constraint forces": ("qfrc_constraint",),
    "acceleration": ("qacc",),
}
# Tolerances of MuJoCo's own parity checks; units of joint forces differ.
LIMITS = {
    limit.name: limit
    for limit in (
        Limit("xpos", "m", value=1e-5, relative=1e-4),
        Limit("xquat", "1", value=1e-5, relative=1e-4),
        Limit("qfrc_bias", "any", value=1e-3, relative=1e-3),
        Limit("qfrc_passive", "any", value=1e-3, relative=1e-3),
        Limit("qfrc_actuator", "any", value=1e-3, relative=1e-3),
        Limit("qacc_smooth", "any", value=1e-2, relative=1e-3),
        Limit("qfrc_constraint", "any", value=1e-1, relative=1e-2),
        Limit("qacc", "any", value=1e-1, relative=1e-2),
    )
}
FLOOR_FACTOR = 8.0  # allowed multiple of the effect of rounding the state
GRAZING = 1e-5  # rounding decides whether a contact of a smaller distance acts [m]
_NONE = np.empty((0, 19))
_GEOMS, _DISTANCE, _MARGIN, _FRICTION = slice(0, 2), 2, 3, slice(4, 9)
_SOLREF, _SOLIMP, _POSITION, _NORMAL = slice(9, 11), slice(11, 16), slice(16, 19), slice(19, 22)
_OF_CONTACT = {"friction": _FRICTION, "solref": _SOLREF, "solimp": _SOLIMP}


def forward_quantities(engine: SimulationEngine, runs: PreparedRuns) -> Forward | None:
    """Return the quantities that an engine computes at the starts of runs, or None."""
    if isinstance(engine, MujocoEngine):
        values_by_name: dict[str, list[Floats]] = defaultdict(list)
        for run, model in enumerate(runs.models):
            data, start = mujoco.MjData(model), runs.starts
            data.qpos[:], data.qvel[:] = start.qpos[run], start.qvel[run]
            data.act[:] = start.act[run]
            inputs = (start.ctrl[run], start.applied[run], start.mocap[run])
            apply_inputs(model, data, np.concatenate(inputs))
            for name, values in read_forward_quantities(model, data).items():
                values_by_name[name].append(values)
        return values_by_name
    if not isinstance(engine, AdaptedEngine) or not engine.goes_forward:
        return None
    answer = engine.ask(runs, operation="forward")
    return None if isinstance(answer, str) else answer


def read_forward_quantities(model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, Floats]:
    """Compute a state forward, and return its quantities; contacts end with their normals."""
    mujoco.mj_forward(model, data)
    quantities = {name: np.array(getattr(data, name)) for name in LIMITS}
    names = ("geom", "dist", "includemargin", "friction", "solref", "solimp", "pos")
    arrays = [getattr(data.contact, name) for name in names]
    columns = [array if array.ndim > 1 else array[:, None] for array in arrays]
    quantities["contacts"] = np.hstack([*columns, data.contact.frame[:, :3]])
    return quantities


@dataclass(frozen=True)
class ForwardStates:
    """K states of a run, as both engines compute them, and as MuJoCo computes rounded ones."""

    model: mujoco.MjModel
    steps: Sequence[int]  # steps after the states
    ours: Forward
    theirs: Forward
    rounded: Forward

    def first_divergence(self) -> Divergence | None:
        """Return the first stage that differs, where it differs most, or None."""
        for stage, names in _STAGES.items():
            divergences = [
                divergence for name in names for divergence in self._find_divergences(stage, name)
            ]
            if divergences:
                return max(divergences, key=lambda candidate: candidate[0])[1]
        return None

    def _find_divergences(self, stage: Stage, name: str) -> Iterator[tuple[float, Divergence]]:
        """Yield the excess over the tolerance of a quantity, by state."""
        if name not in self.theirs:
            return
        for place, step in enumerate(self.steps):
            if name == "contacts":
                mismatch = self._contacts_at(place).find_mismatch()
            elif (
                stage in {"constraint forces", "acceleration"}
                and self._contacts_at(place).ambiguous
            ):
                continue
            else:
                mismatch = self._find_mismatch(name, place)
            if mismatch:
                excess, what, ours, theirs = mismatch
                divergence = Divergence(
                    stage=stage, quantity=what, step=step, mujoco=ours, engine=theirs
                )
                yield excess, divergence

    def _find_mismatch(self, name: str, place: int) -> "_Mismatch | None":
        ours, theirs, rounded = (
            np.asarray(computed[name][place], np.float64)
            for computed in (self.ours, self.theirs, self.rounded)
        )
        if not ours.size:
            return None
        if name == "xquat":
            theirs = theirs * np.where((ours * theirs).sum(axis=-1, keepdims=True) < 0, -1, 1)
        floor = float(np.abs(ours - rounded).max())
        allowed = LIMITS[name].allow_change(ours) + FLOOR_FACTOR * floor
        excess = np.abs(ours - theirs) / allowed
        excess[~np.isfinite(theirs)] = np.inf
        worst = np.unravel_index(int(excess.argmax()), excess.shape)
        if excess[worst] <= 1:
            return None
        where = ", ".join(map(str, worst))
        return float(excess[worst]), f"{name}[{where}]", float(ours[worst]), float(theirs[worst])

    def _contacts_at(self, place: int) -> "_MatchedContacts":
        sides = (self.ours, self.theirs, self.rounded)
        rows = [side["contacts"][place] if "contacts" in side else _NONE for side in sides]
        return _MatchedContacts(self.model, *map(_by_pair, rows))

    def ambiguous_steps(self) -> set[int]:
        """Return the steps with contacts before them that rounding may change."""
        places = enumerate(self.steps)
        return {step for place, step in places if self._contacts_at(place).ambiguous}


_Mismatch = tuple[float, str, float, float]  # excess, quantity, MuJoCo's, the engine's
_Pair = tuple[int, int]


def _by_pair(rows: Floats) -> dict[_Pair, Floats]:
    """Return contacts (K, 19) by pair of geoms in either order, the deepest first."""
    rows_by_pair: dict[_Pair, list[Floats]] = defaultdict(list)
    for row in rows[np.argsort(rows[:, _DISTANCE], kind="stable")] if len(rows) else rows:
        first, second = sorted(row[_GEOMS].astype(int).tolist())
        rows_by_pair[first, second].append(row)
    return {pair: np.array(values) for pair, values in rows_by_pair.items()}


@dataclass(frozen=True)
class _MatchedContacts:
    """The contacts of one state by pair, without order."""

    model: mujoco.MjModel
    ours: Mapping[_Pair, Floats]
    theirs: Mapping[_Pair, Floats]
    rounded: Mapping[_Pair, Floats]

    @property
    def ambiguous(self) -> set[_Pair]:
        """The grazing pairs, and those with contacts that rounding changes in MuJoCo itself."""
        pairs = self.ours.keys() | self.theirs.keys() | self.rounded.keys()
        return {
            pair
            for pair in pairs
            if any(map(_has_grazing, self._rows_at(pair)))
            or _point_distance(self.ours.get(pair), self.rounded.get(pair)) > GRAZING
        }

    def _rows_at(self, pair: _Pair) -> list[Floats]:
        sides = (self.ours, self.theirs, self.rounded)
        return [side[pair] for side in sides if pair in side]

    def find_mismatch(self) -> _Mismatch | None:
        """Return how the first unambiguous pair differs: in count, depth or parameters."""
        # Single precision explains such a relative difference of parameters, and such an angle
        # between normals [rad].
        single_precision, same_direction = 1e-4, 1e-3
        for pair in sorted((self.ours.keys() | self.theirs.keys()) - self.ambiguous):
            ours, theirs = self.ours.get(pair), self.theirs.get(pair)
            counts = _count_acting(ours), _count_acting(theirs)
            if counts[0] != counts[1]:
                return (
                    np.inf,
                    f"count of {self._name_pair(pair)}",
                    float(counts[0]),
                    float(counts[1]),
                )
            if ours is None or theirs is None or not counts[0]:
                continue
            depths = ours[0, _DISTANCE], theirs[0, _DISTANCE]
            if abs(depths[0] - depths[1]) > GRAZING:
                excess = abs(depths[0] - depths[1]) / GRAZING
                return (
                    excess,
                    f"distance of {self._name_pair(pair)}",
                    float(depths[0]),
                    float(depths[1]),
                )
            if (apart := _point_distance(ours, theirs)) > GRAZING:
                return apart / GRAZING, f"points of {self._name_pair(pair)}", 0.0, apart
            if (turned := _normal_difference(ours, theirs)) > same_direction:
                excess = turned / same_direction
                return excess, f"normal of {self._name_pair(pair)}", 0.0, turned
            for name, columns in _OF_CONTACT.items():
                both = ours[0, columns], theirs[0, columns]
                shares = np.abs(both[0] - both[1]) / (single_precision * (np.abs(both[0]) + 1e-6))
                worst = int(shares.argmax())
                if shares[worst] > 1:
                    values = float(both[0][worst]), float(both[1][worst])
                    return float(shares[worst]), f"{name} of {self._name_pair(pair)}", *values
        return None

    def _name_pair(self, pair: _Pair) -> str:
        return " - ".join(
            name_of(self.model, "geom", geom) if geom >= 0 else "flex" for geom in pair
        )


def _count_acting(rows: Floats | None) -> int:
    return 0 if rows is None else int((rows[:, _DISTANCE] < rows[:, _MARGIN]).sum())


def _point_distance(first: Floats | None, second: Floats | None) -> float:
    """Return the largest distance of an acting point from any point of the other side [m]."""
    if _count_acting(first) != _count_acting(second):
        return np.inf
    if first is None or second is None or not _count_acting(first):
        return 0.0
    ours, theirs = (side[: _count_acting(side), _POSITION] for side in (first, second))
    return float(np.linalg.norm(ours[:, None] - theirs, axis=2).min(axis=1).max())


def _normal_difference(first: Floats, second: Floats) -> float:
    # The angle between the normals of the deepest contacts [rad]; 0 if a normal is missing.
    one, other = first[0, _NORMAL], second[0, _NORMAL]
    if not one.any() or not other.any():
        return 0.0
    if list(first[0, _GEOMS]) != list(second[0, _GEOMS]):
        other = -other
    return float(np.arccos(np.clip(one @ other, -1, 1)))


def _has_grazing(rows: Floats) -> bool:
    return bool((np.abs(rows[:, _DISTANCE] - rows[:, _MARGIN]) <= GRAZING).any())
