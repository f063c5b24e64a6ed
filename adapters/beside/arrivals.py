"""Whether a model arrived in an engine as it was sent."""

from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

_PRECISION = 1e-6  # of what arrives, which an engine may keep in single precision
_NOTHING = 1e-9  # of the largest row, as which a row of zeros may arrive
_TINY = 1e-15


def positive(amounts: np.ndarray) -> np.ndarray:
    """Return masses or inertias with those that are 0 so small that rounding hides them."""
    return np.where(amounts > 0, amounts, _TINY * amounts.max())


def compare(
    what: str, sent: Any, arrived: Any, names: Sequence[str], scale: float | None = None
) -> None:
    """Raise a ValueError that names the first of some rows that did not arrive as it was sent.

    They are compared relative to each row's largest number, or to a scale. A row of zeros may
    arrive as 1e-9 of the largest row: some engines have no bodies without mass.
    """
    shape = len(names), -1 if len(names) else 0
    sent, arrived = (np.asarray(each, dtype=float).reshape(shape) for each in (sent, arrived))
    if scale is None:
        largest = np.abs(sent).max(axis=1, initial=0, keepdims=True)
        nothing = _NOTHING * largest.max(initial=_TINY)
        within = np.where(largest > 0, _PRECISION * largest, nothing)
    else:
        within = _PRECISION * scale
    wrong = ~(np.abs(arrived - sent) <= within).all(axis=1)
    for row in np.flatnonzero(wrong)[:1]:
        was, found = (" ".join(f"{value:.7g}" for value in each[row]) for each in (sent, arrived))
        raise ValueError(f"{what} of {names[row]} was sent as {was} and arrived as {found}")


def check_dynamics(
    model: mujoco.MjModel,
    dynamics: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]],
) -> None:
    """Raise a ValueError unless inertia and forces of motion and gravity are MuJoCo's.

    An engine tells them of coordinates and velocities: (nv, nv) with armatures and (nv,). They are
    compared away from zero, where every mass, inertia, frame and axis of a joint tells in them.
    """
    data, draw = mujoco.MjData(model), np.random.default_rng(0)
    mujoco.mj_integratePos(model, data.qpos, draw.normal(size=model.nv), 0.5)
    data.qvel[:] = draw.normal(size=model.nv)
    mujoco.mj_forward(model, data)
    sent, (inertia, bias) = np.zeros((model.nv, model.nv)), dynamics(data.qpos, data.qvel)
    mujoco.mj_fullM(model, data, sent)
    joints = (f"joint '{model.joint(each).name or each}'" for each in model.dof_jntid)
    names = [f"{joint}, dof {dof}," for dof, joint in enumerate(joints)]
    compare("the inertia", sent, inertia, names)
    compare(
        "the bias", data.qfrc_bias, bias, names, float(np.abs(data.qfrc_bias).max(initial=_TINY))
    )
