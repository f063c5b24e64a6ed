"""Forward errors: distance of observed outputs from the reference, at the end or at the peak.

They are available if the motion is not chaotic, which nudged copies of the start show.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION, without_delays
from contactlab.budget.restarts import (
    build_reference_model,
    held_inputs,
    refine_motion,
    run_at_once,
)
from contactlab.budget.windows import replay_motion
from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError
from contactlab.rendering.amounts import format_percent
from contactlab.scene.model_edits import set_timestep
from contactlab.scene.model_names import find_id
from contactlab.tasks.reference_error import ErrorEstimate

ErrorTime = Literal["end", "peak"]
_PARTS = 16  # parts of a run in which growth is measured
_CHAOTIC_GROWTH = 1e3  # growth over a run above which it may be chaotic
_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)


@dataclass(frozen=True)
class Divergence:
    """Divergence of nudged copies of a start.

    Attributes:
        factor: growth of the nudge over the run.
        growing_parts: number of sixteenths of the run in which it grew by a factor of e.
        largest_jump: share of the growth, in powers of e, in the sixteenth with most growth.
    """

    factor: float
    growing_parts: int
    largest_jump: float

    @property
    def chaotic(self) -> bool:
        """Whether it grows again and again; a mode switch that a nudge flips makes it grow once."""
        fewest_parts = 3  # in which a chaotic motion grows by a factor of e
        return self.factor > _CHAOTIC_GROWTH and self.growing_parts >= fewest_parts

    @property
    def sentence(self) -> str:
        """The divergence in words."""
        grown = f"a nudge grows by a factor of {self.factor:.2g}"
        if self.chaotic:
            return f"chaotic: {grown}, in {self.growing_parts} of {_PARTS} parts of the run"
        if self.factor > _CHAOTIC_GROWTH:
            jump = f"{format_percent(self.largest_jump)} at once"
            return f"regular, except for a mode switch: {grown}, {jump}"
        return f"regular: {grown} in the whole run"


def measure_divergence(motion: Motion, workers: int) -> Divergence:
    """Measure the divergence of nudged copies of a motion, for the worst seed."""
    model = motion.model
    generator = np.random.default_rng(0)
    qvel = mujoco.mj_stateSize(model, int(mujoco.mjtState.mjSTATE_QVEL) - 1 & INTEGRATION)
    place = slice(qvel, qvel + model.nv)
    copies, nudge_share = 3, 1e-8  # of the size of every coordinate, in velocity
    starts = np.repeat(motion.starts, 1 + copies, axis=0)
    nudges = nudge_share * generator.normal(size=(len(starts), model.nv))
    nudges[:: 1 + copies] = 0
    starts[:, place] += nudges * np.maximum(1.0, np.abs(starts[:, place]))
    many = replace(motion, starts=starts, inputs=np.repeat(motion.inputs, 1 + copies, axis=0))
    states = replay_motion(many, motion.steps * float(model.opt.timestep), workers).velocity_states[
        :, :-1
    ]
    nq = model.nq
    places = np.linspace(0, states.shape[1] - 1, _PARTS + 1).astype(int)
    velocities = states[:, places, nq : nq + model.nv].reshape(
        motion.seeds, 1 + copies, len(places), -1
    )
    with np.errstate(invalid="ignore", over="ignore"):
        apart = np.linalg.norm(velocities[:, 1:] - velocities[:, :1], axis=-1)
    apart = np.maximum(np.nan_to_num(apart, nan=np.inf), 1e-300)
    growths = list[Divergence]()
    for copies in apart.reshape(-1, len(places)):
        whole = float(copies[1:].max() / copies[0])
        # Regrowth up to an earlier peak does not count again.
        peaks = np.maximum.accumulate(copies)
        steps = np.diff(np.log(peaks))
        total = float(steps.sum())
        jump = float(steps.max() / total) if total > 0 else 0.0
        growths.append(Divergence(whole, int((steps > 1).sum()), jump))
    return max(growths, key=lambda growth: (growth.chaotic, growth.factor))


@dataclass(frozen=True)
class ObservedOutput:
    """An observed body, site or sensor."""

    kind: Literal["body", "site", "sensor"]
    name: str
    index: int

    @classmethod
    def find(cls, model: mujoco.MjModel, name: str) -> "ObservedOutput":
        """Find an output by name; a SceneError says that there is none of this name."""
        if (body := find_id(model, "body", name)) > 0:
            return cls("body", name, body)
        for kind, number in (
            ("site", mujoco.mjtObj.mjOBJ_SITE),
            ("sensor", mujoco.mjtObj.mjOBJ_SENSOR),
        ):
            if (index := mujoco.mj_name2id(model, number, name)) >= 0:
                return cls("site" if kind == "site" else "sensor", name, index)
        raise SceneError(f"nothing is called '{name}': --observe takes a body, a site or a sensor")

    @property
    def unit(self) -> str:
        """Unit of its error: m, or the unit of the sensor."""
        return "m" if self.kind != "sensor" else "(unit of the sensor)"

    def read_value(self, model: mujoco.MjModel, data: mujoco.MjData) -> Floats:
        """Return its value in a state."""
        match self.kind:
            case "body":
                return data.xpos[self.index].copy()
            case "site":
                return data.site_xpos[self.index].copy()
            case "sensor":
                first = int(model.sensor_adr[self.index])
                return data.sensordata[first : first + int(model.sensor_dim[self.index])].copy()


class ForwardError:
    """Distances of observed outputs from the reference, over whole runs."""

    def __init__(
        self,
        motions: Sequence[Motion],
        finer: int,
        watched: Sequence[ObservedOutput],
        at: ErrorTime,
        workers: int,
    ) -> None:
        """Run the task at fine steps: one motion from start to end."""
        self._motion = without_delays(join_phases(motions))
        self._finer, self._observed, self._error_at, self._workers = finer, watched, at, workers
        self.step = float(self._motion.model.opt.timestep) / finer
        self._reference = self._reference_states()

    def _reference_states(self) -> Floats:
        """Return (S, K + 1, state) states at fine steps, by the integrator that converges best.

        That is the model's own integrator or RK4, whichever changes the end less if steps are
        halved.
        """
        own, references = int(self._motion.model.opt.integrator), list[tuple[float, Floats]]()
        for kind in dict.fromkeys([own] if self._motion.model.nflex else [own, _RK4]):
            once, twice = (self._states_at(kind, rate * self._finer)[:, ::rate] for rate in (1, 2))
            end = min(once.shape[1], twice.shape[1]) - 1
            apart = float(np.abs(once[:, end] - twice[:, end]).max())
            references.append((apart if math.isfinite(apart) else math.inf, twice))
        return min(references, key=lambda pair: pair[0])[1]

    def _states_at(self, integrator: int, rate: int) -> Floats:
        """Return the states of the motion by an integrator, at `rate` substeps."""
        model = build_reference_model(self._motion.model, rate)
        model.opt.integrator = integrator
        motion = refine_motion(self._motion, model, rate)
        return replay_motion(
            motion, motion.steps * float(model.opt.timestep), self._workers
        ).velocity_states[:, :-1]

    def estimate_error(self, model: mujoco.MjModel, multiple: int) -> ErrorEstimate:
        """Return the largest distance of an observed output, over seeds."""
        own = run_at_once(model)
        set_timestep(own, multiple * self.step)
        steps = self._motion.steps * self._finer // multiple
        every = np.arange(self._motion.seeds)
        start = np.zeros_like(every)
        inputs = held_inputs(self._motion, self._finer, every, start, multiple, steps)
        motion = replace(self._motion, model=own, inputs=inputs)
        states = replay_motion(
            motion, steps * float(own.opt.timestep), self._workers
        ).velocity_states[:, :-1]
        places = [steps]
        if self._error_at == "peak":
            samples = 200
            places = np.unique(np.linspace(0, steps, samples).astype(int)).tolist()
        data, distances = (
            mujoco.MjData(own),
            np.empty((len(inputs), len(self._observed), len(places))),
        )
        for seed, which, place in np.ndindex(distances.shape):
            ends = states[seed, places[place]], self._reference[seed, places[place] * multiple]
            one, other = (_read_output(own, data, end, self._observed[which]) for end in ends)
            distances[seed, which, place] = np.linalg.norm(one - other)
        distances[~np.isfinite(distances)] = np.inf
        _, which, place = map(int, np.unravel_index(np.argmax(distances), distances.shape))
        seeds, time = distances.max(axis=(1, 2)), places[place] * multiple * self.step
        most, least, name = float(seeds.max()), float(seeds.min()), self._observed[which].name
        phase, shares = self._motion.name, tuple(seeds.tolist())
        return ErrorEstimate(most, name, phase, time, least, most, shares)


def _read_output(
    model: mujoco.MjModel, data: mujoco.MjData, state: Floats, watched: ObservedOutput
) -> Floats:
    """Return an output in a state that begins with positions and velocities."""
    data.qpos[:], data.qvel[:] = state[: model.nq], state[model.nq : model.nq + model.nv]
    if watched.kind == "sensor":
        mujoco.mj_forward(model, data)
    else:
        mujoco.mj_kinematics(model, data)
    return watched.read_value(model, data)


def join_phases(motions: Sequence[Motion]) -> Motion:
    """Return the phases of a task as one motion; all must have the same inputs."""
    first = motions[0]
    if any(motion.seeds != first.seeds or motion.spec != first.spec for motion in motions):
        return first
    inputs = np.concatenate([motion.inputs for motion in motions], axis=1)
    return replace(first, inputs=inputs, name="the task")
