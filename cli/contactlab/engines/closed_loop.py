"""Runs in closed loop: a policy acts at its rate, and MuJoCo steps natively between its calls.

The runs of a job advance together, so that one call of the policy serves them all. Call k happens
before the first step that starts at or after k / rate. Its controls take effect at the first step
that starts at or after an additional latency, and stay until the next ones take effect.
"""

import copy
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from inspect import signature
from itertools import chain, groupby, pairwise
from pathlib import Path
from statistics import mean
from time import thread_time
from types import ModuleType
from typing import Any, cast

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats, RecordedControls
from contactlab.engines.engine import (
    Buffers,
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
    completed_rollout,
    driven_inputs,
    record_starts,
    start_batch,
)
from contactlab.engines.older_mujoco import SimulationError
from contactlab.engines.pd_controller import PdController, send_targets
from contactlab.errors import SceneError, in_one_line
from contactlab.foreign_code import ends_command, kept_folder, limited_code, printed_as_text
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.scene.compile_model import SENSOR_PREFIX
from contactlab.scene.drive.located_drive import LocatedDrive
from contactlab.scene.run_spec import RunSpec
from contactlab.schema.drive import PdDrive, PolicyDrive, acts_too_often

_STATE = int(STATE)
_INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_WARNING_KINDS = int(mujoco.mjtWarning.mjNWARNING)


class _PolicyFailureError(Exception):
    """A policy cannot act; the message gives the reason."""


Fields = Mapping[Any, np.ndarray]  # recorded arrays of runs, by field of MjData: (n, N, ...)
# Result of one run: its share of CPU time [s], counts of warnings, its error, its controls.
_RunResult = tuple[float, np.ndarray, str | None, RecordedControls | None]


def roll_out_policy(
    runs: PreparedRuns, buffers: Buffers, watch: Watch, proceed: Proceed
) -> Rollout:
    """Simulate runs in closed loop; see `SimulationEngine.roll_out`.

    The cost of each is its share of the total time, by its steps and samples of their time. If the
    sweep should stop, only the first run continues to its end.
    """
    count = len(runs.prepared)
    arrays = buffers.arrays(runs.models[0], count, runs.steps)
    record_starts(runs.starts, arrays)
    recorder = Recorder(runs.models, runs.steps, count)
    flown: list[_RunResult] = []
    for _, group in groupby(range(len(runs.prepared)), lambda run: _pace_key(runs.resolved[run])):
        places = list(group)
        if places[0] and not proceed():
            break
        rows = slice(places[0], places[-1] + 1)
        fields = {name: field[rows] for name, field in recorder.fields.items()}
        flown += _fly_together(runs.rows(places), arrays.rows(rows), fields, watch, proceed)
        if len(flown) <= places[-1]:
            break
    cost, warnings, errors, controls = zip(*flown, strict=True)
    rollout = completed_rollout(arrays, np.array(cost), np.array(warnings), errors, controls)
    acted = {run: control for run, control in enumerate(controls) if control is not None}
    if acted:
        # Failed runs need no controls, so those of another run replace theirs.
        some, *_ = acted.values()
        starts = runs.starts.with_recorded_inputs([acted.get(run, some) for run in range(count)])
        for run in acted:
            recorder.enter_run(run, run, runs.models[run], starts, arrays.state[run])
    return recorder.attach_outputs(rollout)


def _policy_drive(run: RunSpec) -> PolicyDrive:
    assert isinstance(run.drive, PolicyDrive)
    return run.drive


def _pace_key(run: RunSpec) -> tuple[float, ...]:
    """Return the key of runs with a policy that acts before the same steps."""
    return run.timestep, _policy_drive(run).rate, _policy_drive(run).latency_seconds


def _fly_together(
    runs: PreparedRuns, arrays: RolloutArrays, fields: Fields, watch: Watch, proceed: Proceed
) -> list[_RunResult]:
    """Simulate runs of one pace together, or one by one if the policy fails with all of them."""
    count = len(runs.prepared)
    watch()  # The construction of the policy counts as a part of its run.
    try:
        with kept_folder(), printed_as_text():
            return _Flight(runs, arrays, fields).fly_runs(watch, proceed)
    except _PolicyFailureError as failure:
        if count == 1:
            return [(0.0, np.zeros(_WARNING_KINDS, np.int32), str(failure), None)]
    flown: list[_RunResult] = []
    for run in range(count):
        if run and not proceed():
            break
        row = slice(run, run + 1)
        own = {name: field[row] for name, field in fields.items()}
        flown += _fly_together(runs.rows([run]), arrays.rows(row), own, watch, proceed)
    return flown


class _Flight:
    """n runs with one instance of a policy."""

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
        self._pushed = bool((runs.starts.driven_inputs >= self._controls.shape[1]).any())
        self._timestep = runs.resolved[0].timestep
        # Each of these steps follows a call of the policy.
        rate, timestep = _policy_drive(runs.resolved[0]).rate, self._timestep
        period = 1 / (rate * timestep)
        if acts_too_often(rate, timestep):
            raise _PolicyFailureError(
                f"the policy should act at {rate:g} Hz, but steps of {timestep:g} s have a rate of "
                f"{1 / timestep:g} Hz; lower its rate, or the timestep"
            )
        most = int(runs.steps / period) + 1
        steps = (_first_step(call * period) for call in range(most + 1))
        self._calls = [step for step in steps if step < runs.steps]
        self._delay = _first_step(_policy_drive(runs.resolved[0]).latency_seconds / self._timestep)
        self._noise = [self._draw_noise(run) for run in runs.resolved]
        # The model's own sensors precede recording sensors.
        model = runs.base.model
        own = [
            sensor
            for sensor in range(model.nsensor)
            if not model.sensor(sensor).name.startswith(SENSOR_PREFIX)
        ]
        self._sensors = int((model.sensor_adr + model.sensor_dim)[own].max(initial=0))
        self._active = list(range(len(self._models)))
        self._errors: list[str | None] = [None] * len(self._models)
        self._applied_controls: dict[int, Floats] = {0: self._controls.copy()}
        self._ends = [runs.steps] * len(self._models)
        self._cpu_seconds, self._sampled = 0.0, [list[float]() for _ in self._models]
        assert runs.policy is not None
        self._name = getattr(runs.policy, "__name__", "policy")
        try:
            with limited_code():
                policy = runs.policy(copy.copy(runs.base.model))
        except BaseException as error:
            raise self._policy_failure("", error) from error
        if not callable(policy):
            raise _PolicyFailureError(
                f"policy {self._name} cannot be called; give it a method "
                "__call__(self, time, qpos, qvel, sensordata)"
            )
        self._policy = policy

    def fly_runs(self, watch: Watch, proceed: Proceed) -> list[_RunResult]:
        """Simulate all runs; return only the first if the sweep should stop meanwhile."""
        count, calls = len(self._models), {step: call for call, step in enumerate(self._calls)}
        waiting: dict[int, Floats] = {}
        marks = {0, *calls, *(step + self._delay for step in calls)}
        slices = -1
        begins = sorted(step for step in marks if step < self._runs.steps)
        # Number of segments of a flight with runs that step one by one, and of all at least.
        sampled_segments, min_segments = 2, 16
        each = max(min_segments, len(begins)) // sampled_segments
        samples = set(begins[each // 2 :: each] if count > 1 else ())
        count_index = 1  # of the number of warnings, after the time of the last one
        for begin, end in pairwise([*begins, self._runs.steps]):
            if begin in calls:
                # n runs get n time limits, each for an n-th of all calls.
                if (now := calls[begin] * count // len(calls)) > slices:
                    slices = now
                    watch()
                if begin and count > 1 and not proceed():
                    count, self._active = 1, [run for run in self._active if run == 0]
                waiting[begin + self._delay] = self._ask_policy(calls[begin], begin)
            if begin in waiting:
                self._applied_controls[begin] = waiting.pop(begin)
                self._controls[self._active] = self._applied_controls[begin][self._active]
            if not self._active:
                break
            # Runs step one by one to sample the time of each.
            one_by_one = begin in samples
            for runs in [[run] for run in self._active] if one_by_one else [self._active]:
                cpu_seconds = self._step_runs(runs, begin, end)
                self._cpu_seconds += cpu_seconds
                if one_by_one:
                    self._sampled[runs[0]].append(cpu_seconds)
            warned = self._batch.warning[:, :, count_index]
            if warned[self._active].any() or any(self._errors):
                self._end_runs(
                    [run for run in self._active if warned[run].any() or self._errors[run]], end
                )
        # The cost of each run, and the controls that were applied to it.
        warnings, every = self._batch.warning[:, :, count_index], [*chain(*self._sampled)] or [1.0]
        weights = np.array(self._ends) * [mean(samples or every) for samples in self._sampled]
        cost = self._cpu_seconds * weights / max(weights.sum(), np.finfo(float).tiny)
        steps = np.array(list(self._applied_controls))
        levels = np.array(list(self._applied_controls.values()))
        duration = max(self._runs.resolved[0].duration, self._runs.steps * self._timestep)
        flown: list[_RunResult] = []
        for run in range(count):
            controls, acted = None, int(np.searchsorted(steps, max(self._ends[run], 1)))
            if not self._errors[run]:
                # Add a last row at the end, so that the table lasts as long as the run.
                rows = [*range(acted), acted - 1]
                times = np.append(steps[:acted] * self._timestep, duration)
                controls = RecordedControls(times, levels[rows, run])
            flown.append((float(cost[run]), warnings[run], self._errors[run], controls))
        return flown

    def _draw_noise(self, run: RunSpec) -> Floats:
        """Return (calls, 2, nv) noise of positions and velocities; the same at any timestep."""
        noise, shape = _policy_drive(run).noise, (len(self._calls), 2, self._models[0].nv)
        if not (noise.qpos or noise.qvel):
            return np.empty(0)
        scale = np.array([noise.qpos, noise.qvel])[:, None]
        noise_stream = 3  # random stream of a run's seed for noise; other streams perturb its start
        return scale * np.random.default_rng([run.seed, noise_stream]).standard_normal(shape)

    def _policy_failure(self, when: str, error: BaseException) -> BaseException:
        """Return the failure for an error of the policy, or an error that is not its own."""
        if ends_command(error):
            return error
        if isinstance(error, SceneError):
            return _PolicyFailureError(str(error))
        return _PolicyFailureError(f"policy {self._name}{when}: {in_one_line(error, __file__)}")

    def _ask_policy(self, call: int, step: int) -> Floats:
        """Return (n, nu) the policy's controls for its observations before a step."""
        try:
            answer = np.asarray(self._policy(*self._observe_states(call, step)))
        except BaseException as error:
            raise self._policy_failure(f", at {step * self._timestep:g} s", error) from error
        if answer.shape != self._controls.shape:
            raise _PolicyFailureError(
                f"policy {self._name} returned an array of shape {answer.shape}; one control for "
                f"each run and actuator is {self._controls.shape}"
            )
        if answer.dtype.kind not in "fiu":
            raise _PolicyFailureError(
                f"policy {self._name} returned {answer.dtype}; controls are real numbers"
            )
        # Adding 0 turns -0.0 into 0.0; no replay could distinguish them.
        requested = answer.astype(np.float64) + 0.0
        if not np.isfinite(requested).all():
            # A run ends if the policy returned NaN or infinity for it.
            when = f"at {step * self._timestep:g} s"
            for run in [run for run in self._active if not np.isfinite(requested[run]).all()]:
                actuator = int(np.flatnonzero(~np.isfinite(requested[run]))[0])
                name = self._models[run].actuator(actuator).name
                value = f"{requested[run, actuator]:g}"
                self._errors[run] = f"policy {self._name} returned {value} for {name} {when}"
                self._end_runs([run], step)
        return requested

    def _observe_states(self, call: int, step: int) -> tuple[Floats, Floats, Floats, Floats]:
        """Return copies of (n,) times, (n, nq) and (n, nv) noisy states, and sensor data."""
        model, state = self._models[0], self._arrays.state[:, step]
        velocity = 1 + model.nq
        time, qpos = state[:, 0].copy(), state[:, 1:velocity].copy()
        qvel = state[:, velocity : velocity + model.nv].copy()
        for run in self._active:
            if self._noise[run].size:
                offset, speed = self._noise[run][call]
                mujoco.mj_integratePos(self._models[run], qpos[run], offset, 1.0)
                qvel[run] += speed
        if step or not self._sensors:
            sensor_values = self._arrays.sensors[:, step - 1, : self._sensors].copy()
        else:
            sensor_values = np.empty((len(self._models), self._sensors))
            for run, model in enumerate(self._models):
                data = mujoco.MjData(model)
                mujoco.mj_setState(model, data, self._batch.state[run], _INTEGRATION)
                mujoco.mj_forward(model, data)
                sensor_values[run] = data.sensordata[: self._sensors]
        return time, qpos, qvel, sensor_values

    def _step_runs(self, runs: list[int], begin: int, end: int) -> float:
        """Step runs, record them, and return the CPU time of the steps [s]."""
        shape = len(runs), end - begin
        out = {
            key: np.empty((*shape, *array.shape[2:]), array.dtype)
            for key, array in self._out.items()
        }
        # Use a slice if all runs are active, because it copies faster than a list.
        ids = runs if len(runs) < len(self._models) else None
        rows = slice(None) if ids is None else ids
        # A scene may drive forces besides the policy.
        driven: dict[str, Any] = {}
        if self._pushed:
            starts = self._runs.starts
            each = [
                driven_inputs(self._models[run], starts, run, end - begin, begin) for run in runs
            ]
            control = np.concatenate([one["control"] for one in each])
            control[:, :, : self._controls.shape[1]] = self._controls[runs][:, None]
            driven = {**each[0], "control": control}
        start = thread_time()
        try:
            self._batch.rollout(end - begin, record=list(out), ids=ids, out=out, **driven)
        except SimulationError:
            for run in runs:
                self._errors[run] = self._batch.error(run) or None
        cpu_seconds = thread_time() - start
        for name, array in self._out.items():
            array[rows, begin:end] = out[name]
        return cpu_seconds

    def _end_runs(self, runs: Sequence[int], step: int) -> None:
        """End runs at the state before a step: they stopped or failed."""
        for run in runs:
            self._ends[run] = step
            for array in self._out.values():
                array[run, step:] = array[run, max(step - 1, 0)]
            self._arrays.state[run, step + 1 :] = self._arrays.state[run, step]
        self._active = [run for run in self._active if run not in runs]


def _first_step(time: float) -> int:
    """Return the first step that starts at or after a time, in steps."""
    return int(np.ceil(time - COARSE_ROUNDING))


def allowed_policy(drive: LocatedDrive, *, allowed: bool) -> LocatedDrive | None:
    """Return a drive if it is a policy; a SceneError if its code is not allowed, or fails."""
    if not isinstance(drive.drive, PolicyDrive):
        return None
    if not allowed and drive.drive.runs_code:
        raise SceneError(
            f"drive: {drive.files[0]} is Python code, which runs only if you allow it; add "
            "--allow-code, or allow_code=True in Python"
        )
    load_policy(drive)
    return LocatedDrive(drive.drive, tuple(file.absolute() for file in drive.files))


def load_policy(located: LocatedDrive) -> PolicyClass:
    """Return the class of a policy; a SceneError if its file changed, fails or lacks it."""
    assert isinstance(located.drive, PolicyDrive)
    drive = located.drive
    if isinstance(drive, PdDrive):
        policy_class: PolicyClass = partial(PdController, kp=drive.kp, kd=drive.kd)
    else:
        located.check_unchanged()
        name = drive.policy.rpartition(":")[2]
        policy_class = cast("PolicyClass", load_code("policy", located.files[0], name))
        with suppress(ValueError):  # some classes of C have no signature
            try:
                signature(policy_class).bind(None)
            except TypeError as error:
                raise SceneError(
                    f"policy {located.files[0]}: {name} is made with the model: {error}; write "
                    "def __init__(self, model)"
                ) from error
    return send_targets(policy_class) if drive.send else policy_class


def load_code(what: str, file: Path, name: str) -> Callable[..., object]:
    """Return a class or function of a file; a SceneError if that fails, or lacks it."""
    module = ModuleType(f"contactlab_{what}_{file.stem}")
    module.__file__ = str(file)
    # Classes of the module can be pickled once it is listed.
    sys.modules[module.__name__] = module
    try:
        with limited_code():
            exec(compile(file.read_bytes(), file, "exec"), module.__dict__)  # noqa: S102 - allowed
    except BaseException as error:
        if ends_command(error):
            raise
        raise SceneError(f"{what} {file}: {in_one_line(error, __file__)}") from error
    member = getattr(module, name, None)
    if not callable(member):
        classes = [item for item in vars(module).items() if isinstance(item[1], type)]
        own = [class_name for class_name, kind in classes if kind.__module__ == module.__name__]
        hint = f"; write one of {', '.join(own)}" if own else ""
        raise SceneError(f"{what} {file}: it has no class {name}{hint}")
    return member
