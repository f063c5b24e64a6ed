"""A model's settings as plain values: what a run starts from before its sweep changes any."""

from collections.abc import Sequence

import mujoco
import numpy as np

from contactlab.scene.contact_pairs import MonitoredPair, effective_parameters
from contactlab.scene.parameters import (
    CONES,
    CONTACT_SETTINGS,
    INTEGRATORS,
    JACOBIANS,
    SOLVERS,
)

ENGINES = ("mujoco", "impulse")
OPTION_WORDS = {
    "integrator": INTEGRATORS,
    "cone": CONES,
    "solver": SOLVERS,
    "jacobian": JACOBIANS,
}
OPTION_NUMBERS = (
    "timestep",
    "tolerance",
    "ls_tolerance",
    "noslip_tolerance",
    "ccd_tolerance",
    "impratio",
    "density",
    "viscosity",
)
OPTION_INTEGERS = ("iterations", "ls_iterations", "noslip_iterations", "ccd_iterations")
OPTION_VECTORS = ("gravity", "wind")


def base_settings(
    model: mujoco.MjModel, pairs: Sequence[MonitoredPair], subject: int | None
) -> dict[str, object]:
    """Return every setting of a compiled model, in the units of the parameters table.

    Contact settings are those of the first monitored pair, since a sweep sets them for all pairs.
    """
    option = model.opt
    settings: dict[str, object] = {"engine": ENGINES[0]}
    settings |= {name: float(getattr(option, name)) for name in OPTION_NUMBERS}
    settings |= {name: int(getattr(option, name)) for name in OPTION_INTEGERS}
    settings |= {name: _vector(getattr(option, name)) for name in OPTION_VECTORS}
    settings |= {name: words[getattr(option, name)] for name, words in OPTION_WORDS.items()}
    if pairs:
        first = effective_parameters(model, pairs[0])
        settings |= {name: getattr(first, name) for name in CONTACT_SETTINGS}
    if subject is not None:
        settings["mass"] = float(model.body_mass[subject])
    return settings


def _vector(values: np.ndarray) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
