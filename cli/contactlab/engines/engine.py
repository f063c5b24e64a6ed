"""Engines: the interface that gives them runs and takes their arrays.

An engine is one class in one file, derived from `SimulationEngine` and added to `ENGINES`. It must
provide its version and roll out runs. Further abilities are shown by the methods of `ChecksRuns`,
`SolvesReferences` or `TimesSteps`; code that needs such a method skips runs of engines without it.
"""

import math
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from itertools import pairwise
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

import mujoco
import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import (
    BackwardError,
    EngineOutputs,
    Floats,
    RecordedControls,
    SelfChecks,
    Trace,
)
from contactlab.registry import Registry
from contactlab.scene.compiled_scene import CompiledScene, PreparedModel
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene

_ISLAND_COUNT = 20  # number of contact islands with solver statistics in MuJoCo: mjNISLAND

Watch = Callable[[], None]  # called before a run, or a block of its steps, to start its time limit

Proceed = Callable[[], bool]  # called between runs; False skips the rest of them

# Reading the metadata of a package takes milliseconds, and every record names the version.
package_version = cache(version)


def no_limit() -> None:
    """Start no time limit."""


def proceed_always() -> bool:
    """Continue with every run."""
    return True


class RolloutArrays(NamedTuple):
    """Arrays that a rollout records into; see `Rollout` for shapes."""

    state: Floats
    sensors: Floats
    iterations: np.ndarray

    def rows(self, runs: slice) -> "RolloutArrays":
        """Return the arrays of some runs, which share memory with these."""
        return RolloutArrays(*(array[runs] for array in self))


@dataclass(frozen=True)
class Rollout(EngineOutputs):
    """Result of an engine for n runs of N steps; rows after a run stopped are not valid.

    Attributes:
        state: (n, N + 1, nstate) time, qpos, qvel, act; row k is the state before step k.
        sensors: (n, N, nsensordata) in the scene's `layout`; row k belongs to step k, which starts
            at
            the state of row k.
        iterations: (n, N, islands) solver iterations.
        steps: steps that each run made.
        cost: (n,) thread CPU time of the stepping [s]; NaN if it includes more than the engine's.
        warnings: engine warnings of each run by name, with their counts.
        errors: the error of the engine or of the policy in each run, or None.
        controls: controls of policies in each run, None if one failed; empty without policies.
        slots: (n, N, S, 23) contact slots of each monitored pair, with S the number of filled ones;
            if
            given, `sensors` begins with the count of all contacts.
    """

    state: Floats
    sensors: Floats
    iterations: np.ndarray
    steps: tuple[int, ...]
    cost: Floats
    warnings: tuple[dict[str, int], ...]
    errors: tuple[str | None, ...]
    controls: tuple[RecordedControls | None, ...] = ()
    slots: tuple[Floats, ...] | None = None

    @classmethod
    def completed(cls, arrays: RolloutArrays, cost: Floats) -> "Rollout":
        """Return the first n recorded runs as completed without warnings, at (n,) costs."""
        count, steps = len(cost), arrays.sensors.shape[1]
        first = arrays.rows(slice(count))
        warnings = tuple(dict[str, int]() for _ in range(count))
        return cls(*first, (steps,) * count, cost, warnings, (None,) * count)


class Buffers:
    """Memory for rollouts, kept between calls: new pages would cost a tenth of a small run.

    If runs need more than `most` bytes, engines that can do so record only the first ones.
    """

    def __init__(self, most: int = sys.maxsize) -> None:
        self.most = most
        self._memory: dict[str, NDArray[Any]] = {}

    def arrays(
        self, model: mujoco.MjModel, runs: int, steps: int, sensor_numbers: int | None = None
    ) -> RolloutArrays:
        """Return arrays for n runs of N steps, for all sensors, or for `sensor_numbers`."""
        sensor_numbers = model.nsensordata if sensor_numbers is None else sensor_numbers
        return RolloutArrays(
            state=self.take("state", runs, steps + 1, 1 + model.nq + model.nv + model.na),
            sensors=self.take("sensors", runs, steps, sensor_numbers),
            iterations=self.take("iterations", runs, steps, _ISLAND_COUNT, kind=np.int32),
        )

    def take(self, name: str, *shape: int, kind: type[np.generic] = np.float64) -> NDArray[Any]:
        """Return an array, not cleared, that shares memory with the last one of this name."""
        size = math.prod(shape)
        if name not in self._memory or len(self._memory[name]) < size:
            self._memory[name] = np.empty(size, kind)
        return self._memory[name][:size].reshape(shape)


class Policy(Protocol):
    """Actor of a closed loop, constructed once from a model, for runs that advance together."""

    def __call__(self, time: Floats, qpos: Floats, qvel: Floats, sensordata: Floats, /) -> object:
        """Return (n, nu) controls, from times (n,) [s] and observed states (n, nq), (n, nv).

        `sensordata` (n, ...) are the values of the model's own sensors in the last step.
        """
        ...


PolicyClass = Callable[[mujoco.MjModel], Policy]


def bytes_of_run(model: mujoco.MjModel, steps: int, sensor_numbers: int | None = None) -> int:
    """Return the memory [bytes] for the record of a run of N steps; see `Buffers.arrays`."""
    sensor_numbers = model.nsensordata if sensor_numbers is None else sensor_numbers
    width = 1 + model.nq + model.nv + model.na + sensor_numbers
    return 8 * width * (steps + 1) + 4 * _ISLAND_COUNT * steps


@dataclass(frozen=True)
class PreparedRuns:
    """n runs of one structure and step count, ready to be simulated.

    Attributes:
        scene: their scene, with the files that other engines may import.
        resolved: (n) their settings.
        prepared: (n) their models in MuJoCo.
        starts: their initial states and inputs.
        steps: the number of steps of each.
        policy: the policy that acts in them; None if `starts` has all of their inputs.
    """

    scene: Scene
    resolved: Sequence[RunSpec]
    prepared: Sequence[PreparedModel]
    starts: InitialStates
    steps: int
    policy: PolicyClass | None = None

    @classmethod
    def of(cls, scene: Scene, *resolved: RunSpec, is_drawn: bool = True) -> "PreparedRuns":
        """Prepare runs of one structure and step count.

        If they are not to be drawn, their models lack data that only drawing reads.
        """
        starts = scene.initial_states(resolved)
        compiled = None if is_drawn else scene.base_of(resolved[0]).motion_model
        prepared = [
            scene.prepare(run, starts.select_run(place), compiled)
            for place, run in enumerate(resolved)
        ]
        return cls(scene, resolved, prepared, starts, resolved[0].steps)

    @property
    def base(self) -> CompiledScene:
        """Their structure: the monitored pairs, and the layout of the recording."""
        return self.scene.base_of(self.resolved[0])

    @property
    def models(self) -> list[mujoco.MjModel]:
        """Their compiled models."""
        return [run.model for run in self.prepared]

    def rows(self, runs: Sequence[int]) -> "PreparedRuns":
        """Return some of the runs."""
        return replace(
            self,
            resolved=[self.resolved[run] for run in runs],
            prepared=[self.prepared[run] for run in runs],
            starts=self.starts.select_runs(runs),
        )

    def with_recorded_controls(self, controls: Sequence[RecordedControls | None]) -> "PreparedRuns":
        """Return the runs with the recorded controls of their policies, if any, as inputs."""
        acted = [control for control in controls if control is not None]
        return (
            replace(self, starts=self.starts.with_recorded_inputs(acted), policy=None)
            if acted
            else self
        )


class SimulationEngine(ABC):
    """Computes trajectories of compiled scenes.

    Attributes:
        name: its value of the axis `engine`, and its name in records.
        summary: its short description in the axis' description: "MuJoCo".
        omits_unused_effects: whether effects of MuJoCo that provably change nothing may be left out
            of
            its models; otherwise all effects of a model stay on.
        accepts_every_run: whether it refuses nothing, so that runs need not be checked.
        runs_policies: whether it calls `PreparedRuns.policy`; the recorded controls drive any
            engine.
        own_laws: whether it has its own laws of motion, so that closed forms test them; otherwise
            it
            computes MuJoCo's, or those of another stepper.
        controls_error: whether it chooses its own steps, by `tolerance`, its accuracy.
    """

    name: str
    summary: str
    omits_unused_effects: bool = False
    accepts_every_run: bool = False
    runs_policies: bool = False
    own_laws: bool = True
    controls_error: bool = False

    @property
    @abstractmethod
    def version(self) -> str:
        """The version of the software that computes the trajectories."""

    @abstractmethod
    def roll_out(
        self,
        runs: PreparedRuns,
        buffers: Buffers,
        watch: Watch = no_limit,
        proceed: Proceed = proceed_always,
    ) -> Rollout:
        """Simulate runs, and record into `buffers`; the next call overwrites their arrays.

        `watch` is called before each run, and `proceed` between runs: if it returns False, only the
        first ones are returned, as if `buffers` hold no more. A SceneError says that the engine
        cannot simulate such runs; `refusal` should have reported it.
        """

    def least_bytes(self, base: CompiledScene, run: RunSpec) -> int:
        """Return the least memory [bytes] for the record of a run.

        By default it is all of it, because engines record everything into their buffers.
        """
        return bytes_of_run(base.model, run.steps)

    def refusal(self, scene: Scene, run: RunSpec) -> str | None:  # noqa: ARG002 - as below
        """Return why it cannot simulate a run, and the alternative; None if it can.

        Every run of a sweep is checked before the first one starts. By default, runs are refused if
        their sweep sets an axis that the engine ignores.
        """
        ignored = self.ignored(run)
        for name in sorted(run.changed_settings & ignored.keys()):
            return (
                f"the {self.name} engine ignores {name}, which is set here: {ignored[name]}; "
                f"remove {name}"
            )
        return None

    def ignored(self, run: RunSpec) -> Mapping[str, str]:  # noqa: ARG002 - some look at it
        """Return ignored settings and effects, with reasons; they are off in its records."""
        return {}

    def null_fields(self, *, driven: bool) -> dict[str, str]:  # noqa: ARG002 - as above
        """Return null fields of its records, with reasons; driven runs have changing inputs."""
        return {}

    def seconds_per_step(self, runs: PreparedRuns) -> float:
        """Return the approximate time of a step [s], by simulating some steps."""
        begin = time.thread_time()
        self.roll_out(runs, Buffers())
        return (time.thread_time() - begin) / (runs.steps * len(runs.prepared))


# Returns the backward error of one of the runs, from its complete (N + 1, nstate) states: those
# before each step, and that after the last.
BackwardErrorFunction = Callable[[PreparedRuns, int, Floats], BackwardError]


@runtime_checkable
class ChecksRuns(Protocol):
    """An engine that can simulate its runs a second time, for checks beyond the arrays."""

    def check_runs(
        self,
        runs: PreparedRuns,
        trace: Trace,
        proceed: Proceed = proceed_always,
        judge: BackwardErrorFunction | None = None,
    ) -> SelfChecks:
        """Return the self-checks of completed runs; of the first ones after a request to stop.

        With a `judge`, they include the backward error of each.
        """
        ...


class SampledStates(NamedTuple):
    """States of one run at T times."""

    states: Floats  # (T, nstate) time, qpos, qvel, act
    qpos: Floats  # (T, nq)
    qvel: Floats  # (T, nv)
    impacts: int  # number of steps with a change of the number of contacts


@runtime_checkable
class SolvesReferences(Protocol):
    """An engine that can integrate runs at timesteps of references, keeping few states."""

    def integrate_to(
        self,
        model: mujoco.MjModel,
        start: InitialStates,
        times: Floats,
        *,
        begin: float = 0.0,
        state: Floats | None = None,
        watch: Watch = no_limit,
    ) -> SampledStates | None:
        """Return one run's states at increasing times (T,) [s]; None if it does not complete.

        They count from the run's own start. It starts at `begin` [s] in `state` (nstate,), if
        given; `watch` is called before each block of steps. The model has no automatic reset.
        """
        ...


# Number of timed segments of a run: one state is kept for each, including its start.
SEGMENTS = 8


class Work(NamedTuple):
    """Work of the engine over all steps of a run."""

    steps: int
    iterations: int  # of the solver, summed over contact islands
    contacts: int  # in the whole model
    rows: int  # of constraints
    places: tuple[int, ...]  # (P,) steps that follow a kept state
    states: Floats  # (P, nstate) these states, complete enough to continue


@dataclass(frozen=True)
class Segments:
    """Timed parts of one run, each from a state that the run passes through."""

    model: mujoco.MjModel  # without the sensors that record
    start: InitialStates  # start and inputs of the run (n is 1)
    work: Work  # work of the run, with the steps and states at the start of segments

    def lengths(self, most: int) -> list[int]:
        """Return the steps of each segment: up to the next one, at most `most`."""
        places = [*self.work.places, self.work.steps]
        return [min(most, end - place) for place, end in pairwise(places)]


@runtime_checkable
class TimesSteps(Protocol):
    """An engine with steps that can be timed alone, with nothing recorded."""

    def count_work(
        self, model: mujoco.MjModel, start: InitialStates, steps: int, watch: Watch = no_limit
    ) -> Work | None:
        """Simulate one run, untimed, and count its work; None if it does not complete."""
        ...

    def time_segments(self, segments: Segments, most: int, repeats: int) -> tuple[float, int]:
        """Return the CPU time of stepping all segments repeatedly [s], and the number of steps.

        Each segment makes its steps, but at most `most`.
        """
        ...

    def time_steps(self, segments: Segments, most: int) -> Floats:
        """Return the CPU time of single steps [s], less the time of reading the clock."""
        ...


ENGINES: Registry[SimulationEngine] = Registry("engine")
_Engine = TypeVar("_Engine", bound=SimulationEngine)


def engine(kind: type[_Engine]) -> type[_Engine]:
    """Declare an engine, a class without arguments. Raises a PluginError if its name is taken."""
    ENGINES.add(kind())
    return kind
