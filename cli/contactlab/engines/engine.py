"""Engines: how runs reach one, and the arrays that it returns.

An engine is one class in one file, derived from `SimulationEngine` and added to `ENGINES`. It must
say its version and roll runs out. What else it can do it shows by having the methods of
`ChecksRuns`, `SolvesReferences` or `TimesSteps`; what needs a method leaves runs of engines without
it alone.
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
    Floats,
    RecordedControls,
    SelfChecks,
    Told,
    Trace,
)
from contactlab.registry import Registry
from contactlab.scene.compiled_scene import CompiledScene, PreparedModel
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene

_ISLANDS = 20  # Contact islands of which MuJoCo keeps solver statistics: mjNISLAND

Watch = Callable[[], None]  # called before a run, or a block of its steps, to start its time limit

Proceed = Callable[[], bool]  # asked between runs; False leaves out the rest of them

# Reading the metadata of a package takes milliseconds, and every record names the version.
package_version = cache(version)


def no_limit() -> None:
    """Start no time limit."""


def proceed_always() -> bool:
    """Leave out no run."""
    return True


class RolloutArrays(NamedTuple):
    """Where a rollout records; see `Rollout` for shapes."""

    state: Floats
    sensors: Floats
    iterations: np.ndarray

    def rows(self, runs: slice) -> "RolloutArrays":
        """Return those of some runs, which share memory with these."""
        return RolloutArrays(*(array[runs] for array in self))


@dataclass(frozen=True)
class Rollout(Told):
    """Result of an engine for n runs of N steps; rows after a run stopped are not valid.

    Attributes:
        state: (n, N + 1, nstate) time, qpos, qvel, act; row k is the state before step k.
        sensors: (n, N, nsensordata) laid out as the scene's `layout` says; row k belongs to step
            k, which starts at the state of row k.
        iterations: (n, N, islands) solver iterations.
        steps: steps that each run made.
        cost: (n,) thread CPU time of the stepping [s]; NaN where it is not the engine's alone.
        warnings: engine warnings of each run by name, with their counts.
        errors: the error of the engine or of the policy in each run, or None.
        controls: what policies did in each run, None where one failed; empty without policies.
        slots: (n, N, S, 23) contact slots of each monitored pair, S being as many as are filled; if
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
        """Return the first n runs that were recorded, completed without warnings at (n,) costs."""
        count, steps = len(cost), arrays.sensors.shape[1]
        first = arrays.rows(slice(count))
        warnings = tuple(dict[str, int]() for _ in range(count))
        return cls(*first, (steps,) * count, cost, warnings, (None,) * count)


class Buffers:
    """Memory for rollouts, kept between calls: fresh pages would cost a tenth of a small run.

    Of more runs than are recorded into so many bytes, engines that can may take the first alone.
    """

    def __init__(self, most: int = sys.maxsize) -> None:
        self.most = most
        self._memory: dict[str, NDArray[Any]] = {}

    def arrays(
        self, model: mujoco.MjModel, runs: int, steps: int, measured: int | None = None
    ) -> RolloutArrays:
        """Return arrays for n runs of N steps, in which all sensors measure, or so many numbers."""
        measured = model.nsensordata if measured is None else measured
        return RolloutArrays(
            state=self.take("state", runs, steps + 1, 1 + model.nq + model.nv + model.na),
            sensors=self.take("sensors", runs, steps, measured),
            iterations=self.take("iterations", runs, steps, _ISLANDS, kind=np.int32),
        )

    def take(self, name: str, *shape: int, kind: type[np.generic] = np.float64) -> NDArray[Any]:
        """Return an array, not cleared, that shares memory with the last one of this name."""
        size = math.prod(shape)
        if name not in self._memory or len(self._memory[name]) < size:
            self._memory[name] = np.empty(size, kind)
        return self._memory[name][:size].reshape(shape)


class Policy(Protocol):
    """Actor of a closed loop: made of a model once, for runs that go through together."""

    def __call__(self, time: Floats, qpos: Floats, qvel: Floats, sensordata: Floats, /) -> object:
        """Return (n, nu) controls, from times (n,) [s] and states (n, nq), (n, nv) as observed.

        `sensordata` (n, ...) is what the model's own sensors measured in the last step.
        """
        ...


PolicyClass = Callable[[mujoco.MjModel], Policy]


def bytes_of_run(model: mujoco.MjModel, steps: int, measured: int | None = None) -> int:
    """Return the memory [bytes] that one run of N steps records into; see `Buffers.arrays`."""
    measured = model.nsensordata if measured is None else measured
    width = 1 + model.nq + model.nv + model.na + measured
    return 8 * width * (steps + 1) + 4 * _ISLANDS * steps


@dataclass(frozen=True)
class PreparedRuns:
    """n runs of one structure and step count, ready to be simulated.

    Attributes:
        scene: theirs, with the files that other engines may import.
        resolved: (n) their settings.
        prepared: (n) their models in MuJoCo.
        starts: where they start, and what drives them.
        steps: how many steps each makes.
        policy: what acts in them; None where `starts` has all that drives them.
    """

    scene: Scene
    resolved: Sequence[RunSpec]
    prepared: Sequence[PreparedModel]
    starts: InitialStates
    steps: int
    policy: PolicyClass | None = None

    @classmethod
    def of(cls, scene: Scene, *resolved: RunSpec) -> "PreparedRuns":
        """Prepare runs of one structure and step count."""
        starts = scene.starts(resolved)
        prepared = [scene.prepare(run, starts.pick(place)) for place, run in enumerate(resolved)]
        return cls(scene, resolved, prepared, starts, resolved[0].steps)

    @property
    def base(self) -> CompiledScene:
        """Their structure: the monitored pairs, and the layout of what is recorded."""
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
            starts=self.starts.rows(runs),
        )

    def repeating(self, controls: Sequence[RecordedControls | None]) -> "PreparedRuns":
        """Return the runs driven by what their policies did, if any did, without the policies."""
        acted = [control for control in controls if control is not None]
        return replace(self, starts=self.starts.acted_on(acted), policy=None) if acted else self


class SimulationEngine(ABC):
    """Computes trajectories of compiled scenes.

    Attributes:
        name: its value of the axis `engine`, and its name in records.
        summary: what computes, in a few words, for the axis' description: "MuJoCo".
        omits_unused_effects: whether effects of MuJoCo that provably change nothing may be left
            out of its models; else all that a model has stays on.
        accepts_every_run: whether it refuses nothing, so that runs need not be asked about.
        runs_policies: whether it calls `PreparedRuns.policy`; what that did drives any engine.
        own_laws: whether it has laws of motion of its own, so that closed forms try them; else
            it computes MuJoCo's, or what another steps.
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
        """The version of what computes the trajectories."""

    @abstractmethod
    def roll_out(
        self,
        runs: PreparedRuns,
        buffers: Buffers,
        watch: Watch = no_limit,
        proceed: Proceed = proceed_always,
    ) -> Rollout:
        """Simulate runs, and record into `buffers`, whose arrays the next call overwrites.

        `watch` is called before each run, and `proceed` asked between runs: if it says no, only
        the first ones are returned, as if `buffers` hold no more. A SceneError says that the
        engine cannot simulate such runs; `refusal` should have said so.
        """

    def least_bytes(self, base: CompiledScene, run: RunSpec) -> int:
        """Return the memory [bytes] that a run is recorded into, at least.

        By default it is all of it, since engines record into their buffers whatever they are given.
        """
        return bytes_of_run(base.model, run.steps)

    def refusal(self, scene: Scene, run: RunSpec) -> str | None:  # noqa: ARG002 - as below
        """Return why it cannot simulate a run, and what to do instead; None if it can.

        Every run of a sweep is asked about before the first one starts. By default, runs are
        refused whose sweep sets what the engine ignores.
        """
        ignored = self.ignored(run)
        for name in sorted(run.changed & ignored.keys()):
            return (
                f"the {self.name} engine ignores {name}, which is set here: {ignored[name]}; leave "
                f"{name} out"
            )
        return None

    def ignored(self, run: RunSpec) -> Mapping[str, str]:  # noqa: ARG002 - some look at it
        """Return settings and effects of a run that it leaves out, and why; off in its records."""
        return {}

    def null_fields(self, *, driven: bool) -> dict[str, str]:  # noqa: ARG002 - as above
        """Return what is null in its records, and why; runs are driven if their inputs change."""
        return {}

    def seconds_per_step(self, runs: PreparedRuns) -> float:
        """Return about how long a step takes [s], by simulating some."""
        begin = time.thread_time()
        self.roll_out(runs, Buffers())
        return (time.thread_time() - begin) / (runs.steps * len(runs.prepared))


# Returns the backward error of one of the runs, given its (N + 1, nstate) states, before each step
# and after the last, with all that decides what follows.
Judge = Callable[[PreparedRuns, int, Floats], BackwardError]


@runtime_checkable
class ChecksRuns(Protocol):
    """An engine that can go over its runs a second time, for what the arrays cannot show."""

    def check_runs(
        self,
        runs: PreparedRuns,
        trace: Trace,
        proceed: Proceed = proceed_always,
        judge: Judge | None = None,
    ) -> SelfChecks:
        """Return the self-checks of runs that completed; of the first ones if told to stop.

        With the backward error of each, if somebody judges that.
        """
        ...


class SampledStates(NamedTuple):
    """States of one run at T times."""

    states: Floats  # (T, nstate) time, qpos, qvel, act
    qpos: Floats  # (T, nq)
    qvel: Floats  # (T, nv)
    impacts: int  # how often the number of contacts changed from one step to the next


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

        They count since the run's own start. It starts at `begin` [s] in `state` (nstate,), if not
        there; `watch` is called before each block of steps. The model has no automatic reset.
        """
        ...


# Segments of a run that are timed: one state each is kept along it, its start among them.
SEGMENTS = 8


class Work(NamedTuple):
    """Work of the engine over all steps of a run."""

    steps: int
    iterations: int  # of the solver, summed over contact islands
    contacts: int  # in the whole model
    rows: int  # of constraints
    places: tuple[int, ...]  # (P,) steps before which states were kept
    states: Floats  # (P, nstate) these states, all that decides what follows


@dataclass(frozen=True)
class Segments:
    """Parts of one run that are timed, each from a state that the run passes through."""

    model: mujoco.MjModel  # without the sensors that record
    start: InitialStates  # of the run, n being 1; what drives it
    work: Work  # of the run, with the steps and states that segments begin with

    def lengths(self, most: int) -> list[int]:
        """Return the steps of each segment: up to the next one, at most so many."""
        places = [*self.work.places, self.work.steps]
        return [min(most, end - place) for place, end in pairwise(places)]


@runtime_checkable
class TimesSteps(Protocol):
    """An engine whose steps can be timed by themselves, with nothing recorded."""

    def count_work(
        self, model: mujoco.MjModel, start: InitialStates, steps: int, watch: Watch = no_limit
    ) -> Work | None:
        """Simulate one run, untimed, and count; None if it does not complete."""
        ...

    def time_segments(self, segments: Segments, most: int, repeats: int) -> tuple[float, int]:
        """Return the CPU time of going through all segments repeatedly [s], and the steps made.

        Of each segment, as many steps as it has are made, up to `most`.
        """
        ...

    def time_steps(self, segments: Segments, most: int) -> Floats:
        """Return the CPU time of single steps [s], less what reading the clock takes."""
        ...


ENGINES: Registry[SimulationEngine] = Registry("engine")
_Engine = TypeVar("_Engine", bound=SimulationEngine)


def engine(kind: type[_Engine]) -> type[_Engine]:
    """Declare an engine, a class that needs no argument; a PluginError if its name is taken."""
    ENGINES.add(kind())
    return kind
