"""Runs in closed loop: a policy acts at its rate, and MuJoCo steps natively between its calls.

The runs of a job advance together, so that one call of the policy serves them all. Call k happens
before the first step that starts at or after k / rate; its controls take effect at the first step
that starts at or after a latency more, and stay until the next ones do.
"""

import copy
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from itertools import chain, groupby, pairwise
from pathlib import Path
from statistics import mean
from time import thread_time
from types import ModuleType
from typing import Any, cast

import mujoco
import numpy as np

from contactlab.code_limit import code_limit
from contactlab.contact.trace_arrays import Floats, RecordedControls
from contactlab.engines.engine import (
    Buffers,
    Policy,
    PolicyClass,
    PreparedRuns,
    Proceed,
    Rollout,
    RolloutArrays,
    Watch,
)
from contactlab.engines.mujoco_batch import (
    STATE,
    Recorder,
    driven,
    record_starts,
    recorded,
    start_batch,
)
from contactlab.engines.older_mujoco import SimulationError
from contactlab.errors import SceneError, in_one_line
from contactlab.scene.compile_model import PREFIX
from contactlab.scene.drive.located_drive import LocatedDrive
from contactlab.scene.run_spec import RunSpec
from contactlab.schema.drive import PolicyDrive

_STATE = int(STATE)
_INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_KINDS = int(mujoco.mjtWarning.mjNWARNING)
_COUNT = 1
# A time within this fraction of a step after a step's start counts as that start.
_SNAP = 1e-6
_MISTAKES = (Exception, SystemExit)
# Segments of a flight in which runs step one by one, where it has so many at least.
_SAMPLES, _SEGMENTS = 2, 16
_NOISE = 3  # the stream of a run's seed that noise is drawn from; others perturb its start


class _PolicyFailureError(Exception):
    """A policy cannot act; the message says why."""


Fields = Mapping[Any, np.ndarray]  # what is recorded of each run, by field of MjData: (n, N, ...)
# What one run leaves: its share of CPU time [s], counts of warnings, its error, its controls.
_Flown = tuple[float, np.ndarray, str | None, RecordedControls | None]


def fly(runs: PreparedRuns, buffers: Buffers, watch: Watch, proceed: Proceed) -> Rollout:
    """Simulate runs in closed loop, as `SimulationEngine.roll_out` says.

    The cost of each is its share, by its steps and samples of what they take, of the time of all.
    If the sweep should stop, the first run alone goes on to its end.
    """
    count = len(runs.prepared)
    arrays = buffers.arrays(runs.models[0], count, runs.steps)
    record_starts(runs.starts, arrays)
    recorder = Recorder(runs.models, runs.steps, count)
    flown: list[_Flown] = []
    for _, group in groupby(range(len(runs.prepared)), lambda run: _pace(runs.resolved[run])):
        places = list(group)
        if places[0] and not proceed():
            break
        rows = slice(places[0], places[-1] + 1)
        fields = {name: field[rows] for name, field in recorder.fields.items()}
        flown += _together(runs.rows(places), arrays.rows(rows), fields, watch, proceed)
        if len(flown) <= places[-1]:
            break
    cost, warnings, errors, controls = zip(*flown, strict=True)
    rollout = recorded(arrays, np.array(cost), np.array(warnings), errors, controls)
    acted = {run: control for run, control in enumerate(controls) if control is not None}
    if acted:
        # Nothing is asked of those that failed: what acted elsewhere stands in.
        some, *_ = acted.values()
        starts = runs.starts.acted_on([acted.get(run, some) for run in range(count)])
        for run in acted:
            recorder.enter(run, run, runs.models[run], starts, arrays.state[run])
    return recorder.told(rollout)


def _drive(run: RunSpec) -> PolicyDrive:
    assert isinstance(run.drive, PolicyDrive)
    return run.drive


def _pace(run: RunSpec) -> tuple[float, ...]:
    """Return what runs share whose policy acts before the same steps."""
    return run.timestep, _drive(run).rate, _drive(run).latency_seconds


def _together(
    runs: PreparedRuns, arrays: RolloutArrays, fields: Fields, watch: Watch, proceed: Proceed
) -> list[_Flown]:
    """Simulate runs of one pace together; one by one where the policy fails with all of them."""
    count = len(runs.prepared)
    watch()  # Making the policy is a part of its run.
    try:
        with redirect_stdout(sys.stderr):
            return _Flight(runs, arrays, fields).fly(watch, proceed)
    except _PolicyFailureError as failure:
        if count == 1:
            return [(0.0, np.zeros(_KINDS, np.int32), str(failure), None)]
    flown: list[_Flown] = []
    for run in range(count):
        if run and not proceed():
            break
        row = slice(run, run + 1)
        own = {name: field[row] for name, field in fields.items()}
        flown += _together(runs.rows([run]), arrays.rows(row), own, watch, proceed)
    return flown


class _Flight:
    """n runs that one instance of a policy acts in."""

    def __init__(self, runs: PreparedRuns, arrays: RolloutArrays, fields: Fields) -> None:
        self._runs, self._models, self._arrays = runs, runs.models, arrays
        self._out: dict[Any, np.ndarray] = {
            _STATE: arrays.state[:, 1:],
            "sensordata": arrays.sensors,
            "solver_niter": arrays.iterations,
            **fields,
        }
        self._batch = start_batch(self._models, runs.starts)
        self._controls = self._batch.bind("ctrl")
        self._pushed = bool((runs.starts.driven >= self._controls.shape[1]).any())
        self._timestep = runs.resolved[0].timestep
        self._calls = self._call_steps()
        self._delay = _first_step(_drive(runs.resolved[0]).latency_seconds / self._timestep)
        self._noise = [self._drawn(run) for run in runs.resolved]
        self._sensors = _own_sensors(runs.base.model)
        self._flying = list(range(len(self._models)))
        self._errors: list[str | None] = [None] * len(self._models)
        self._acted: dict[int, Floats] = {0: self._controls.copy()}
        self._ends = [runs.steps] * len(self._models)
        self._taken, self._sampled = 0.0, [list[float]() for _ in self._models]
        assert runs.policy is not None
        self._name = getattr(runs.policy, "__name__", "policy")
        self._policy = self._made(runs.policy, runs.base.model)

    def fly(self, watch: Watch, proceed: Proceed) -> list[_Flown]:
        """Simulate them all; return the first alone if the sweep should stop meanwhile."""
        count, calls = len(self._models), {step: call for call, step in enumerate(self._calls)}
        waiting: dict[int, Floats] = {}
        marks = {0, *calls, *(step + self._delay for step in calls)}
        slices = -1
        begins = sorted(step for step in marks if step < self._runs.steps)
        each = max(_SEGMENTS, len(begins)) // _SAMPLES
        samples = set(begins[each // 2 :: each] if count > 1 else ())
        for begin, end in pairwise([*begins, self._runs.steps]):
            if begin in calls:
                # n time limits for n runs: each for as many calls as an n-th of all runs takes.
                if (now := calls[begin] * count // len(calls)) > slices:
                    slices = now
                    watch()
                if begin and count > 1 and not proceed():
                    count, self._flying = 1, [run for run in self._flying if run == 0]
                waiting[begin + self._delay] = self._ask(calls[begin], begin)
            if begin in waiting:
                self._acted[begin] = waiting.pop(begin)
                self._controls[self._flying] = self._acted[begin][self._flying]
            if not self._flying:
                break
            self._step(begin, end, one_by_one=begin in samples)
        return self._flown(count)

    def _call_steps(self) -> list[int]:
        rate, timestep = _drive(self._runs.resolved[0]).rate, self._timestep
        period = 1 / (rate * timestep)
        if period < 1 - _SNAP:
            raise _PolicyFailureError(
                f"the policy is to act at {rate:g} Hz, but steps of {timestep:g} s are "
                f"{1 / timestep:g} Hz; lower its rate, or the timestep"
            )
        most = int(self._runs.steps / period) + 1
        steps = (_first_step(call * period) for call in range(most + 1))
        return [step for step in steps if step < self._runs.steps]

    def _drawn(self, run: RunSpec) -> Floats:
        """Return (calls, 2, nv) noise of positions and velocities; the same at any timestep."""
        noise, shape = _drive(run).noise, (len(self._calls), 2, self._models[0].nv)
        if not (noise.qpos or noise.qvel):
            return np.empty(0)
        scale = np.array([noise.qpos, noise.qvel])[:, None]
        return scale * np.random.default_rng([run.seed, _NOISE]).standard_normal(shape)

    def _made(self, policy: PolicyClass, model: mujoco.MjModel) -> Policy:
        try:
            with code_limit():
                made = policy(copy.copy(model))
        except _MISTAKES as error:
            raise self._failed("", error) from error
        if not callable(made):
            raise _PolicyFailureError(
                f"policy {self._name} cannot be called; give it a method "
                "__call__(self, time, qpos, qvel, sensordata)"
            )
        return made

    def _failed(self, when: str, error: BaseException) -> BaseException:
        """Return the failure that an error of the policy is, but for a lack of memory."""
        if isinstance(error, MemoryError):
            return error
        return _PolicyFailureError(f"policy {self._name}{when}: {in_one_line(error, __file__)}")

    def _ask(self, call: int, step: int) -> Floats:
        """Return (n, nu) what the policy wants of what it observes before a step."""
        try:
            returned = np.asarray(self._policy(*self._observed(call, step)))
        except _MISTAKES as error:
            raise self._failed(f", at {step * self._timestep:g} s", error) from error
        if returned.shape != self._controls.shape:
            raise _PolicyFailureError(
                f"policy {self._name} returned an array of shape {returned.shape}; one control for "
                f"each run and actuator is {self._controls.shape}"
            )
        if returned.dtype.kind not in "fiu":
            raise _PolicyFailureError(
                f"policy {self._name} returned {returned.dtype}; controls are real numbers"
            )
        # Adding 0 makes -0.0 a 0.0, which no replay could tell apart from it.
        wanted = returned.astype(np.float64) + 0.0
        if not np.isfinite(wanted).all():
            self._refuse(wanted, step)
        return wanted

    def _refuse(self, wanted: Floats, step: int) -> None:
        """Land the runs for which the policy wants something that is no number."""
        time = step * self._timestep
        for run in [run for run in self._flying if not np.isfinite(wanted[run]).all()]:
            actuator = int(np.flatnonzero(~np.isfinite(wanted[run]))[0])
            name = self._models[run].actuator(actuator).name
            self._errors[run] = (
                f"policy {self._name} returned {wanted[run, actuator]:g} for {name} at {time:g} s"
            )
            self._land([run], step)

    def _observed(self, call: int, step: int) -> tuple[Floats, Floats, Floats, Floats]:
        """Return copies of (n,) times, (n, nq) and (n, nv) noisy states, and sensor data."""
        model, state = self._models[0], self._arrays.state[:, step]
        velocity = 1 + model.nq
        time, qpos = state[:, 0].copy(), state[:, 1:velocity].copy()
        qvel = state[:, velocity : velocity + model.nv].copy()
        for run in self._flying:
            if self._noise[run].size:
                offset, speed = self._noise[run][call]
                mujoco.mj_integratePos(self._models[run], qpos[run], offset, 1.0)
                qvel[run] += speed
        return time, qpos, qvel, self._measured(step)

    def _measured(self, step: int) -> Floats:
        """Return (n, ...) the model's own sensors in the last step; before any, at the start."""
        if step or not self._sensors:
            return self._arrays.sensors[:, step - 1, : self._sensors].copy()
        measured = np.empty((len(self._models), self._sensors))
        for run, model in enumerate(self._models):
            data = mujoco.MjData(model)
            mujoco.mj_setState(model, data, self._batch.state[run], _INTEGRATION)
            mujoco.mj_forward(model, data)
            measured[run] = data.sensordata[: self._sensors]
        return measured

    def _step(self, begin: int, end: int, *, one_by_one: bool) -> None:
        """Step the runs that fly; one by one to sample what each takes."""
        for runs in [[run] for run in self._flying] if one_by_one else [self._flying]:
            taken = self._step_runs(runs, begin, end)
            self._taken += taken
            if one_by_one:
                self._sampled[runs[0]].append(taken)
        warned = self._batch.warning[:, :, _COUNT]
        if warned[self._flying].any() or any(self._errors):
            self._land([run for run in self._flying if warned[run].any() or self._errors[run]], end)

    def _step_runs(self, runs: list[int], begin: int, end: int) -> float:
        """Step runs, record them, and return the CPU time of the steps [s]."""
        shape = len(runs), end - begin
        out = {
            key: np.empty((*shape, *array.shape[2:]), array.dtype)
            for key, array in self._out.items()
        }
        # A slice where all fly, since it copies faster than a list.
        ids = runs if len(runs) < len(self._models) else None
        rows = slice(None) if ids is None else ids
        inputs, start = self._inputs(runs, begin, end), thread_time()
        try:
            self._batch.rollout(end - begin, record=list(out), ids=ids, out=out, **inputs)
        except SimulationError:
            for run in runs:
                self._errors[run] = self._batch.error(run) or None
        taken = thread_time() - start
        for name, array in self._out.items():
            array[rows, begin:end] = out[name]
        return taken

    def _inputs(self, runs: list[int], begin: int, end: int) -> dict[str, Any]:
        """Return a batch's arguments where a scene drives forces beside the policy."""
        if not self._pushed:
            return {}
        starts = self._runs.starts
        each = [driven(self._models[run], starts, run, end - begin, begin) for run in runs]
        control = np.concatenate([one["control"] for one in each])
        control[:, :, : self._controls.shape[1]] = self._controls[runs][:, None]
        return {**each[0], "control": control}

    def _land(self, runs: Sequence[int], step: int) -> None:
        """Leave runs at the state before a step: they stopped or failed."""
        for run in runs:
            self._ends[run] = step
            for array in self._out.values():
                array[run, step:] = array[run, max(step - 1, 0)]
            self._arrays.state[run, step + 1 :] = self._arrays.state[run, step]
        self._flying = [run for run in self._flying if run not in runs]

    def _flown(self, count: int) -> list[_Flown]:
        """Return what the first runs leave."""
        warnings, every = self._batch.warning[:, :, _COUNT], [*chain(*self._sampled)] or [1.0]
        weights = np.array(self._ends) * [mean(samples or every) for samples in self._sampled]
        cost = self._taken * weights / max(weights.sum(), np.finfo(float).tiny)
        steps, levels = np.array(list(self._acted)), np.array(list(self._acted.values()))
        duration = max(self._runs.resolved[0].duration, self._runs.steps * self._timestep)
        flown: list[_Flown] = []
        for run in range(count):
            controls, acted = None, int(np.searchsorted(steps, max(self._ends[run], 1)))
            if not self._errors[run]:
                # A last row at the end, so that as a table they last as long as the run.
                rows = [*range(acted), acted - 1]
                times = np.append(steps[:acted] * self._timestep, duration)
                controls = RecordedControls(times, levels[rows, run])
            flown.append((float(cost[run]), warnings[run], self._errors[run], controls))
        return flown


def _first_step(time: float) -> int:
    """Return the first step that starts at or after a time, in steps."""
    return int(np.ceil(time - _SNAP))


def _own_sensors(model: mujoco.MjModel) -> int:
    """Return how many numbers a model's own sensors measure; those that record come after them."""
    own = [
        sensor
        for sensor in range(model.nsensor)
        if not model.sensor(sensor).name.startswith(PREFIX)
    ]
    return int((model.sensor_adr + model.sensor_dim)[own].max(initial=0))


def allowed_policy(drive: LocatedDrive, *, allowed: bool) -> LocatedDrive | None:
    """Return a drive if it is a policy; a SceneError if its code is not allowed, or fails."""
    if not isinstance(drive.drive, PolicyDrive):
        return None
    if not allowed:
        raise SceneError(
            f"drive: {drive.files[0]} is Python code, which runs only if you allow it; add "
            "--allow-code, or allow_code=True in Python"
        )
    load_policy(drive)
    return LocatedDrive(drive.drive, tuple(file.absolute() for file in drive.files))


def load_policy(located: LocatedDrive) -> PolicyClass:
    """Return the class of a policy; a SceneError if its file changed, fails or lacks it."""
    assert isinstance(located.drive, PolicyDrive)
    located.check()
    name = located.drive.policy.rpartition(":")[2]
    return cast("PolicyClass", load_code("policy", located.files[0], name))


def load_code(what: str, file: Path, name: str) -> Callable[..., object]:
    """Return a class or function of a file; a SceneError if that fails, or lacks it."""
    module = ModuleType(f"contactlab_{what}_{file.stem}")
    module.__file__ = str(file)
    # Classes of the module can be pickled once it is listed.
    sys.modules[module.__name__] = module
    try:
        with code_limit():
            exec(compile(file.read_bytes(), file, "exec"), module.__dict__)  # noqa: S102 - allowed
    except (Exception, SystemExit) as error:
        raise SceneError(f"{what} {file}: {in_one_line(error, __file__)}") from error
    found = getattr(module, name, None)
    if not callable(found):
        raise SceneError(f"{what} {file}: it has no class {name}{_classes(module)}")
    return found


def _classes(module: ModuleType) -> str:
    classes = [item for item in vars(module).items() if isinstance(item[1], type)]
    own = [name for name, kind in classes if kind.__module__ == module.__name__]
    return f"; write one of {', '.join(own)}" if own else ""
