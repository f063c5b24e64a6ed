"""A model's options, flags and contact parameters, read as settings and written from them.

Flags are MuJoCo's disable and enable bits, whichever this version has; each is an effect of
the same name.
"""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from contactlab.mjcf import CONTACT, OPTIONS
from contactlab.scene.contact_pairs import MonitoredPair, effective_parameters
from contactlab.scene.mujoco_versions import enum_members
from contactlab.scene.parameters import WORDS
from contactlab.scene.setting_values import Settings

# Recording needs these: sensors carry the evidence, an automatic reset would hide a divergence, and
# the energy flag makes the kinetic energy sensor lag a step.
_FIXED = {"sensor": True, "autoreset": False, "energy": False, "fwdinv": False}
# Override replaces the contact parameters of every geom, and so those of a sweep.
_UNSUPPORTED = {"ipc", "override"}
_DISABLE, _ENABLE = (
    {name.lower(): bit for name, bit in enum_members(enum, prefix).items()}
    for enum, prefix in ((mujoco.mjtDisableBit, "mjDSBL_"), (mujoco.mjtEnableBit, "mjENBL_"))
)
FLAGS = tuple(sorted((_DISABLE.keys() | _ENABLE.keys()) - _FIXED.keys() - _UNSUPPORTED))


def read_flags(model: mujoco.MjModel) -> dict[str, bool]:
    """Return every flag of a model; True means that its effect is on."""
    return {name: read_flag(model, name) for name in sorted(_DISABLE | _ENABLE)} | _FIXED


def read_flag(model: mujoco.MjModel, name: str) -> bool:
    """Return one flag of a model; True means that its effect is on."""
    if name in _DISABLE:
        return not int(model.opt.disableflags) & _DISABLE[name]
    return bool(int(model.opt.enableflags) & _ENABLE[name])


def non_default(states: Mapping[str, bool]) -> dict[str, bool]:
    """Return the flags that differ from MuJoCo's defaults.

    A version that lacks a flag behaves as with its default, so the result is the same for every
    version.
    """
    return {name: state for name, state in states.items() if state != (name in _DISABLE)}


def write_flags(model: mujoco.MjModel, states: Mapping[str, bool]) -> None:
    """Set the given flags, and those that recording needs."""
    for name, state in {**states, **_FIXED}.items():
        disable = name in _DISABLE
        field, bit = ("disableflags", _DISABLE[name]) if disable else ("enableflags", _ENABLE[name])
        others = int(getattr(model.opt, field)) & ~bit
        setattr(model.opt, field, others | bit if state != disable else others)


MODEL_ENGINE = "mujoco"
"""The engine that models are written for, and that runs a sweep that names none."""


def base_settings(
    model: mujoco.MjModel, pairs: Sequence[MonitoredPair], subject: int | None
) -> Settings:
    """Return every setting of a compiled model: what a run has before its sweep changes any.

    Contact settings are those of the first monitored pair, since a sweep sets them for all pairs;
    `mass` is the subject's, if there is one.
    """
    settings = Settings(engine=MODEL_ENGINE)
    settings |= {name: read_option(model, name) for name in OPTIONS}
    if pairs:
        first = effective_parameters(model, pairs[0])
        settings |= {name: getattr(first, name) for name in CONTACT}
    if subject is not None:
        settings["mass"] = float(model.body_mass[subject])
    return settings


def read_option(model: mujoco.MjModel, name: str) -> object:
    """Return an attribute of <option> as a setting: a number, a word or a tuple of numbers."""
    value = getattr(model.opt, name)
    if name in WORDS:
        return WORDS[name][value]
    return tuple(value.tolist()) if isinstance(value, np.ndarray) else value


def write_option(model: mujoco.MjModel, name: str, value: object) -> None:
    """Write a setting into a model's options, in place."""
    setattr(model.opt, name, WORDS[name].index(str(value)) if name in WORDS else value)
