"""How effects are read from a model and written into it."""

from collections.abc import Callable

import mujoco
import numpy as np

from contactlab.scene.effects.effect import RunState
from contactlab.scene.effects.unused import most_condim
from contactlab.scene.engine_flags import read_flag, write_flags

Turn = Callable[[mujoco.MjModel, bool], None]
Read = Callable[[RunState], bool]

# What each friction effect needs, and what is left without it.
_DIMS = {"tangential_friction": (3, 1), "torsional_friction": (4, 3), "rolling_friction": (6, 4)}
FRICTIONS = tuple(_DIMS)


def flag_is_on(name: str) -> Read:
    """Return how an engine switch is read."""
    return lambda run: read_flag(run.model, name)


def turn_flag(name: str) -> Turn:
    """Return how an engine switch is written."""
    return lambda model, on: write_flags(model, {name: on})


def has_dims(name: str) -> Read:
    """Return how a friction effect is read: whether a contact could have its dimensions."""
    return lambda run: most_condim(run.model) >= _DIMS[name][0]


def turn_dims(name: str) -> Turn:
    """Return how a friction effect is written: as a bound on the dimensions of every contact.

    Contacts take the most of their two geoms', so that a bound on each geom bounds the contact.
    """
    least, most = _DIMS[name]

    def turn(model: mujoco.MjModel, on: bool) -> None:
        bound, value = (np.maximum, least) if on else (np.minimum, most)
        for field in ("geom_condim", "pair_dim", "flex_condim"):
            array = getattr(model, field)
            array[:] = bound(array, value)

    return turn


def option_is_set(*names: str) -> Read:
    """Return how an effect is read that is there where an option is not zero."""
    return lambda run: any(np.any(getattr(run.model.opt, name)) for name in names)


def turn_options_off(*names: str) -> Turn:
    """Return how an effect is written that options of zero leave out."""

    def turn(model: mujoco.MjModel, on: bool) -> None:
        for name in () if on else names:
            value = getattr(model.opt, name)
            if isinstance(value, np.ndarray):
                value[:] = 0
            else:
                setattr(model.opt, name, 0)

    return turn


def is_elliptic(run: RunState) -> bool:
    """Say whether the friction cone is elliptic."""
    return bool(run.model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC)


def is_implicit(run: RunState) -> bool:
    """Say whether forces that depend on velocity are taken at the step's end."""
    explicit = (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_RK4)
    return run.model.opt.integrator not in explicit


def is_stiffer(run: RunState) -> bool:
    """Say whether friction is harder than the normal force."""
    return bool(run.model.opt.impratio > 1)


def turn_impratio(model: mujoco.MjModel, on: bool) -> None:
    """Make friction as hard as the normal force."""
    if not on:
        model.opt.impratio = 1


def turn_tendons(model: mujoco.MjModel, on: bool) -> None:
    """Leave tendons nothing that acts; idle ones are left out of the model before."""
    for field in ("stiffness", "damping", "frictionloss", "armature", "limited"):
        if not on and hasattr(model, f"tendon_{field}"):
            getattr(model, f"tendon_{field}")[:] = 0
