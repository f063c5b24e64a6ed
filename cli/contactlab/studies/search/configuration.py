"""A configuration under test: changes of the model as written."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import mujoco

from contactlab.judge.wording import plural
from contactlab.modifications.modification import ReductionName
from contactlab.scene.model_edits import (
    FIELD_KINDS,
    FLAG_NAMES,
    EditTargets,
    is_as_written,
    read_flag,
    read_option,
    write_settings,
)
from contactlab.store.table_layout import axis_cell

Reductions = frozenset[ReductionName]
"""Parts that a configuration leaves out. Sensors go with the unused parts: no state depends on
them."""
AS_WRITTEN: Reductions = frozenset()
Key = tuple[object, ...]
"""Identifies a configuration."""
_NO_TARGETS = EditTargets((), (), None)
INTEGRATOR = "integrator"
UNUSED_FLAGS = int(mujoco.mjtEnableBit.mjENBL_ENERGY) | int(mujoco.mjtEnableBit.mjENBL_FWDINV)
"""Flags that no state depends on; studies record without them."""


@dataclass(frozen=True)
class Configuration:
    """Changes of the model as written.

    Attributes:
        settings: values by axis, as in a sweep, without the timestep.
        multiple: timestep in fine steps of the search.
        reductions: parts that it removes.
    """

    settings: Mapping[str, object] = field(default_factory=dict[str, object])
    multiple: int = 1
    reductions: Reductions = AS_WRITTEN

    @property
    def key(self) -> Key:
        """Identifies the configuration."""
        own = sorted((name, str(value)) for name, value in self.settings.items())
        return (self.multiple, self.reductions, *own)

    def with_settings(self, settings: Mapping[str, object]) -> "Configuration":
        """Return the configuration with more settings, which replace its own."""
        return replace(self, settings={**self.settings, **settings})

    def with_step(self, multiple: int) -> "Configuration":
        """Return the configuration with another timestep."""
        return replace(self, multiple=multiple)

    def with_reductions(self, reductions: Reductions) -> "Configuration":
        """Return the configuration with other reductions."""
        return replace(self, reductions=reductions)

    def apply_to(self, model: mujoco.MjModel) -> mujoco.MjModel:
        """Return a changed copy of a model, at the timestep of the model."""
        changed_copy = copy.copy(model)
        unread = int(model.opt.enableflags) & UNUSED_FLAGS
        write_settings(changed_copy, dict(self.settings), _NO_TARGETS)
        changed_copy.opt.enableflags |= unread
        return changed_copy


def changed_settings(settings: Mapping[str, object], model: mujoco.MjModel) -> dict[str, object]:
    """Return the settings that differ from those of a model."""
    return {name: value for name, value in settings.items() if not _is_set(model, name, value)}


def _is_set(model: mujoco.MjModel, name: str, value: object) -> bool:
    if name in FLAG_NAMES:
        return read_flag(model, name) == value
    if "[" in name:
        return is_as_written(model, name, value)
    return read_option(Configuration({name: value}).apply_to(model), name) == read_option(
        model, name
    )


def format_settings(settings: Mapping[str, object]) -> str:
    """Return settings in one line."""
    return ", ".join(list_settings(settings))


def list_settings(settings: Mapping[str, object]) -> list[str]:
    """Return settings as phrases; settings of many parts are counted, flags are on or off."""
    single = {name: axis_cell(value) for name, value in settings.items() if "[" not in name}
    words = {True: "on", False: "off"}
    parts = [
        f"{name} {words[value] if isinstance(value, bool) else value}"
        for name, value in single.items()
    ]
    fields: dict[tuple[str, str], int] = {}
    for name, value in settings.items():
        if "[" in name:
            key = name.partition("[")[0], str(axis_cell(value))
            fields[key] = fields.get(key, 0) + 1
    for (name, value), count in fields.items():
        kind = FIELD_KINDS[name.partition("_")[0]]
        parts.append(f"{name} {value} of {plural(count, kind)}")
    return parts
