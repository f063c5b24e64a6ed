"""A model's options and contact parameters as settings: read from a model, written to one."""

from collections.abc import Sequence

import mujoco

from contactlab.mjcf import CONTACT, OPTIONS
from contactlab.scene.contact_pairs import MonitoredPair, effective_parameters
from contactlab.scene.parameters import WORDS
from contactlab.scene.settings import Settings, as_vector

ENGINES = ("mujoco", "impulse")


def base_settings(
    model: mujoco.MjModel, pairs: Sequence[MonitoredPair], subject: int | None
) -> Settings:
    """Return every setting of a compiled model: what a run has before its sweep changes any.

    Contact settings are those of the first monitored pair, since a sweep sets them for all pairs.

    Args:
        model: the model.
        pairs: its monitored pairs.
        subject: id of the body that the setting `mass` means, if there is one.
    """
    settings = Settings(engine=ENGINES[0])
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
    match OPTIONS[name]:
        case "number":
            return float(value)
        case "integer":
            return int(value)
        case "vector":
            return tuple(float(part) for part in value)
        case "word":
            return WORDS[name][value]


def write_option(model: mujoco.MjModel, name: str, value: object) -> None:
    """Write a setting into a model's options, in place."""
    match OPTIONS[name]:
        case "number" | "integer":
            setattr(model.opt, name, value)
        case "vector":
            getattr(model.opt, name)[:] = as_vector(value)
        case "word":
            setattr(model.opt, name, WORDS[name].index(str(value)))
