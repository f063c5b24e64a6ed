"""Variants of an episode: the same environment and policy under another setting.

The catalogue of modifications declares them. A run names its variant in the axis `variant`.
"""

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import mujoco

from contactlab.mjcf import OPTIONS
from contactlab.registry import own_parts
from contactlab.scene.model_edits import FLAG_NAMES, write_flags, write_option
from contactlab.schema.vocabulary import VARIANT

AS_WRITTEN = "as written"
"""The variant that changes nothing."""
VariantKind = Literal["numerics", "control", "robot"]


def keep_model(_model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
    """Change nothing."""


@dataclass(frozen=True)
class Variant:
    """A variant of an episode.

    Attributes:
        name: as the value of the axis `variant`, and in tables.
        summary: the change, in a few words.
        kind: `numerics` if an outcome must not depend on it, `robot` if a robot meets it,
            `control` if it is far below anything that a robot or a solver can distinguish.
        change: changes a copy of a model in place; the second argument is the model before.
        applies: whether it changes anything in a model.
        rate: number of its steps for each step of the environment, at the same control rate.
        delay: number of steps of the environment by which actions come later.
        noise: standard deviation of noise on observations, in their own unit.
    """

    name: str
    summary: str
    kind: VariantKind
    change: Callable[[mujoco.MjModel, mujoco.MjModel], None] = keep_model
    applies: Callable[[mujoco.MjModel], bool] = lambda _: True
    rate: int = 1
    delay: int = 0
    noise: float = 0.0


def load_variants() -> Mapping[str, Variant]:
    """Return the variants of the catalogue by name, in its order."""
    return own_parts("variants")["contactlab"].load()()


def find_variant(settings: Mapping[str, object]) -> Variant | None:
    """Return the variant that the settings of a run name; None if it is as written."""
    name = settings.get(VARIANT)
    return None if name is None else load_variants()[str(name)]


def write_variant(model: mujoco.MjModel, edits: Mapping[str, object]) -> None:
    """Change a model by the variant among edits, after all of them are written.

    Options and flags among the edits are those of the variant already.
    """
    own = copy.copy(model)
    load_variants()[str(edits[VARIANT])].change(model, own)
    for name in edits.keys() & {*OPTIONS}:
        write_option(model, name, edits[name])
    write_flags(model, {name: bool(edits[name]) for name in edits.keys() & {*FLAG_NAMES}})
