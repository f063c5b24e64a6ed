"""Distances of changed models to the motion at its finest step.

All begin in states of that finest motion. So a run that diverges is compared from states of the
motion, and all changes from the same states.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.budget.defects import measure_defects, measure_paths, slack_share
from contactlab.budget.measuring import Settings
from contactlab.budget.motion import GRAVITY_AS_REAL, Motion, without_delays
from contactlab.budget.restarts import (
    build_reference_model,
    refine_motion,
    run_at_once,
    scale_of_impulses,
)
from contactlab.budget.windows import (
    Observer,
    Run,
    Windows,
    body_name,
    judged_bodies,
    replay_motion,
    split_windows,
)
from contactlab.modifications.model_predicates import read_gravity

FINEST = 8
"""Least number of steps of the finest motion per step of the run."""


@dataclass(frozen=True)
class ChangedModel:
    """A model that is compared with the finest motion, with `rate` steps per step of the run."""

    model: mujoco.MjModel
    rate: int = 1


def distances_to_reference(
    motion: Motion,
    rivals: Sequence[ChangedModel],
    *,
    settings: Settings,
    target: Callable[[mujoco.MjModel], None] = lambda _model: None,
    finest: int = FINEST,
) -> list[float]:
    """Return the distance of each changed model to a motion at its finest step, worst body.

    Distances are shares, as numerical errors are. `target` changes the model of the finest motion
    first, in place; it has `finest` steps per step of the run. Bodies that are not observed do not
    count. A distance is infinite if the engine fails in the changed model or the finest motion.
    """
    undelayed, fine_model = without_delays(motion), build_reference_model(motion.model, finest)
    target(fine_model)
    # The finest motion is cut into windows of the run's whole steps.
    step = fine_model.opt.timestep * finest
    steps = min(motion.steps, max(1, round(settings.window / step)))
    fine = replay_motion(
        refine_motion(undelayed, fine_model, finest), steps * step, settings.workers
    )
    states = fine.velocity_states[:, ::finest]
    states = np.concatenate([states, states[:, -1:]], axis=1)
    run = Run(steps, fine.begins // finest, fine.starts, states, fine.valid, ())
    bodies = judged_bodies(motion.model)
    observer = Observer(motion.model, motion.starts[0], bodies, settings.workers)
    models = [(run_at_once(rival.model), rival.rate) for rival in rivals]
    apart = np.zeros((len(rivals), motion.seeds, len(bodies)))
    real = np.zeros((motion.seeds, len(bodies)))
    most = (run.steps + 1) * max(finest, *(rate for _, rate in models), 1)
    for block in split_windows(fine_model, np.argwhere(run.valid), most):
        windows = Windows(undelayed, run, settings.workers, block)
        fine_states, lost = windows.roll_out(fine_model, finest, whole=True)
        velocities = observer(fine_states)[0]
        path = np.where(
            lost[:, None], 0, measure_paths(velocities[:, : run.steps * finest + 1 : finest])
        )
        speed = np.linalg.norm(velocities[:, 0], axis=-1) * (block[:, 1] == 0)[:, None]
        np.add.at(real, block[:, 0], path + speed)
        for number, (model, rate) in enumerate(models):
            changed_states, failed = windows.roll_out(model, rate)
            around = velocities[:, (run.steps - 1) * finest :]
            own = measure_defects(observer(changed_states)[0], around, slack_share(run.steps))
            own[failed] = np.inf
            np.add.at(apart[number], block[:, 0], np.where(lost[:, None], 0, own))
    if not run.valid.any():
        return [float("inf")] * len(rivals)
    span = run.steps * motion.model.opt.timestep * run.valid.sum(axis=1)
    real += GRAVITY_AS_REAL * read_gravity(motion.model) * span[:, None]
    if motion.usual is not None:
        real = np.maximum(real, GRAVITY_AS_REAL * motion.usual[bodies] * span[:, None])
    # Seeds without a window have no share.
    has_windows = real.any(axis=1)
    shares = (apart / scale_of_impulses(real))[:, has_windows].mean(axis=1)
    observed_bodies = [
        not motion.observed or body_name(motion.model, int(body)) in motion.observed
        for body in bodies
    ]
    return shares[:, observed_bodies].max(axis=1, initial=0).tolist()
