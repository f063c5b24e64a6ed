"""Plays episodes of an environment, each with the model and the policy of one run."""

import copy
import math
from collections import deque
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, TypeVar

import mujoco
import numpy as np
from mujoco import mj_step, mj_step2  # as names of their own, since they are replaced meanwhile

from contactlab.accuracy.reference import PlannedModel
from contactlab.engines import PreparedRuns
from contactlab.engines.engine import Policy, PolicyClass
from contactlab.errors import SceneError, in_one_line
from contactlab.foreign_code import ends_command, printed_as_text
from contactlab.loop.listener import (
    Episode,
    Listener,
    changed_fields,
    hear_steps,
    known_setup,
    write_fields,
)
from contactlab.loop.reader import LoopReader
from contactlab.loop.simulation import (
    differing_parts,
    find_simulation,
    read_success,
    reset_with_seed,
    unwrap_environment,
)
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.scene.compiled_scene import PreparedModel
from contactlab.scene.contact_pairs import effective_parameters
from contactlab.scene.scene import Scene
from contactlab.scene.variants import find_variant
from contactlab.schema.drive import PolicyDrive

_UNCHECKED_TEXT = "backward errors and repeats: only the environment's own code makes its steps"
_TIMESTEP = "opt.timestep"
_RESET_TEXT = "the environment was reset within a step"
_SHORT_RESULT, _LONG_RESULT = (
    4,
    5,
)  # lengths of step()'s result, with one or two flags for the end of the episode

Act = Callable[[Any], Any]
"""Returns an action for the last observation of the environment."""
_DEFAULT_RATE = PolicyDrive.model_fields["rate"].default


_Listens = TypeVar("_Listens", "_EpisodeListener", "_StepCounter")


class FailureError(Exception):
    """An episode does not satisfy the request of its run; the message gives the reason."""


class _CutError(Exception):
    """An episode ended within a step of its environment; the message gives the reason."""


class Player:
    """Plays runs as episodes of one environment, which is created again after a failure.

    Args:
        scene: the scene of the store, with the environment's model from the planning of the sweep.
        make: creates the environment.
        policy: the policy that acts in it; None for random actions of its action_space.
    """

    def __init__(self, scene: Scene, make: Callable[[], Any], policy: PolicyClass | None) -> None:
        self._scene, self._make, self._policy = scene, make, policy
        self._env: Any = None
        # The last prepared model, and the fields that differ from the model as written.
        self._edited: tuple[PreparedModel, frozenset[str]] | None = None

    def play(self, plan: PlannedModel) -> Episode:
        """Return the episode of a run; a failed one with its finished part and the reason."""
        listener, fields, failure = self._play_episode(plan, self._listener_of)
        if listener is None or not listener.steps:
            # The environment could not be created or reset.
            model = plan.prepared.model
            listener = self._listener_of(plan, model, mujoco.MjData(model))
        return listener.episode(fields, failure)

    def play_outcome(self, plan: PlannedModel) -> dict[str, Any]:
        """Play the episode of a run without a record; return its end as fields of one.

        It costs as much as the environment's own steps: a record takes several times longer.
        """
        counter, fields, failure = self._play_episode(plan, _StepCounter)
        fields = {"status": "ok", "status_reason": None, **fields}
        if failure is not None:
            fields |= {"status": "error", "status_reason": failure}
        elif counter is not None and counter.failed and fields["status"] == "ok":
            fields |= {"status": "stopped", "status_reason": "the simulation failed"}
        return {**fields, "steps": counter.steps if counter else 0}

    def _listener_of(
        self, plan: PlannedModel, model: mujoco.MjModel, data: mujoco.MjData
    ) -> "_EpisodeListener":
        return _EpisodeListener(self._scene, plan, model, data)

    def _play_episode(
        self,
        plan: PlannedModel,
        listen: Callable[[PlannedModel, mujoco.MjModel, mujoco.MjData], _Listens],
    ) -> tuple[_Listens | None, dict[str, Any], str | None]:
        # The listener, if the episode began; the results; and the reason of a failure.
        fields: dict[str, Any] = {"success": None, "total_reward": None}
        listener: _Listens | None = None
        failure: str | None = None
        try:
            with printed_as_text():
                observation = self._reset_environment(plan)
                own = find_simulation(unwrap_environment(self._env))
                listener = listen(plan, *own)
                self._step_until_end(plan, listener, observation, fields)
        except _CutError as error:
            fields |= {"status": "stopped", "status_reason": f"cut: {error}"}
        except BaseException as error:
            if ends_command(error):
                raise
            plain = isinstance(error, FailureError | SceneError)
            failure = str(error) if plain else f"environment: {in_one_line(error, __file__)}"
            self._env = None
        return listener, fields, failure

    def _reset_environment(self, plan: PlannedModel) -> Any:  # noqa: ANN401 - whatever it observes
        """Reset the environment with a run's model and seed; return its observation."""
        if self._env is None:
            self._env = self._make()
        # Environments see the step as written, and keep their control rate.
        planned_model, rate = plan.prepared.model, _step_rate(plan)
        if rate > 1:
            planned_model = copy.copy(planned_model)
            planned_model.opt.timestep *= rate
        base = self._scene.base({}).model
        if self._edited is None or self._edited[0] is not plan.prepared:
            self._edited = plan.prepared, frozenset(changed_fields(base, planned_model))
        model, data = find_simulation(unwrap_environment(self._env))
        _check_same_parts(model, base)
        write_fields(model, planned_model)
        mujoco.mj_resetData(model, data)
        answer = reset_with_seed(self._env, plan.run.seed)
        again, data = find_simulation(unwrap_environment(self._env))
        if again is not model:
            _check_same_parts(again, base)
            write_fields(again, planned_model)
            mujoco.mj_forward(again, data)
        expected_fields = {*self._edited[1], _TIMESTEP}
        if lost := [
            name for name in changed_fields(planned_model, again) if name in expected_fields
        ]:
            raise FailureError(
                f"reset() of the environment overwrites values of the sweep: {', '.join(lost)}"
            )
        return answer[0] if isinstance(answer, tuple) else answer

    def _step_until_end(
        self,
        plan: PlannedModel,
        listener: "_EpisodeListener | _StepCounter",
        observation: Any,  # noqa: ANN401 - as above
        fields: dict[str, Any],
    ) -> None:
        """Make steps until the environment or the run ends; add their results to `said`."""
        env, ended, total = self._env, False, 0.0
        act = create_actor(env, self._policy, plan, self._scene.base({}).model, listener.data)
        while not ended and listener.steps < plan.run.steps:
            before, action = listener.steps, act(observation)
            with hear_steps(listener):
                answer = env.step(action)
            if listener.steps == before:
                raise FailureError(
                    "step() of the environment made no step by mujoco.mj_step or mujoco.mj_step2, "
                    "called by these names"
                )
            if not isinstance(answer, tuple) or len(answer) not in (_SHORT_RESULT, _LONG_RESULT):
                raise FailureError(
                    "step() of the environment returns observation, reward, terminated, truncated "
                    "and info"
                )
            observation, reward, *ends, info = answer
            total, ended = total + float(reward), any(ends)
            if not math.isfinite(total):
                raise FailureError(f"step() of the environment returned the reward {reward}")
            if listener.model.opt.timestep != listener.control_timestep:
                raise FailureError(f"step() of the environment changes {_TIMESTEP}")
            fields["total_reward"] = total
            if (success := read_success(env, info)) is not None:
                fields["success"] = success


def _step_rate(plan: PlannedModel) -> int:
    variant = find_variant(plan.run.settings)
    return variant.rate if variant else 1


def _check_same_parts(model: mujoco.MjModel, base: mujoco.MjModel) -> None:
    if differing := differing_parts(model, base):
        raise FailureError(f"the model differs from that of the sweep in {differing}")


@contextmanager
def finer_steps(model: mujoco.MjModel, rate: int) -> Generator[None]:
    """Divide the step of a model by a rate meanwhile."""
    option = model.opt
    option.timestep /= rate
    try:
        yield
    finally:
        option.timestep *= rate


class _StepCounter:
    """Counts the steps of one episode, which ends when its time decreases.

    Attributes:
        steps: number of steps that were made.
        failed: whether the simulation failed in one of them, and was reset.
        control_timestep: the step that the environment sees.
    """

    def __init__(self, plan: PlannedModel, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self.model, self.data, self.steps, self.failed = model, data, 0, False
        self._rate = _step_rate(plan)
        self.control_timestep = plan.prepared.model.opt.timestep * self._rate
        self._time: float | None = None  # after the last step

    def mj_step(self, model: mujoco.MjModel, data: mujoco.MjData, nstep: int = 1) -> None:
        """Make steps, or several finer ones for each."""
        if data is not self.data:
            mj_step(model, data, nstep)
            return
        count, begin = nstep * self._rate, data.time
        self._check_time(begin)
        with finer_steps(model, self._rate):
            mj_step(model, data, count)
            # A failed simulation is reset, so that its time is too early.
            self.failed |= data.time < begin + (count - 0.5) * model.opt.timestep
        self.steps, self._time = self.steps + count, data.time

    def mj_step2(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Finish a step, or make several finer ones under the same inputs."""
        if data is self.data and self._rate > 1:
            self.mj_step(model, data)
            return
        if data is self.data:
            self._check_time(data.time)
        mj_step2(model, data)
        if data is self.data:
            self.steps, self._time = self.steps + 1, data.time

    def _check_time(self, time: float) -> None:
        if self._time is not None and time != self._time:
            has_missed_steps = time > self._time
            raise _CutError(
                "the data was stepped without the recording" if has_missed_steps else _RESET_TEXT
            )


class _EpisodeListener(Listener):
    """Listens to one episode, which ends when its time decreases.

    Attributes:
        control_timestep: the step that the environment sees; the run may make several for each.
    """

    def __init__(
        self, scene: Scene, plan: PlannedModel, model: mujoco.MjModel, data: mujoco.MjData
    ) -> None:
        super().__init__(LoopReader(scene.base({}), model, data))
        self._scene, self._plan = scene, plan
        self._rate = _step_rate(plan)
        self.control_timestep = plan.prepared.model.opt.timestep * self._rate

    def step(self, count: int = 1) -> None:
        """Make steps, or several finer ones for each."""
        with finer_steps(self._reader.model, self._rate):
            super().step(count * self._rate)

    def mj_step2(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Finish a step, or make several finer ones under the same inputs."""
        if self._rate > 1 and data is self._reader.data:
            self.step()
        else:
            super().mj_step2(model, data)

    @property
    def steps(self) -> int:
        """Number of steps that were made."""
        return self._reader.steps

    def _cut_episode(self, why: str | None) -> None:
        raise _CutError(why or _RESET_TEXT)

    def episode(self, fields: dict[str, Any], failed: str | None) -> Episode:
        """Return the episode with further fields, and the reason of a failure, if any."""
        with finer_steps(self._reader.model, self._rate):
            return self._build_episode(fields, failed)

    def _build_episode(self, fields: dict[str, Any], failed: str | None) -> Episode:
        reader, step_count, plan = self._reader, self.steps, self._plan
        if not step_count:
            # One row, which is not measured.
            mujoco.mj_forward(reader.model, reader.data)
            self._handle_changes()
            reader.read_step()
        steps, before = self._take_steps(), self._before
        start, count = steps.starts(before), len(steps.rows)
        resolved = replace(plan.run, duration=count * before.opt.timestep)
        pairs = {
            pair.name: effective_parameters(before, pair) for pair in self._scene.base({}).pairs
        }
        prepared = replace(plan.prepared, model=before, pairs=pairs)
        rollout = steps.rollout(PreparedRuns(self._scene, [resolved], [prepared], start, count))
        rollout = replace(rollout, steps=rollout.steps if step_count else (0,), errors=(failed,))
        own = replace(plan, run=resolved, prepared=prepared, start=start)
        loop = self._loop_record(plan.prepared.model, _UNCHECKED_TEXT)
        fields = {**fields, "loop": loop, "duration": plan.run.duration}
        return Episode(own, rollout, known_setup(steps), self._started, fields)


def create_actor(
    env: Any,  # noqa: ANN401 - any environment
    policy: PolicyClass | None,
    plan: PlannedModel,
    model: mujoco.MjModel,
    data: mujoco.MjData,
) -> Act:
    """Return a function of actions for an episode that begins now; a FailureError without one."""
    variant = find_variant(plan.run.settings)
    noise = _noise_source(plan.run.seed, variant.noise) if variant and variant.noise else None
    if policy is not None:
        assert isinstance(plan.run.drive, PolicyDrive)
        policy_action = policy(copy.copy(model))
        act = _policy_actor(policy_action, plan.run.drive.rate, data, noise)
        return _delayed_actor(act, variant.delay) if variant and variant.delay else act
    space: Any = getattr(env, "action_space", None)
    if not (hasattr(space, "seed") and hasattr(space, "sample")):
        raise FailureError(
            "the environment has no action_space with seed() and sample(); give the sweep a "
            "`drive: {policy: FILE.py:CLASS}`"
        )
    space.seed(plan.run.seed)
    return lambda _: space.sample()


def _delayed_actor(act: Act, delay: int) -> Act:
    # The first action comes at once.
    waiting = deque[Any]()

    def act_late(observation: Any) -> Any:  # noqa: ANN401 - as environments take them
        waiting.append(copy.copy(act(observation)))
        return waiting.popleft() if len(waiting) > delay else waiting[0]

    return act_late


def _noise_source(seed: int, deviation: float) -> Act:
    stream = 4  # random stream of a run's seed for noise in environments
    rng = np.random.default_rng([seed, stream])

    def add_noise(observation: Any) -> Any:  # noqa: ANN401 - as environments return them
        if isinstance(observation, Mapping):
            return {name: add_noise(value) for name, value in observation.items()}
        if isinstance(observation, tuple | list):
            return type(observation)(map(add_noise, observation))
        values = np.asarray(observation)
        if values.dtype.kind != "f":
            return observation
        return (values + deviation * rng.standard_normal(values.shape)).astype(values.dtype)

    return add_noise


def _policy_actor(
    policy: Any,  # noqa: ANN401 - code
    rate: float,
    data: mujoco.MjData,
    noise: Act | None,
) -> Act:
    """Return a policy that acts on each observation, or on the state at its rate."""
    if not hasattr(policy, "act"):
        return _StateActor(policy, rate, data, noise)
    if rate != _DEFAULT_RATE:
        raise FailureError(
            "a policy with act() acts in each step of the environment; remove its rate"
        )
    return policy.act if noise is None else lambda observation: policy.act(noise(observation))


class _StateActor:
    """Asks a policy at its rate for the action in a state; it stays until the next one."""

    def __init__(self, policy: Policy, rate: float, data: mujoco.MjData, noise: Act | None) -> None:
        self._policy, self._rate, self._data, self._start = policy, rate, data, data.time
        self._noise = noise
        self._calls, self._action = 0, None

    def __call__(self, _: object) -> Any:  # noqa: ANN401 - as environments take them
        time = self._data.time - self._start
        due_calls = int(np.floor(time * self._rate + COARSE_ROUNDING)) + 1
        if due_calls > self._calls + 1:
            raise FailureError(
                f"the policy should act at {self._rate:g} Hz, but the environment asks for actions "
                f"at {self._calls / time:g} Hz; lower the rate of the drive"
            )
        if due_calls > self._calls:
            self._calls, self._action = due_calls, self._ask_policy(time)
        return self._action

    def _ask_policy(self, time: float) -> Any:  # noqa: ANN401 - likewise
        data = self._data
        parts = (data.qpos, data.qvel, data.sensordata)
        parts = (np.array(time), *(self._noise(parts) if self._noise else parts))
        answer = np.asarray(self._policy(*(part.copy()[None] for part in parts)))
        if answer.ndim == 0 or len(answer) != 1 or not np.isfinite(answer).all():
            raise FailureError(
                f"the policy returned {answer.tolist()} at {time:g} s; an action is one row "
                "of finite numbers"
            )
        return answer[0]
