"""Errors of changed models from the states of one reference: the model as written at a fine step.

Every candidate starts in each window from the state of the reference. So all candidates are
compared from the same states, whatever their timesteps, and chaos does not matter. These errors
rank candidates; the numerical error that is printed is that of the error budget.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import mujoco
import numpy as np

from contactlab.budget import ErrorBudget, Motion, PhaseBudget, Reading
from contactlab.budget.defects import measure_defects, measure_paths
from contactlab.budget.measuring import WINDOW
from contactlab.budget.motion import GRAVITY_AS_REAL, measure_pulls, without_delays
from contactlab.budget.restarts import (
    MIN_WINDOW_STEPS,
    build_reference_model,
    held_inputs,
    refine_motion,
    run_at_once,
    scale_of_impulses,
    subsample_windows,
    whole_windows,
)
from contactlab.budget.windows import Observer, Run, body_name, judged_bodies, replay_motion
from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError
from contactlab.modifications.model_predicates import is_disabled
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.scene.model_edits import set_timestep, write_option

_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
SLACK_SHARE = 0.05
"""Largest shift in time that is no error, as a share of a window: 2 ms of 40 ms. The time of an
event is uncertain by a step, but a step of 40 ms would forgive whatever happens in its window."""


@dataclass(frozen=True)
class ErrorEstimate:
    """Error of a candidate: in its worst body, and where.

    Attributes:
        error: residual force as a share of the real forces, mean over seeds; infinite if MuJoCo
            gave up.
        body, phase: the worst.
        time: when its worst window begins [s since the phase began].
        low, high: least and largest over seeds.
        shares: error of that body for each seed; empty if the seeds are not known.
        by_phase: (S, B) error of each body for each seed, by phase; empty if not known.
    """

    error: float
    body: str
    phase: str
    time: float
    low: float
    high: float
    shares: tuple[float, ...] = ()
    by_phase: tuple[Floats, ...] = field(default=(), compare=False, repr=False)

    @classmethod
    def of_reading(cls, phase: PhaseBudget, reading: Reading) -> "ErrorEstimate":
        """Return the estimate of a row of an error budget."""
        seeds = tuple(map(float, reading.seeds))
        ends = (min(seeds), max(seeds)) if seeds else (reading.error, reading.error)
        body = phase.bodies[reading.body]
        return cls(reading.error, body, phase.name, reading.time, *ends, seeds)

    @classmethod
    def of_budget(cls, budget: ErrorBudget) -> "ErrorEstimate":
        """Return the numerical error of a budget, in its worst phase."""
        worst = max(budget.phases, key=lambda phase: phase.run.error)
        of_all = tuple(phase.run.shares for phase in budget.phases)
        return replace(cls.of_reading(worst, worst.run), by_phase=of_all)

    def widened_by(self, other: "ErrorEstimate") -> "ErrorEstimate":
        """Return the estimate with a range that includes the error on other seeds."""
        low, high = min(self.low, other.low), max(self.high, other.high)
        return replace(self, low=low, high=high)

    def times_factor(self, factor: float) -> "ErrorEstimate":
        """Return the estimate in another unit."""
        return replace(
            self,
            error=factor * self.error,
            low=factor * self.low,
            high=factor * self.high,
            shares=tuple(factor * share for share in self.shares),
        )


class PhaseReference:
    """The reference motion of one phase, which candidates are compared with."""

    def __init__(
        self,
        motion: Motion,
        finer: int,
        workers: int,
        *,
        every: int = 1,
        integrator: str | None = None,
    ) -> None:
        """Run the phase at its step over `finer`; use only one in `every` windows.

        `integrator` replaces that of the model.
        """
        self._motion = without_delays(motion)
        self._substeps, self._workers = finer, workers
        self.step = float(motion.model.opt.timestep) / finer
        self._reference_model = build_reference_model(motion.model, finer)
        if integrator is not None:
            write_option(self._reference_model, "integrator", integrator)
        steps = max(1, round(WINDOW / motion.model.opt.timestep))
        fine = refine_motion(self._motion, self._reference_model, finer)
        window = min(steps, motion.steps) * float(motion.model.opt.timestep)
        self._run: Run = replay_motion(fine, window, workers)
        self._bodies = judged_bodies(motion.model)
        self._observe = Observer(motion.model, motion.starts[0], self._bodies, workers)
        self._cached_reference = (0, np.empty(0))
        whole = whole_windows(self._run)
        chosen = [
            (seed, window, stood_for)
            for seed in range(motion.seeds)
            for window, stood_for in zip(*subsample_windows(whole, every), strict=True)
            if self._run.valid[seed, window]
        ]
        self._windows = np.array([place[:2] for place in chosen], int).reshape(-1, 2)
        self._window_weights = np.array(
            [place[2] for place in chosen]
        )  # (M,) number of windows that each stands for

    @property
    def motion(self) -> Motion:
        """The phase, with controls that act on actuators without delay."""
        return self._motion

    @property
    def reference_model(self) -> mujoco.MjModel:
        """The model of the reference motion."""
        return self._reference_model

    @property
    def windows(self) -> int:
        """Number of windows of comparison; 0 if MuJoCo gave up on the reference."""
        return len(self._windows)

    @property
    def model(self) -> mujoco.MjModel:
        """The model as written, as it moves in the phase."""
        return self._motion.model

    @property
    def positions(self) -> Floats:
        """(T, nq) joint positions at the steps of the run."""
        own = self._run.velocity_states[:, : -1 : self._substeps, : self._motion.model.nq]
        return own[np.isfinite(own).all(axis=2)]

    @cached_property
    def _observed(self) -> np.ndarray:
        names = [body_name(self._motion.model, int(body)) for body in self._bodies]
        watched = self._motion.observed
        return np.flatnonzero([not watched or name in watched for name in names])

    @cached_property
    def _real_impulses(self) -> Floats:
        """(M, B) real impulses of windows over mass [m/s], which errors are a share of."""
        model, run, rate = self._motion.model, self._run, self._substeps
        gravity = 0.0 if is_disabled(model, "gravity") else 1.0
        fall = measure_pulls(self._motion, gravity * model.opt.gravity)[..., self._bodies]
        impulses = np.empty((len(self._windows), len(self._bodies)))
        for place, (seed, window) in enumerate(self._windows):
            begin = int(run.begins[window])
            states = run.velocity_states[seed, begin : begin + run.steps + 1 : rate]
            speed = self._observe(states)[0]
            span = slice(begin // rate, (begin + run.steps) // rate)
            weight = GRAVITY_AS_REAL * model.opt.timestep * fall[seed, span].sum(axis=0)
            impulses[place] = measure_paths(speed[None])[0] + weight
            if not window:
                impulses[place] += np.linalg.norm(speed[0], axis=-1)
        return impulses

    def estimate_error(
        self, model: mujoco.MjModel, multiple: int, against: "Floats | None" = None
    ) -> ErrorEstimate:
        """Compare a model with the reference; its step is `multiple` fine steps.

        `against` (M, 3, B, 6) are velocities around the ends of the windows that replace those of
        the reference. Both models then make the same steps, so that stepping gives no event another
        time, and no shift in time is forgiven: it would hide forces up to a share of the window.
        """
        ends, which = self._window_ends(multiple)
        if not len(which):
            return ErrorEstimate(math.inf, "", self._motion.name, 0.0, math.inf, math.inf)
        own = self.velocities_around(model, multiple)
        if against is None:
            slack = self._slack_of(multiple)
            # Velocities are straight between steps.
            own = own[:, 1:2] + (own - own[:, 1:2]) * (slack / multiple)
            errors = measure_defects(own, self._reference_around(ends, which, multiple))
        else:
            apart = np.linalg.norm(own[:, 1] - against[:, 1], axis=-1)
            errors = np.where(np.isnan(apart), np.inf, apart)
        begin = self._run.begins[which[:, 1]]
        is_observed = np.isin(
            self._windows[:, 0] * len(self._run.begins) + self._windows[:, 1],
            which[:, 0] * len(self._run.begins) + which[:, 1],
        )
        length = (ends[0] - begin[0]) / self._run.steps
        return self._worst_body(
            errors / length,
            self._real_impulses[is_observed],
            which,
            self._window_weights[is_observed, None],
        )

    def _worst_body(
        self, each: Floats, real_each: Floats, which: np.ndarray, stood_for: Floats
    ) -> ErrorEstimate:
        error_sums, real = each * stood_for, real_each * stood_for
        seeds = np.unique(which[:, 0])
        shares = np.empty((len(seeds), len(self._bodies)))
        for place, seed in enumerate(seeds):
            own = which[:, 0] == seed
            whole = scale_of_impulses(real[own].sum(axis=0))
            shares[place] = error_sums[own].sum(axis=0) / whole
        mean = shares.mean(axis=0)
        body = int(self._observed[np.argmax(mean[self._observed])])
        worst = which[int(np.argmax(each[:, body]))]
        time = float(self._run.begins[worst[1]] * self.step)
        name = body_name(self._motion.model, int(self._bodies[body]))
        own = tuple(shares[:, body].tolist())
        phase = self._motion.name
        return ErrorEstimate(float(mean[body]), name, phase, time, min(own), max(own), own)

    def _slack_of(self, multiple: int) -> float:
        # In fine steps. Not rounded to these, or the error would depend on how fine they are.
        window = multiple * max(MIN_WINDOW_STEPS, round(self._run.steps / multiple))
        return min(float(multiple), SLACK_SHARE * window)

    def _window_ends(self, multiple: int) -> tuple[np.ndarray, np.ndarray]:
        """Return (M,) fine steps at which windows end, and the (M, 2) windows that fit."""
        count = max(MIN_WINDOW_STEPS, round(self._run.steps / multiple))
        ends = self._run.begins[self._windows[:, 1]] + count * multiple
        fits = ends + multiple < self._run.velocity_states.shape[1]
        return ends[fits], self._windows[fits]

    def _reference_around(self, ends: np.ndarray, which: np.ndarray, multiple: int) -> Floats:
        """Return (M, K, B, 6) velocities of the reference around the ends of windows.

        Configurations of one step are tried in a row, so those of the last step are cached.
        """
        if multiple != self._cached_reference[0]:
            self._cached_reference = multiple, self._observe_reference(ends, which, multiple)
        return self._cached_reference[1]

    def _observe_reference(self, ends: np.ndarray, which: np.ndarray, multiple: int) -> Floats:
        slack = self._slack_of(multiple)
        last = math.floor(slack + COARSE_ROUNDING)
        share = slack - last
        reference_points = 4  # within a step of the candidate, on either side of an end
        stride = max(1, last // reference_points)
        half = [*range(stride, last, stride), last] if last else []
        if share > COARSE_ROUNDING:
            half.append(last + 1)
        # The end itself must be in the middle, where defects expect it.
        places = np.array([-place for place in half[::-1]] + [0, *half])
        states = np.stack(
            [
                self._run.velocity_states[seed, end + places]
                for (seed, _), end in zip(which, ends, strict=True)
            ]
        )
        velocities = self._observe(states)[0]
        if share > COARSE_ROUNDING:
            for edge, inner in ((0, 1), (-1, -2)):
                velocities[:, edge] = velocities[:, inner] + share * (
                    velocities[:, edge] - velocities[:, inner]
                )
        return velocities

    def velocities_around(self, model: mujoco.MjModel, multiple: int) -> Floats:
        """Return (M, 3, B, 6) velocities of a model one step before, at and after window ends."""
        _, which = self._window_ends(multiple)
        if not len(which):
            raise SceneError(
                "no part of the motion can be judged: it diverges or loses contacts from the start "
                "(see `contactlab lint`)"
            )
        count = max(MIN_WINDOW_STEPS, round(self._run.steps / multiple))
        motion = self.motion_of(model, multiple, which, count + 1)
        run = replay_motion(motion, (count + 1) * float(motion.model.opt.timestep), self._workers)
        return self._observe(run.velocity_states[:, count - 1 : count + 2])[0]

    def motion_of(
        self, model: mujoco.MjModel, multiple: int, which: np.ndarray, steps: int
    ) -> Motion:
        """Return M motions, as seeds of one motion, that begin where (M, 2) windows do."""
        own = run_at_once(model)
        set_timestep(own, multiple * self.step)
        starts, inputs = self.starts_and_inputs(multiple, which, steps)
        return replace(self._motion, model=own, starts=starts, inputs=inputs)

    def starts_and_inputs(
        self, multiple: int, which: np.ndarray, steps: int
    ) -> tuple[Floats, Floats]:
        """Return initial states (M, nstate) of (M, 2) windows, and (M, steps, width) inputs.

        A step that covers several steps of the run gets the mean of their inputs.
        """
        begins = self._run.begins[which[:, 1]]
        inputs = held_inputs(self._motion, self._substeps, which[:, 0], begins, multiple, steps)
        return self._run.starts[which[:, 0], which[:, 1]], inputs

    @property
    def starts(self) -> np.ndarray:
        """(M, 2) seeds and windows that candidates begin in."""
        return self._windows


@dataclass(frozen=True)
class TaskReference:
    """The references of the phases of a task, which are judged one by one; the worst counts."""

    phases: Sequence[PhaseReference]
    substeps: int

    @classmethod
    def run_references(
        cls,
        motions: Sequence[Motion],
        finer: int,
        workers: int,
        every: int = 1,
        integrator: str | None = None,
    ) -> "TaskReference":
        """Run the references of phases; `integrator` replaces that of the model."""
        references = [
            PhaseReference(motion, finer, workers, every=every, integrator=integrator)
            for motion in motions
        ]
        return cls(references, finer)

    @property
    def is_complete(self) -> bool:
        """Whether MuJoCo completed the reference of every phase."""
        return all(part.windows for part in self.phases)

    def complete_phases(self) -> "TaskReference":
        """Return the phases with a complete reference; all of them if there is none."""
        return replace(self, phases=[part for part in self.phases if part.windows] or self.phases)

    @property
    def step(self) -> float:
        """The fine step [s]."""
        return self.phases[0].step

    def estimate_error(self, model: mujoco.MjModel, multiple: int) -> ErrorEstimate:
        """Return the largest error of a model, over phases.

        The step of the reference itself adds an error of first order, which is corrected here
        unless either motion uses RK4.
        """
        worst = self.uncorrected_error(model, multiple)
        rest = 1.0
        fine = self.phases[0].reference_model
        if multiple > 1 and _RK4 not in (model.opt.integrator, fine.opt.integrator):
            rest = multiple / (multiple - 1)
        return worst.times_factor(rest)

    def uncorrected_error(self, model: mujoco.MjModel, multiple: int) -> ErrorEstimate:
        """Return the same without the correction for the step of the reference."""
        estimates = [part.estimate_error(model, multiple) for part in self.phases]
        return max(estimates, key=lambda apart: apart.error)

    def velocities_around(
        self, make_model: Callable[[mujoco.MjModel, int], mujoco.MjModel]
    ) -> list[Floats]:
        """Return velocities around window ends at the step of the run, by phase."""
        return [
            part.velocities_around(make_model(part.model, 1), self.substeps) for part in self.phases
        ]

    def error_against(
        self, make_model: Callable[[mujoco.MjModel], mujoco.MjModel], same: Sequence[Floats]
    ) -> ErrorEstimate:
        """Return the largest error of a changed model against velocities of the same steps."""
        estimates = [
            part.estimate_error(make_model(part.model), self.substeps, own)
            for part, own in zip(self.phases, same, strict=True)
        ]
        return max(estimates, key=lambda apart: apart.error)
