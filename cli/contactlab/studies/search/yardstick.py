"""How far changed models are from the motion of the model as written at a fine step.

Every candidate begins in each window where that fine motion is, so that all are compared from the
same states, whatever their steps, and chaos touches none of them.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.defects import defects, paths
from contactlab.budget.measuring import WINDOW, reference_of, run_at_once
from contactlab.budget.motion import pulls, without_delays
from contactlab.budget.rows import GRAVITY_AS_REAL, ROWS, disabled
from contactlab.budget.windows import Observer, Run, body_name, judged_bodies, replay
from contactlab.contact.trace_arrays import Floats

_FEWEST_STEPS = 2  # of a window, so that the slack of a step leaves something to compare
_AROUND = 4  # points of the fine motion within a step of the candidate, on either side of an end
_STANDING = 1e-6
_UNKNOWN = "unknown"
_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)


@dataclass(frozen=True)
class Apart:
    """How far a candidate is from the fine motion: the share of its worst body, and where.

    Attributes:
        share: phantom forces over real ones, the mean over seeds; infinite where it gave up.
        body, phase: the worst.
        time: when its worst window begins [s since the phase began].
        low, high: least and largest over seeds.
    """

    share: float
    body: str
    phase: str
    time: float
    low: float
    high: float


class Yardstick:
    """The fine motion of one phase, and what is held against it."""

    def __init__(self, motion: Motion, finer: int, workers: int, *, every: int = 1) -> None:
        """Run the phase at its step over `finer`; look at one in `every` windows only."""
        self._motion = without_delays(motion)
        self._finer, self._workers = finer, workers
        self.step = float(motion.model.opt.timestep) / finer
        self._fine = reference_of(motion.model, finer)
        steps = max(1, round(WINDOW / motion.model.opt.timestep))
        inputs = self._motion.inputs.repeat(finer, axis=1)
        fine = replace(self._motion, model=self._fine, inputs=inputs)
        window = min(steps, motion.steps) * float(motion.model.opt.timestep)
        self._run: Run = replay(fine, window, workers)
        self._bodies = judged_bodies(motion.model)
        self._observe = Observer(motion.model, motion.starts[0], self._bodies, workers)
        self._last_fine = (0, np.empty(0))
        whole = np.flatnonzero(self._run.begins % self._run.steps == 0)
        chosen = [
            (seed, window, stood_for)
            for seed in range(motion.seeds)
            for window, stood_for in zip(*looked_at(whole, every), strict=True)
            if self._run.valid[seed, window]
        ]
        self._which = np.array([place[:2] for place in chosen], int).reshape(-1, 2)
        self._stood_for = np.array([place[2] for place in chosen])  # (M) windows

    @property
    def motion(self) -> Motion:
        """The phase, by controls that its actuators see at once."""
        return self._motion

    @property
    def windows(self) -> int:
        """How many windows candidates are held against; 0 if the fine motion is given up."""
        return len(self._which)

    @property
    def model(self) -> mujoco.MjModel:
        """As written, as it moves in the phase."""
        return self._motion.model

    @property
    def positions(self) -> Floats:
        """(T, nq) where joints are, at the run's own steps."""
        own = self._run.kept[:, : -1 : self._finer, : self._motion.model.nq]
        return own[np.isfinite(own).all(axis=2)]

    @cached_property
    def _watched(self) -> np.ndarray:
        names = [body_name(self._motion.model, int(body)) for body in self._bodies]
        watched = self._motion.watched
        return np.flatnonzero([not watched or name in watched for name in names])

    @cached_property
    def _real(self) -> Floats:
        """(M, B) real impulses of windows over mass [m/s]: what phantom ones are a share of."""
        model, run, rate = self._motion.model, self._run, self._finer
        gravity = 0.0 if disabled(model, "gravity") else 1.0
        fall = pulls(self._motion, gravity * model.opt.gravity)[..., self._bodies]
        found = np.empty((len(self._which), len(self._bodies)))
        for place, (seed, window) in enumerate(self._which):
            begin = int(run.begins[window])
            kept = run.kept[seed, begin : begin + run.steps + 1 : rate]
            speed = self._observe(kept)[0]
            span = slice(begin // rate, (begin + run.steps) // rate)
            weight = GRAVITY_AS_REAL * model.opt.timestep * fall[seed, span].sum(axis=0)
            found[place] = paths(speed[None])[0] + weight
            if not window:
                found[place] += np.linalg.norm(speed[0], axis=-1)
        return found

    def apart(self, model: mujoco.MjModel, multiple: int, against: "Floats | None" = None) -> Apart:
        """Hold a model against the fine motion; its step is so many of the fine ones.

        `against` (M, K, B, 6) replaces the fine motion around the ends of the windows.
        """
        ends, which = self._ends(multiple)
        if not len(which):
            return Apart(math.inf, "", self._motion.name, 0.0, math.inf, math.inf)
        own = self.around(model, multiple)
        fine = self._fine_around(ends, which, multiple) if against is None else against
        found = defects(own, fine)
        begin = self._run.begins[which[:, 1]]
        kept = np.isin(
            self._which[:, 0] * len(self._run.begins) + self._which[:, 1],
            which[:, 0] * len(self._run.begins) + which[:, 1],
        )
        length = (ends[0] - begin[0]) / self._run.steps
        return self._worst(found / length, self._real[kept], which, self._stood_for[kept, None])

    def _worst(
        self, each: Floats, real_each: Floats, which: np.ndarray, stood_for: Floats
    ) -> Apart:
        found, real = each * stood_for, real_each * stood_for
        seeds = np.unique(which[:, 0])
        shares = np.empty((len(seeds), len(self._bodies)))
        for place, seed in enumerate(seeds):
            own = which[:, 0] == seed
            whole = real[own].sum(axis=0)
            whole = np.maximum(whole, _STANDING * whole.max()) + 1e-300
            shares[place] = found[own].sum(axis=0) / whole
        mean = shares.mean(axis=0)
        body = int(self._watched[np.argmax(mean[self._watched])])
        worst = which[int(np.argmax(each[:, body]))]
        time = float(self._run.begins[worst[1]] * self.step)
        name = body_name(self._motion.model, int(self._bodies[body]))
        own = shares[:, body]
        return Apart(
            float(mean[body]), name, self._motion.name, time, float(own.min()), float(own.max())
        )

    def _ends(self, multiple: int) -> tuple[np.ndarray, np.ndarray]:
        """Return (M) fine steps at which windows end, and those (M, 2) windows that fit."""
        count = max(_FEWEST_STEPS, round(self._run.steps / multiple))
        ends = self._run.begins[self._which[:, 1]] + count * multiple
        fits = ends + multiple < self._run.kept.shape[1]
        return ends[fits], self._which[fits]

    def _fine_around(self, ends: np.ndarray, which: np.ndarray, multiple: int) -> Floats:
        """Return (M, K, B, 6) velocities of the fine motion around the ends of windows.

        Choices of one step are tried one after the other, so that those of the last step are kept.
        """
        if multiple != self._last_fine[0]:
            self._last_fine = multiple, self._fine_seen(ends, which, multiple)
        return self._last_fine[1]

    def _fine_seen(self, ends: np.ndarray, which: np.ndarray, multiple: int) -> Floats:
        stride = max(1, multiple // _AROUND)
        places = sorted({*range(-multiple, multiple + 1, stride), 0, multiple})
        # The end itself is in the middle, where defects look for it.
        half = [place for place in places if place > 0]
        places = [-place for place in half[::-1]] + [0, *half]
        kept = np.stack(
            [
                self._run.kept[seed, end + np.array(places)]
                for (seed, _), end in zip(which, ends, strict=True)
            ]
        )
        return self._observe(kept)[0]

    def around(self, model: mujoco.MjModel, multiple: int) -> Floats:
        """Return (M, 3, B, 6) velocities of a model a step before, at and after windows' ends."""
        _, which = self._ends(multiple)
        count = max(_FEWEST_STEPS, round(self._run.steps / multiple))
        motion = self.motion_of(model, multiple, which, count + 1)
        run = replay(motion, (count + 1) * float(motion.model.opt.timestep), self._workers)
        return self._observe(run.kept[:, count - 1 : count + 2])[0]

    def motion_of(
        self, model: mujoco.MjModel, multiple: int, which: np.ndarray, steps: int
    ) -> Motion:
        """Return M motions, as seeds of one, that begin where (M, 2) windows do."""
        own = run_at_once(model)
        own.opt.timestep = multiple * self.step
        starts, inputs = self.begun(multiple, which, steps)
        return replace(self._motion, model=own, starts=starts, inputs=inputs)

    def begun(self, multiple: int, which: np.ndarray, steps: int) -> tuple[Floats, Floats]:
        """Return states (M, nstate) that (M, 2) windows begin in, and (M, steps, width) inputs.

        A step that covers several of the run's has the mean of their inputs.
        """
        begins = self._run.begins[which[:, 1]]
        inputs = held(self._motion, self._finer, which[:, 0], begins, multiple, steps)
        return self._run.starts[which[:, 0], which[:, 1]], inputs

    @property
    def starts(self) -> np.ndarray:
        """(M, 2) seeds and windows that candidates begin in."""
        return self._which

    def uncertain(self) -> Apart | None:
        """Return what friction 10 % and each body's mass 5 % are worth; None without either.

        At the run's own step, with a solver that goes on: both sides have the same steps.
        """
        rate, found = self._finer, list[Apart]()
        base = reference_of(self._motion.model, 1)
        _, which = self._ends(rate)
        if not len(which):
            return None
        same = self.around(base, rate)
        for row in (row for row in ROWS if row.kind == _UNKNOWN and row.uses(base)):
            for change in row.changes:
                varied = reference_of(self._motion.model, 1)
                change(varied, self._motion.model)
                apart = self.apart(varied, rate, same)
                if math.isfinite(apart.share):
                    found.append(replace(apart, phase=f"{apart.phase}: {row.name}"))
        return max(found, key=lambda apart: apart.share, default=None)


def looked_at(windows: np.ndarray, every: int) -> tuple[np.ndarray, Floats]:
    """Return the first of windows and one in `every` of the others, and how many each stands for.

    In the first, constraints take up their load, which happens once.
    """
    first, others = windows[:1], windows[1:]
    chosen = others[(every - 1) // 2 :: every]
    stood_for = np.full(len(chosen), len(others) / max(len(chosen), 1))
    return np.concatenate([first, chosen]), np.concatenate([np.ones(len(first)), stood_for])


def held(
    motion: Motion, finer: int, seeds: np.ndarray, begins: np.ndarray, multiple: int, steps: int
) -> Floats:
    """Return (M, steps, width) inputs of seeds from fine steps (M) on, a row for each longer step.

    One that covers several of the motion's steps has the mean of their inputs.
    """
    if not motion.inputs.shape[2]:
        return np.empty((len(seeds), steps, 0))
    fine = begins[:, None] + np.arange(steps * multiple)
    rows = motion.inputs[seeds[:, None], np.minimum(fine // finer, motion.steps - 1)]
    return rows.reshape(len(seeds), steps, multiple, -1).mean(axis=2)


def at_steps(motion: Motion, finer: int, seeds: np.ndarray, multiple: int) -> Motion:
    """Return seeds of a motion from start to end, with inputs for steps of so many fine ones.

    Its model is as it was: what makes the steps is another.
    """
    own = without_delays(motion)
    steps = max(_FEWEST_STEPS, round(own.steps * finer / multiple))
    rows = held(own, finer, seeds, np.zeros(len(seeds), int), multiple, steps)
    return replace(own, starts=own.starts[seeds], inputs=rows)


@dataclass(frozen=True)
class Yardsticks:
    """Those of a task's phases, which are judged one by one: the worst counts."""

    parts: Sequence[Yardstick]
    finer: int

    @classmethod
    def of(
        cls, motions: Sequence[Motion], finer: int, workers: int, every: int = 1
    ) -> "Yardsticks":
        """Run the fine motions of phases."""
        found = [Yardstick(motion, finer, workers, every=every) for motion in motions]
        return cls(found, finer)

    @property
    def known(self) -> bool:
        """Whether the fine motion came through all phases."""
        return all(part.windows for part in self.parts)

    def known_ones(self) -> "Yardsticks":
        """Return those whose fine motion came through; all of them if none did."""
        return replace(self, parts=[part for part in self.parts if part.windows] or self.parts)

    @property
    def step(self) -> float:
        """The fine step [s]."""
        return self.parts[0].step

    def apart(self, model: mujoco.MjModel, multiple: int) -> Apart:
        """Return the largest distance of a model from the fine motion, over phases.

        The fine motion is a step of its own from the limit of fine steps: in first order, that is
        what is left to add, unless either is made by RK4.
        """
        worst = self.seen_apart(model, multiple)
        rest = 1.0
        if multiple > 1 and _RK4 not in (model.opt.integrator, self.parts[0].model.opt.integrator):
            rest = multiple / (multiple - 1)
        return replace(
            worst, share=worst.share * rest, low=worst.low * rest, high=worst.high * rest
        )

    def seen_apart(self, model: mujoco.MjModel, multiple: int) -> Apart:
        """Return the same of the fine motion as it is, whose step is left in it."""
        found = [part.apart(model, multiple) for part in self.parts]
        return max(found, key=lambda apart: apart.share)

    def around(self, made: Callable[[mujoco.MjModel, int], mujoco.MjModel]) -> list[Floats]:
        """Return, of each phase, velocities around windows' ends at the run's own step."""
        return [part.around(made(part.model, 1), self.finer) for part in self.parts]

    def apart_from(
        self, made: Callable[[mujoco.MjModel], mujoco.MjModel], same: Sequence[Floats]
    ) -> Apart:
        """Return how far a changed model is from velocities of the same steps, over phases."""
        found = [
            part.apart(made(part.model), self.finer, own)
            for part, own in zip(self.parts, same, strict=True)
        ]
        return max(found, key=lambda apart: apart.share)

    def uncertain(self) -> Apart | None:
        """Return the largest of what is unknown, over phases."""
        found = [apart for part in self.parts if (apart := part.uncertain())]
        return max(found, key=lambda apart: apart.share, default=None)
