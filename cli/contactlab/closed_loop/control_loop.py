"""A model under a controller: its control period as a map, linearized and simulated.

The state of a loop is the state of the model, the controls that act, those that wait for their
latency, the memory of the controller, and the sensors of the last step. One control
period maps it to the next state. All rows of a batch make the period at once, so the derivative of
the map is a central difference between rows, whatever the integrator is.
"""

import copy
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.engines.engine import PolicyClass
from contactlab.errors import SceneError, in_one_line
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.scene.compile_model import SENSOR_PREFIX

Path = tuple[Any, ...]
"""Names and places that lead from a controller to an array."""
INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)


@dataclass(frozen=True)
class ControlLoop:
    """A model and its controller.

    Attributes:
        model: with its timestep, the longest of the loop: a period has a whole number of steps.
        policy: makes the controller.
        start: (nstate,) of mjSTATE_INTEGRATION.
        rate: calls per second [Hz].
        latency: from observation to action [s].
        gain: factor on the differences between the controls of two rows.
        moves_mocap: whether controls end with the positions of the mocap bodies.
    """

    model: mujoco.MjModel
    policy: PolicyClass
    start: Floats
    rate: float
    latency: float = 0.0
    gain: float = 1.0
    moves_mocap: bool = False

    @cached_property
    def substeps(self) -> int:
        """Number of steps of a period."""
        return max(1, math.ceil(1 / (self.rate * self.model.opt.timestep) - COARSE_ROUNDING))

    @property
    def timestep(self) -> float:
        """Step of the loop [s]."""
        return 1 / (self.rate * self.substeps)

    @cached_property
    def nudge(self) -> float:
        """Offset of central differences and of runs: far above rounding, far below a stroke.

        It is larger for controllers in single precision, which answer no offset of 1e-11.
        """
        rows = LoopRows(self).repeat_row(3)
        usual, coarse = 1e-6, 1e-3
        for row, offset in ((1, 1e-11), (2, coarse)):
            rows.nudge_velocity(row, np.full(self.model.nv, offset))
        one, near, far = rows.ask_policy()
        return coarse if np.array_equal(one, near) and not np.array_equal(one, far) else usual

    @property
    def delay(self) -> tuple[int, int]:
        """Whole periods, and steps after them, from observation to action."""
        steps = max(0, math.ceil(self.latency / self.timestep - COARSE_ROUNDING))
        return divmod(steps, self.substeps)

    @cached_property
    def driven_dofs(self) -> np.ndarray:
        """Ids of the degrees of freedom of slides and hinges that actuators move."""
        kinds = self.model.jnt_type[self.model.dof_jntid[self._moved_dofs]]
        return self._moved_dofs[kinds >= int(mujoco.mjtJoint.mjJNT_SLIDE)]

    @cached_property
    def robot_dofs(self) -> np.ndarray:
        """Ids of all degrees of freedom that are in a tree with one that actuators move.

        An object on a table may rock forever at a thousandth of its size, and no loop causes it.
        """
        trees = self.model.dof_treeid
        moved = np.isin(trees, trees[self._moved_dofs])
        return np.flatnonzero(moved) if moved.any() else np.arange(self.model.nv)

    @cached_property
    def _moved_dofs(self) -> np.ndarray:
        data = mujoco.MjData(self.model)
        mujoco.mj_setState(self.model, data, self.start, INTEGRATION)
        mujoco.mj_forward(self.model, data)
        return np.unique(np.ravel(data.moment_colind)[np.ravel(data.actuator_moment) != 0])

    def with_armature(self, least: float) -> "ControlLoop":
        """Return the loop with at least this armature of each driven degree of freedom."""
        return self._with_least("dof_armature", least)

    def with_damping(self, least: float) -> "ControlLoop":
        """Return the loop with at least this damping of each driven degree of freedom."""
        return self._with_least("dof_damping", least)

    def _with_least(self, field: str, least: float) -> "ControlLoop":
        model, dofs = copy.copy(self.model), self.driven_dofs
        values = getattr(model, field)
        values[dofs] = np.maximum(values[dofs], least)
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return replace(self, model=model)


def _copy_controller(controller: Any) -> Any:  # noqa: ANN401 - code
    # Parts that cannot be copied, such as sessions of networks, keep no state between calls.
    shared = dict[int, Any]()

    def share_parts(part: Any) -> None:  # noqa: ANN401 - likewise
        try:
            copy.deepcopy(part, shared.copy())
        except TypeError:
            inner = getattr(part, "__dict__", None)
            if not inner:
                shared[id(part)] = part
            for value in (inner or {}).values():
                share_parts(value)

    share_parts(controller)
    return copy.deepcopy(controller, shared)


class LoopRows:
    """Loops that run next to each other, with one instance of the controller."""

    def __init__(self, loop: ControlLoop) -> None:
        """Begin with one row, at the loop's start."""
        self.loop, self.model = loop, copy.copy(loop.model)
        self.model.opt.timestep = loop.timestep
        self.model.opt.tolerance = min(self.model.opt.tolerance, 1e-12)  # for differences
        data = mujoco.MjData(self.model)
        mujoco.mj_setState(self.model, data, loop.start, INTEGRATION)
        mujoco.mj_forward(self.model, data)
        placed = data.mocap_pos.ravel() if loop.moves_mocap else ()
        self.data, self.controls = [data], np.concatenate([data.ctrl, placed])[None]
        self.waiting = [self.controls.copy() for _ in range(loop.delay[0])]
        own = [
            sensor
            for sensor in range(self.model.nsensor)
            if not self.model.sensor(sensor).name.startswith(SENSOR_PREFIX)
        ]
        self._sensors = int((self.model.sensor_adr + self.model.sensor_dim)[own].max(initial=0))
        self._policy: Any = loop.policy(copy.copy(loop.model))
        self._first: Floats | None = None
        # Arrays made before the first call do not depend on the number of rows: not memory.
        self._known = {path: owner[key] for path, (owner, key) in self._list_arrays()}
        self._memory: tuple[Path, ...] | None = None

    def make_periods(self, periods: int = 1) -> bool:
        """Make control periods; return whether MuJoCo raised no warning."""
        first = self.loop.delay[1]
        for _ in range(periods):
            self.waiting.append(self.ask_policy())
            self._make_step(first)
            self.controls = self.waiting.pop(0)
            self._make_step(self.loop.substeps - first)
            if not all(np.isfinite(data.qvel).all() for data in self.data):
                return False
        return not any(data.warning.number.any() for data in self.data)

    def repeat_row(self, count: int) -> "LoopRows":
        """Return `count` rows, all in the state of the first one."""
        if self._memory is None:
            rows, known_arrays = len(self.data), self._known
            self._memory = tuple(
                path
                for path, (owner, key) in self._list_arrays()
                if owner[key] is not known_arrays.get(path) and len(owner[key]) == rows
            )
        repeated = copy.copy(self)
        repeated.data = [copy.copy(self.data[0]) for _ in range(count)]
        repeated.controls = np.repeat(self.controls[:1], count, axis=0)
        repeated.waiting = [np.repeat(each[:1], count, axis=0) for each in self.waiting]
        repeated._policy = _copy_controller(self._policy)
        for owner, key in repeated._list_memory():
            owner[key] = np.repeat(owner[key][:1], count, axis=0)
        return repeated

    def nudge_velocity(self, row: int, nudge: Floats) -> None:
        """Add (nv,) to the velocity of a row."""
        self.data[row].qvel += nudge

    def linearize_period(self) -> Floats:
        """Return the derivative of the next period at the state of the first row."""
        alone = self.repeat_row(1)
        size = len(alone._read_state(0, 0))
        rows = self.repeat_row(1 + 2 * size)
        nudge = self.loop.nudge
        for place in range(size):
            rows._nudge_state(1 + 2 * place, place, nudge)
            rows._nudge_state(2 + 2 * place, place, -nudge)
        rows.make_periods()
        ends = np.array([rows._read_state(row, 0) for row in range(1, 1 + 2 * size)])
        return ((ends[::2] - ends[1::2]) / (2 * nudge)).T

    @property
    def policy(self) -> Any:  # noqa: ANN401 - code
        """The controller."""
        return self._policy

    def linearize_policy(self) -> Floats:
        """Return (nu, 2 nv) the derivative of the controls by positions and velocities."""
        self.ask_policy()  # the controller makes its memory in its first call
        size, nudge = 2 * self.model.nv, self.loop.nudge
        rows = self.repeat_row(1 + 2 * size)
        for place in range(size):
            rows._nudge_state(1 + 2 * place, place, nudge)
            rows._nudge_state(2 + 2 * place, place, -nudge)
        controls = rows.ask_policy()[1:]
        return ((controls[::2] - controls[1::2]) / (2 * nudge)).T

    def find_difference(self, row: int) -> float:
        """Return how much a row's velocity of the robot differs from the first [rad/s or m/s]."""
        difference = self.data[row].qvel - self.data[0].qvel
        return float(np.linalg.norm(difference[self.loop.robot_dofs]))

    def ask_policy(self) -> Floats:
        """Return (rows, nu) the controls for the states of the rows."""
        time = np.array([data.time for data in self.data])
        qpos, qvel = (np.array([getattr(d, name) for d in self.data]) for name in ("qpos", "qvel"))
        sensor_values = np.array([data.sensordata[: self._sensors] for data in self.data])
        try:
            requested = np.asarray(self._policy(time, qpos, qvel, sensor_values), np.float64)
        except Exception as error:
            raise SceneError(f"the policy failed: {in_one_line(error, __file__)}") from error
        if requested.shape != self.controls.shape:
            raise SceneError(
                f"the policy returned an array of shape {requested.shape}; one control for each "
                "run "
                f"and actuator is {self.controls.shape}"
            )
        first = requested[0].copy() if self._first is None else self._first
        self._first = first
        # A loop that does not hold has no run to keep: its controls shrink toward the first ones.
        about = requested[:1] if self.loop.gain > 1 else first[None]
        return about + self.loop.gain * (requested - about)

    def _make_step(self, count: int) -> None:
        if count:
            for data, control in zip(self.data, self.controls, strict=True):
                data.ctrl[:] = control[: self.model.nu]
                if self.loop.moves_mocap:
                    data.mocap_pos[:] = control[self.model.nu :].reshape(-1, 3)
                mujoco.mj_step(self.model, data, nstep=count)

    def _list_arrays(self) -> Iterator[tuple[Path, tuple[Any, Any]]]:
        # Path, container and key of each array that the controller keeps.
        root = vars(self._policy) if hasattr(self._policy, "__dict__") else {}
        todo: list[tuple[Path, Any]] = [((), root)]
        seen_ids = set[int]()
        while todo:
            path, owner = todo.pop()
            if id(owner) in seen_ids:
                continue
            seen_ids.add(id(owner))
            items = owner.items() if isinstance(owner, dict) else enumerate(owner)
            for key, value in list(items):
                place = (*path, key)
                if isinstance(value, np.ndarray) and value.dtype.kind == "f" and value.ndim:
                    yield place, (owner, key)
                elif isinstance(value, dict | list):
                    todo.append((place, value))
                elif type(value).__module__ == type(self._policy).__module__:
                    todo.append((place, vars(value) if hasattr(value, "__dict__") else {}))

    def _list_memory(self) -> list[tuple[Any, Any]]:
        arrays = dict(self._list_arrays())
        return [arrays[path] for path in self._memory or ()]

    def _state_parts(self, row: int) -> list[Floats]:
        # Views, except of positions, which have a tangent of their own.
        data = self.data[row]
        parts: list[Floats] = [data.qvel, data.act]
        if self.loop.delay != (0, 0):
            parts += [self.controls[row], *(each[row] for each in self.waiting)]
        parts += [owner[key][row : row + 1].reshape(-1) for owner, key in self._list_memory()]
        return [*parts, data.sensordata[: self._sensors]]

    def _read_state(self, row: int, base: int) -> Floats:
        positions = np.empty(self.model.nv)
        mujoco.mj_differentiatePos(
            self.model, positions, 1.0, self.data[base].qpos, self.data[row].qpos
        )
        parts = zip(self._state_parts(row), self._state_parts(base), strict=True)
        return np.concatenate([positions, *(one - other for one, other in parts)])

    def _nudge_state(self, row: int, place: int, nudge: float) -> None:
        data, size = self.data[row], self.model.nv
        if place < size:
            way = np.zeros(size)
            way[place] = nudge
            mujoco.mj_integratePos(self.model, data.qpos, way, 1.0)
            return
        place -= size
        for part in self._state_parts(row):
            if place < len(part):
                part[place] += nudge
                return
            place -= len(part)


def find_modes(loop: ControlLoop, times: Floats) -> tuple[float, int]:
    """Return the largest growth rate of a mode [1/s] and the degree of freedom that it moves most.

    It is the largest at states of the loop's own run at these times [s]; infinite for a run that
    MuJoCo gives up.
    """
    rows, worst, dof = LoopRows(loop), -math.inf, 0
    rows.make_periods()  # the controller makes its memory in its first call
    period_count = 1
    for time in times:
        periods = max(0, round(time * loop.rate) - period_count)
        if not rows.make_periods(periods):
            return worst if worst > 0 else math.inf, dof
        period_count += periods
        values, shapes = np.linalg.eig(rows.linearize_period())
        energies = np.abs(shapes[loop.model.nv : 2 * loop.model.nv]) ** 2
        mass = np.empty((rows.model.nv, rows.model.nv))
        for row, unit in zip(mass, np.eye(rows.model.nv), strict=True):
            mujoco.mj_mulM(rows.model, rows.data[0], row, unit)
        energies *= np.diag(mass)[:, None]
        # The loop has modes of the robot and of controls, not those of objects alone.
        of_robot = energies[loop.robot_dofs].sum(axis=0) >= 1e-3 * energies.sum(axis=0)
        place = int(np.where(of_robot, np.abs(values), 0.0).argmax())
        rate = math.log(max(abs(values[place]), 1e-300)) * loop.rate
        if rate > worst:
            worst, dof = rate, int(energies[:, place].argmax())
    return worst, dof


def simulate_growth(loop: ControlLoop, seconds: float) -> float:
    """Return how fast small offsets of a loop grow in its own run [1/s].

    Two rows begin with velocities slightly off. Growth is between the second tenth and the last
    fifth; it is infinite if MuJoCo gives up, if offsets leave the small quickly, or if the run
    itself alternates from period to period, as all its rows may do in step.
    """
    periods = max(20, round(seconds * loop.rate))
    rows = LoopRows(loop).repeat_row(3)
    random = np.random.default_rng(0)
    for row in (1, 2):
        rows.nudge_velocity(row, loop.nudge * random.standard_normal(loop.model.nv))
    differences, speeds = np.zeros(periods), np.zeros((periods, len(loop.robot_dofs)))
    # No small motion of a loop is faster than half its rate: beyond, its offset has grown.
    beyond = max(1e-4, 3 * loop.nudge) * math.pi * loop.rate
    for period in range(periods):
        if not rows.make_periods():
            return math.inf
        speeds[period] = rows.data[0].qvel[loop.robot_dofs]
        differences[period] = max(rows.find_difference(row) for row in (1, 2))
        if differences[period] > beyond:
            return math.inf
    late_speeds = speeds[4 * periods // 5 :]
    change = np.linalg.norm(np.diff(late_speeds, axis=0), axis=1)
    turn = np.linalg.norm(np.diff(late_speeds, n=2, axis=0), axis=1)
    if len(turn) and np.median(turn) > max(0.5 * np.median(change), beyond / 100):
        return math.inf  # it alternates in step
    early = differences[periods // 10 : 3 * periods // 10].max()
    late = differences[4 * periods // 5 :].max()
    span = 0.7 * periods / loop.rate
    return math.log(max(late, 1e-300) / max(early, 1e-300)) / span
