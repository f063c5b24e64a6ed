"""A choice of settings: what is tried, as changes of the model as written."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import mujoco

from contactlab.scene.model_edits import (
    FLAGS,
    EditTargets,
    is_as_written,
    read_flag,
    read_option,
    write_settings,
)
from contactlab.store.table_layout import as_written

Cut = Literal["unused", "apart", "hulls"]
"""What a model may be without: what changes no state; collisions of what merely stayed apart; the
vertices of hulls that shorter ones leave out."""
Cuts = frozenset[Cut]
AS_WRITTEN: Cuts = frozenset()
Key = tuple[object, ...]
"""What tells a choice from others."""
_NOTHING = EditTargets((), (), None)
INTEGRATOR = "integrator"
UNREAD = int(mujoco.mjtEnableBit.mjENBL_ENERGY) | int(mujoco.mjtEnableBit.mjENBL_FWDINV)
"""Flags that compute what no state depends on; a study records without them."""


@dataclass(frozen=True)
class Choice:
    """Settings beside those of the model as written.

    Attributes:
        settings: values by axis, as a sweep has them; the timestep is not among them.
        multiple: its step, in fine steps of the search.
        cuts: what it is without.
    """

    settings: Mapping[str, object] = field(default_factory=dict[str, object])
    multiple: int = 1
    cuts: Cuts = AS_WRITTEN

    @property
    def key(self) -> Key:
        """What tells it from others."""
        own = sorted((name, str(value)) for name, value in self.settings.items())
        return (self.multiple, self.cuts, *own)

    def with_settings(self, settings: Mapping[str, object]) -> "Choice":
        """Return it with more settings, which replace its own."""
        return replace(self, settings={**self.settings, **settings})

    def undone(self, settings: Mapping[str, object], before: "Choice") -> "Choice":
        """Return it with the settings that another choice has in the place of some."""
        kept = {name: value for name, value in self.settings.items() if name not in settings}
        own = {name: before.settings[name] for name in settings if name in before.settings}
        return replace(self, settings={**kept, **own})

    def at(self, multiple: int) -> "Choice":
        """Return it with another step."""
        return replace(self, multiple=multiple)

    def without(self, cuts: Cuts) -> "Choice":
        """Return it without something else."""
        return replace(self, cuts=cuts)

    def made(self, model: mujoco.MjModel) -> mujoco.MjModel:
        """Return a changed copy of a model, whose step is its own."""
        made = copy.copy(model)
        unread = int(model.opt.enableflags) & UNREAD
        write_settings(made, dict(self.settings), _NOTHING)
        made.opt.enableflags |= unread
        return made


def differing(settings: Mapping[str, object], model: mujoco.MjModel) -> dict[str, object]:
    """Return settings without those that a model has already."""
    return {name: value for name, value in settings.items() if not _has(model, name, value)}


def _has(model: mujoco.MjModel, name: str, value: object) -> bool:
    if name in FLAGS:
        return read_flag(model, name) == value
    if "[" in name:
        return is_as_written(model, name, value)
    return read_option(Choice({name: value}).made(model), name) == read_option(model, name)


def described(settings: Mapping[str, object]) -> str:
    """Return settings in a line; fields of many parts are counted, effects are on or off."""
    single = {name: as_written(value) for name, value in settings.items() if "[" not in name}
    words = {True: "on", False: "off"}
    parts = [
        f"{name} {words[value] if isinstance(value, bool) else value}"
        for name, value in single.items()
    ]
    fields: dict[tuple[str, str], int] = {}
    for name, value in settings.items():
        if "[" in name:
            key = name.partition("[")[0], str(as_written(value))
            fields[key] = fields.get(key, 0) + 1
    parts += [f"{name} {value} of {count}" for (name, value), count in fields.items()]
    return ", ".join(parts)
