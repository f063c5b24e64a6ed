"""Count what the engine does in a run, and keep states along it from which to time it."""

from collections.abc import Callable
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.contact import Floats
from contactlab.engines.rollout import driven, start_batch
from contactlab.engines.stepping import Batch, SimulationError
from contactlab.scene import Starts

# States kept along a run, its start among them.
PLACES = 8
_BLOCK = 1 << 14
_FIELDS = ("solver_niter", "ncon", "nefc")


class Work(NamedTuple):
    """What the engine did in all steps of a run.

    Attributes:
        steps: steps.
        iterations: solver iterations, summed over contact islands.
        contacts: contacts in the whole model.
        rows: constraint rows.
        places: (P,) steps before which states were kept.
        states: (P, nstate) these states, all that decides what follows.
    """

    steps: int
    iterations: int
    contacts: int
    rows: int
    places: tuple[int, ...]
    states: Floats


def count_work(
    model: mujoco.MjModel, start: Starts, steps: int, watch: Callable[[], None] = lambda: None
) -> Work | None:
    """Run once, untimed, and count; None if the run does not go through.

    Args:
        model: what to step.
        start: where it starts, n being 1.
        steps: how many to make.
        watch: called before each block of steps, to start its time limit.
    """
    batch = start_batch([model], start)
    places = np.unique(np.linspace(0, steps, PLACES, endpoint=False).astype(int)).tolist()
    counts = np.zeros(len(_FIELDS), np.int64)
    states: list[Floats] = []
    for begin, end in zip(places, [*places[1:], steps], strict=True):
        states.append(np.array(batch.state[0]))
        for done in range(begin, end, _BLOCK):
            watch()
            found = _counted(batch, model, start, range(done, min(done + _BLOCK, end)))
            if found is None:
                return None
            counts += found
    iterations, contacts, rows = counts.tolist()
    return Work(steps, iterations, contacts, rows, tuple(places), np.array(states))


def _counted(batch: Batch, model: mujoco.MjModel, start: Starts, steps: range) -> np.ndarray | None:
    inputs = driven(model, start, 0, len(steps), steps.start)
    try:
        out = batch.rollout(len(steps), record=list(_FIELDS), **inputs)
    except SimulationError:
        return None
    if batch.warning.any():
        return None
    # There are as many places as the engine could need, but at most one island a tree.
    out["solver_niter"] = out["solver_niter"][..., : max(1, model.ntree)]
    return np.array([int(out[name].sum(dtype=np.int64)) for name in _FIELDS])
