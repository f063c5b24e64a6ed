"""The error of a model that `tune` wrote, measured anew in plain MuJoCo, by obvious loops.

Run: python -m bench.tune_error FOLDER

The folder is that of the study. The model as written runs at the study's fine step; in windows of
40 ms, the written model begins where that motion is, and is held against it at the window's end.
docs/how-to/budget.md defines the share. Of a written model whose bodies may sleep, the larger
counts of that and of its own whole runs, whose windows are held against itself awake.
Nothing is shared with the study but its motions' starts and inputs.
"""

import copy
import itertools
import sys
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from bench.tune_cost import answers_of, motions_of

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.schema.tune_report import REPORT, Candidate, TuneReport

WINDOW, WEIGHT, FINER = 0.04, 0.1, 16
SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)


class Plain:
    """One model, stepped one step after the other, and the velocities of its bodies."""

    def __init__(self, model: mujoco.MjModel, step: float) -> None:
        self.model, self.data = copy.copy(model), mujoco.MjData(model)
        self.looked = mujoco.MjData(model)
        self.model.opt.timestep = step
        mass = np.maximum(model.body_mass, 1e-300)
        self.radius = np.sqrt(model.body_inertia.max(axis=1) / mass)
        moving = (model.body_weldid > 0) & (model.body_mass > 1e-9 * model.body_mass[1:].max())
        self.bodies = np.flatnonzero(moving)

    def begin(self, state: np.ndarray) -> None:
        """Go to a state of mjSTATE_INTEGRATION."""
        mujoco.mj_setState(self.model, self.data, state, INTEGRATION)

    def state(self) -> np.ndarray:
        """Return the state."""
        found = np.empty(mujoco.mj_stateSize(self.model, INTEGRATION))
        mujoco.mj_getState(self.model, self.data, found, INTEGRATION)
        return found

    def step(self, inputs: np.ndarray, spec: int) -> None:
        """Make a step with inputs (width,), if there are any."""
        if len(inputs):
            mujoco.mj_setState(self.model, self.data, inputs, spec)
        mujoco.mj_step(self.model, self.data)

    def velocities(self) -> np.ndarray:
        """Return (B, 6) velocities of centres of mass, and spins times radii of gyration."""
        looked = self.looked
        looked.qpos[:], looked.qvel[:] = self.data.qpos, self.data.qvel
        mujoco.mj_kinematics(self.model, looked)
        mujoco.mj_comPos(self.model, looked)
        mujoco.mj_comVel(self.model, looked)
        found, kind = np.empty((len(self.bodies), 6)), mujoco.mjtObj.mjOBJ_BODY
        for place, body in enumerate(self.bodies):
            mujoco.mj_objectVelocity(self.model, looked, kind, body, found[place], 0)
            found[place, :3] *= self.radius[body]
        return found


def shares(written: Plain, tuned: Plain, motion: Motion, seed: int, own: float) -> np.ndarray:
    """Return (B,) phantom impulses over real ones, of a seed of a phase whose step is `own`."""
    fine, step = written.model.opt.timestep, tuned.model.opt.timestep
    rate, multiple = round(own / fine), round(step / fine)
    steps = max(1, round(WINDOW / own)) * rate
    held = max(2, round(steps / multiple))
    total = motion.steps * rate
    inputs = motion.inputs[seed].repeat(rate, axis=0)
    written.begin(motion.starts[seed])
    states, speeds = dict[int, np.ndarray](), list[np.ndarray]()
    for place in range(total + 1):
        if place % steps == 0:
            states[place] = written.state()
        speeds.append(written.velocities())
        if place < total:
            written.step(inputs[place], motion.spec)
    phantom, real = np.zeros(len(written.bodies)), np.zeros(len(written.bodies))
    for begin, state in states.items():
        end = begin + held * multiple
        if begin + steps > total or end + multiple > total:
            continue
        tuned.begin(state)
        seen = [tuned.velocities()]
        for place in range(begin, end + multiple, multiple):
            tuned.step(inputs[place : place + multiple].mean(axis=0), motion.spec)
            seen.append(tuned.velocities())
        fast = np.array(speeds[end - multiple : end + multiple + 1])
        slow = np.array(seen[held - 1 : held + 2])
        apart = np.maximum(away(slow[1], fast), away(fast[multiple], slow))
        phantom += apart * steps / (held * multiple)
        real += impulses(written, np.array(speeds[begin : begin + steps + 1 : rate]), own)
        if begin == 0:
            real += np.linalg.norm(speeds[0], axis=1)
    return over(phantom, real)


def own_shares(tuned: Plain, awake: Plain, motion: Motion, seed: int) -> np.ndarray:
    """Return the same of a model along its own run, held against itself, awake at finer steps."""
    step = tuned.model.opt.timestep
    length = max(1, round(WINDOW / step))
    tuned.begin(motion.starts[seed])
    states, speeds = list[np.ndarray](), [tuned.velocities()]
    for inputs in motion.inputs[seed]:
        states.append(tuned.state())
        tuned.step(inputs, motion.spec)
        speeds.append(tuned.velocities())
    slow = np.array(speeds)
    phantom, real = np.zeros(len(tuned.bodies)), np.linalg.norm(slow[0], axis=1)
    for begin in range(0, motion.steps - length, length):
        awake.begin(states[begin])
        seen, end = [awake.velocities()], begin + length
        for inputs in motion.inputs[seed, begin : end + 1].repeat(FINER, axis=0):
            awake.step(inputs, motion.spec)
            seen.append(awake.velocities())
        fast, last = np.array(seen), length * FINER
        there = away(slow[end], fast[last - FINER : last + FINER + 1])
        phantom += np.maximum(there, away(fast[last], slow[end - 1 : end + 2]))
        real += impulses(tuned, slow[begin : end + 1], step)
    return over(phantom, real)


def over(phantom: np.ndarray, real: np.ndarray) -> np.ndarray:
    """Return (B,) impulses over others; those of bodies that hardly move are no scale."""
    return phantom / (np.maximum(real, 1e-6 * real.max()) + 1e-300)


def impulses(written: Plain, way: np.ndarray, step: float) -> np.ndarray:
    """Return (B,) real impulses over mass along velocities (K, B, 6) of steps [m/s]."""
    weightless = int(written.model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    gravity = 0.0 if weightless else float(np.linalg.norm(written.model.opt.gravity))
    fall = WEIGHT * gravity * step * (len(way) - 1)
    return np.linalg.norm(np.diff(way, axis=0), axis=2).sum(axis=0) + fall


def away(one: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Return (B,) distances of velocities (B, 6) from a line through (K, B, 6)."""
    best = np.full(len(one), np.inf)
    for first, last in itertools.pairwise(line):
        along = last - first
        part = ((one - first) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-300)
        near = first + np.clip(part, 0, 1)[:, None] * along
        best = np.minimum(best, np.linalg.norm(one - near, axis=1))
    return best


def measured(report: TuneReport, motions: Sequence[Motion], point: Candidate, file: str) -> float:
    """Return the error of an answer, whose model is in a file."""
    fine = report.reference_step
    written, tuned = (
        Plain(mujoco.MjModel.from_xml_path(path), step)
        for path, step in ((report.model, fine), (file, point.timestep))
    )
    own = mujoco.MjModel.from_xml_path(report.model).opt.timestep
    go_on(written)
    worst = 0.0
    for motion in motions:
        each = [shares(written, tuned, motion, seed, own) for seed in range(motion.seeds)]
        worst = max(worst, float(np.mean(each, axis=0).max()))
    multiple = round(point.timestep / fine)
    both = [written.model.opt.integrator, tuned.model.opt.integrator]
    is_rk4 = mujoco.mjtIntegrator.mjINT_RK4 in both
    found = worst * (1.0 if is_rk4 or multiple < 2 else multiple / (multiple - 1))
    if not tuned.model.opt.enableflags & SLEEP:
        return found
    awake = Plain(tuned.model, point.timestep / FINER)
    awake.model.opt.enableflags &= ~SLEEP
    go_on(awake)
    for motion in motions_of(report, report.task, file):
        each = [own_shares(tuned, awake, motion, seed) for seed in range(motion.seeds)]
        found = max(found, float(np.mean(each, axis=0).max()))
    return found


def go_on(plain: Plain) -> None:
    """Give a model a solver that goes on."""
    option = plain.model.opt
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.iterations, option.tolerance = max(100, option.iterations), min(1e-10, option.tolerance)


def measure(folder: Path) -> str:
    """Return a line about one study."""
    report = TuneReport.model_validate_json((folder / REPORT).read_text())
    motions, parts = motions_of(report, report.task), list[str]()
    for name, (point, file) in answers_of(report).items():
        found, claimed = measured(report, motions, point, str(folder / file)), point.error
        assert claimed
        parts.append(f"{name}: error claimed {claimed:.3%}, measured {found:.3%}")
        parts[-1] += f" ({found / claimed - 1:+.1%})"
    now = f"as written {report.current.error or np.nan:.3%}, target {report.target.limit:.3%}"
    return f"{folder.name}: {'; '.join(parts) or 'kept'}; {now}"


if __name__ == "__main__":
    print(measure(Path(sys.argv[1])))
