"""The error of a model that `tune` wrote, measured again in plain MuJoCo, by obvious loops.

Run: python -m bench.tune_error FOLDER

The folder is that of the study. The written model runs from the starts of the task; in windows of
40 ms of that run, the model as written goes on from its states at a quarter and an eighth of the
step, and is compared with it at the window's end. docs/theory/error-budget.md defines the error.
The study shares nothing but the starts and inputs of its motions.
"""

import copy
import itertools
import sys
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from bench.tune_cost import answers_of, file_of, motions_of

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.schema.tune_report import REPORT, TuneReport

WINDOW, WEIGHT, RATES = 0.04, 0.1, (4, 8)
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
        spins, speeds = looked.cvel[self.bodies, :3], looked.cvel[self.bodies, 3:]
        arms = looked.xipos - looked.subtree_com[self.model.body_rootid]
        speeds = speeds + np.cross(spins, arms[self.bodies])
        return np.concatenate([spins * self.radius[self.bodies, None], speeds], axis=1)


def build_references(written: mujoco.MjModel, tuned: mujoco.MjModel) -> list[Plain]:
    """Return the model as written at fractions of a candidate's step, with its integrator."""
    step = float(tuned.opt.timestep)
    references = [Plain(written, step / rate) for rate in RATES]
    for reference in references:
        reference.model.opt.integrator = tuned.opt.integrator
        reference.model.opt.enableflags &= ~SLEEP
        go_on(reference)
    return references


def own_shares(
    tuned: Plain, references: Sequence[Plain], motion: Motion, seed: int, own: float
) -> np.ndarray:
    """Return (2, B) residual impulses over real ones, of a seed of a phase whose step is `own`."""
    step = float(tuned.model.opt.timestep)
    total = max(2, round(motion.steps * own / step))
    edges = np.minimum(np.round(np.arange(total + 2) * step / own), motion.steps).astype(int)
    rows = motion.inputs[seed]
    inputs = [
        rows[min(first, motion.steps - 1) : max(last, first + 1)].mean(axis=0)
        for first, last in itertools.pairwise(edges.tolist())
    ]
    inputs[-1] = inputs[-2]
    tuned.begin(motion.starts[seed])
    states, speeds = list[np.ndarray](), [tuned.velocities()]
    for row in inputs:
        states.append(tuned.state())
        tuned.step(row, motion.spec)
        speeds.append(tuned.velocities())
    slow = np.array(speeds)
    length = min(total, max(1, round(WINDOW / step)))
    residual = np.zeros((len(RATES), len(tuned.bodies)))
    real = np.linalg.norm(slow[0], axis=1)
    begins = np.minimum(np.arange(-(-total // length)) * length, total - length).tolist()
    for begin in begins:
        for place, (rate, reference) in enumerate(zip(RATES, references, strict=True)):
            reference.begin(states[begin])
            whole, fine = [reference.velocities()], [reference.velocities()] * (length == 1)
            for number, row in enumerate(inputs[begin : begin + length + 1], 1):
                for _ in range(rate):
                    reference.step(row, motion.spec)
                    if number >= length:
                        fine.append(reference.velocities())
                if number == length - 1:
                    fine.append(reference.velocities())
                if not place and number <= length:
                    whole.append(reference.velocities())
            end, middle = begin + length, fine[rate]
            fast = within(np.array(fine), length / 4)
            around = within(slow[end - 1 : end + 2], length / 4)
            there = away(slow[end], fast)
            residual[place] += np.maximum(there, away(middle, around))
            if not place:
                real += impulses(tuned, np.array(whole), step)
    return np.array([over(each, real) for each in residual])


def within(line: np.ndarray, share: float) -> np.ndarray:
    """Return the part of velocities (2 r + 1, B, 6) within a share of each side of the middle."""
    reach = len(line) // 2
    places = [place for place in range(-reach, reach + 1) if abs(place) < share * reach]
    if share >= 1:
        return line
    ends = [-share * reach, *places, share * reach]
    return np.array(
        [
            line[reach + int(np.floor(at))]
            + (at - np.floor(at))
            * (line[reach + int(np.ceil(at))] - line[reach + int(np.floor(at))])
            for at in ends
        ]
    )


def measure_phase(each: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (B,) errors and their standard errors, from (seeds, 2, B) shares at both steps."""
    coarse, fine = each[:, 0], each[:, 1]
    factor = 2 * fine.sum(axis=0) / np.maximum(coarse.sum(axis=0), 1e-300) - 1
    shares = np.maximum(factor, 0.5) * coarse
    spread = shares.std(axis=0, ddof=1) / np.sqrt(len(shares)) if len(shares) > 1 else 0 * factor
    return shares.mean(axis=0), spread


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


def measured(report: TuneReport, motions: Sequence[Motion], file: str) -> float:
    """Return the error of an answer, whose model is in a file."""
    written, tuned = (mujoco.MjModel.from_xml_path(path) for path in (file_of(report.model), file))
    references = build_references(written, tuned)
    plain, own = Plain(tuned, float(tuned.opt.timestep)), float(written.opt.timestep)
    each = [
        np.array([own_shares(plain, references, motion, seed, own) for seed in range(motion.seeds)])
        for motion in motions
    ]
    return max(float(measure_phase(found)[0].max()) for found in each)


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
        found, claimed = measured(report, motions, str(folder / file)), point.error
        assert claimed
        parts.append(f"{name}: error claimed {claimed:.3%}, measured {found:.3%}")
        parts[-1] += f" ({found / claimed - 1:+.1%})"
    now = f"as written {report.current.error or np.nan:.3%}, target {report.target.limit:.3%}"
    return f"{folder.name}: {'; '.join(parts) or 'kept'}; {now}"


if __name__ == "__main__":
    print(measure(Path(sys.argv[1])))
