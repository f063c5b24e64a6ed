"""Claims of `contactlab effects MODEL`, in plain MuJoCo: under pushes, tilts, twice the inputs.

Run: python -m bench.effects_truth FOLDER [MODEL]

The folder has, or gets, the study of the model. What is called unused, provably or in this task, is
left out and has to move bit for bit as before, on seeds of the study and, where it is proved, on
fresh ones; a part below the tolerance has to differ by the share that is said of it, measured anew
by the obvious loops of `bench.tune_error`.
"""

import copy
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
from bench.tune_error import Plain, shares

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.parts import register_parts
from contactlab.plan.task_options import TaskOptions
from contactlab.schema.parts_report import REPORT, PartEffect, PartsReport
from contactlab.studies.search.model_ablation import (
    PartsRequest,
    Removal,
    ablate_model,
    find_features,
    stress_motions_of,
)
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.reference_error import TaskReference
from contactlab.tasks.session import Session
from contactlab.tasks.task_motions import with_new_seeds

DURATION, MAX_TIME = 0.4, 240.0
MORE = 1.05
"""Of what is said, that a share may be: the study's reference solver is another."""


def rolled(motion: Motion, change: Removal) -> tuple[bytes, set[tuple[int, int]]]:
    """Return the bits of a motion with a changed model, and the pairs of bodies that touch."""
    model, states, touching = copy.copy(motion.model), list[bytes](), set[tuple[int, int]]()
    change(model)
    data = mujoco.MjData(model)
    for seed in range(motion.seeds):
        mujoco.mj_setState(model, data, motion.starts[seed], INTEGRATION)
        for step in range(motion.steps):
            if motion.inputs.shape[2]:
                mujoco.mj_setState(model, data, motion.inputs[seed, step], motion.spec)
            mujoco.mj_step(model, data)
            states.append(data.qpos.tobytes() + data.qvel.tobytes())
            bodies = np.sort(model.geom_bodyid[data.contact.geom], axis=1)
            touching.update(map(tuple, bodies.tolist()))
    return b"".join(states), touching


def share_without(motion: Motion, change: Removal) -> float:
    """Return the share of the worst body by which a motion differs without a part."""

    def plain(model: mujoco.MjModel) -> Plain:
        found = Plain(model, model.opt.timestep)
        found.model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
        found.model.opt.iterations = max(100, model.opt.iterations)
        found.model.opt.tolerance = min(1e-10, model.opt.tolerance)
        return found

    base, other = plain(motion.model), plain(motion.model)
    change(other.model)
    step = float(motion.model.opt.timestep)
    each = [shares(base, other, motion, seed, step) for seed in range(motion.seeds)]
    return float(np.mean(each, axis=0).max())


class Evaluation:
    """A study whose claims are tried."""

    def __init__(self, folder: Path, model: str) -> None:
        """Read the study, or make it."""
        options = TaskOptions(duration=DURATION)
        if not (folder / REPORT).exists():
            ablate_model(PartsRequest(model, task=options, max_time=MAX_TIME), Session(folder))
        self.report = PartsReport.model_validate_json((folder / REPORT).read_text())
        options = TaskOptions(duration=self.report.task.duration)
        examined = open_model(self.report.model, Session(Path()), options)
        self.own, self.fresh = (
            stress_motions_of(motions)
            for motions in (examined.motions, examined.motions_of(with_new_seeds(examined.task)))
        )
        yards = TaskReference.run_references(self.own, 1, 1)
        positions = [part.positions for part in yards.phases]
        self.parts = {
            (part.kind, part.name): part for part in find_features(self.own, positions, 1)
        }
        self.moved = {
            motion.name + which: rolled(motion, lambda _: None)
            for which, motions in (("", self.own), (", fresh seeds", self.fresh))
            for motion in motions
        }
        self.ratios = list[float]()

    def wrong(self) -> Iterator[str]:
        """Yield what does not hold."""
        for part in self.report.parts:
            if part.verdict == "unused":
                yield from self._moved(part, self.own, "")
                yield from self._moved(part, self.fresh, ", fresh seeds")
            elif part.verdict == "not exercised":
                yield from self._moved(part, self.own, "")
            elif part.verdict == "below the tolerance" and part.error is not None:
                change = self.parts[part.kind, part.name].removal
                found = max(share_without(motion, change) for motion in self.own)
                self.ratios.append(found / part.error if part.error > 1e-4 else 1.0)
                if not found <= MORE * part.error + 1e-4:
                    yield f"{part.name}: {found:.2%} for {part.error:.2%}"

    def _moved(self, part: PartEffect, motions: list[Motion], which: str) -> Iterator[str]:
        for motion in motions:
            states, touching = self.moved[motion.name + which]
            if part.kind == "pair":
                one, other = sorted(motion.model.body(n).id for n in part.name.split(" - "))
                if (one, other) in touching:
                    yield f"{part.name} touch in {motion.name}{which}"
            elif rolled(motion, self.parts[part.kind, part.name].removal)[0] != states:
                yield f"{part.verdict}: {part.kind} {part.name} in {motion.name}{which}"


def measure(folder: Path, model: str) -> str:
    """Return a line about one study."""
    tried = Evaluation(folder, model)
    wrong = list(tried.wrong())
    counted = Counter(part.verdict for part in tried.report.parts)
    ratios = ""
    if tried.ratios:
        low, high = min(tried.ratios), max(tried.ratios)
        ratios = f", shares {low:.2f} to {high:.2f} of what is said"
    told = f"{len(wrong)} WRONG: {wrong}" if wrong else "none wrong"
    ended = ", ended by time" if tried.report.timed_out else ""
    return f"{folder.name}: {dict(counted)}{ratios}; {told}{ended}"


if __name__ == "__main__":
    register_parts()
    print(measure(Path(sys.argv[1]), *sys.argv[2:]), flush=True)
