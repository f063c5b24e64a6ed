"""Resolves the rows of one sweep fast: what rows share is computed once.

A setting depends only on the axes that write it, and on the row's group: its structure, requested
effects, engine and axis names. So a row costs one look-up for each axis, and each seed one hash.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import NamedTuple, cast

from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.drive.located_drive import DRIVE_AXES
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.parameters import PARAMETERS, application_order
from contactlab.scene.resolution import (
    START_SETTINGS,
    ResolvedRun,
    RunIdentity,
    id_entry,
    settings_of,
    steps_of,
    write_axis,
)
from contactlab.scene.scene import Scene
from contactlab.scene.setting_values import Settings, as_number

# Values of a setting that are cached; a sampled axis has another one in each row.
_MAX_CACHED = 1 << 9
Values = Mapping[str, object]


class Part(NamedTuple):
    """A setting or initial value of a row, and its entry in the text of a run's id."""

    value: object
    entry: str


class ResolvedRow(NamedTuple):
    """One row of a sweep, resolved but for its seed."""

    group: "RowGroup"
    parts: Sequence[Part]

    @property
    def timestep(self) -> float:
        """Length of a step [s]."""
        return as_number(self.setting("timestep"))

    @property
    def steps(self) -> int:
        """Steps that cover the duration; at least one."""
        return steps_of(self.group.first.duration, self.timestep)

    @property
    def start(self) -> tuple[object, ...]:
        """A key that rows share whose runs start alike, but for the seed."""
        return (self.group, *[self.parts[place].value for place in self.group.starting])

    def setting(self, name: str) -> object:
        """Return a setting, or None if there is none of this name."""
        place = self.group.places.get(name)
        return self.group.first.settings.get(name) if place is None else self.parts[place].value

    def run_ids(self, seeds: Sequence[int]) -> bytes:
        """Return the ids of the row's runs, `ID_BYTES` each."""
        return self.group.identity.digests([part.entry for part in self.parts], seeds)

    def resolved(self, seed: int) -> ResolvedRun:
        """Return the row's run of a seed."""
        first, settings, initial = self.group.first, Settings(self.group.first.settings), {}
        for setting, part in zip(self.group.settings, self.parts, strict=True):
            (initial if setting.initial else settings)[setting.name] = part.value
        return replace(first, settings=settings, initial={**first.initial, **initial}, seed=seed)


@dataclass(frozen=True, slots=True)
class _Setting:
    """A setting or initial value that varies among the rows of a group.

    Axes decide it, in the order in which they are applied; what it is for their values is kept.
    """

    name: str
    initial: bool
    axes: Sequence[str]
    pick: Callable[[Values], object]
    known: dict[object, Part]

    def part(self, base: CompiledScene, values: Values) -> Part:
        """Return its value in a row."""
        key = self.pick(values)
        part = self.known.get(key)
        if part is None:
            settings = Settings(base.settings)
            for axis in self.axes:
                write_axis(settings, axis, values[axis])
            part = Part(settings[self.name], id_entry(base, self.name, settings[self.name]))
            # 0.0 and -0.0 are equal keys, but different values.
            if len(self.known) < _MAX_CACHED and not _has_zero(key):
                self.known[key] = part
        return part


class RowGroup:
    """Rows that differ only in plain settings and initial values, those that axes decide.

    `first` is the first of them, resolved. What varies, `settings`, is in the order of names;
    `places` has the index of each, and `starting` those that decide the initial state.
    """

    def __init__(
        self, scene: Scene, values: Values, grouping: Sequence[str], duration: float | None
    ) -> None:
        self.first = first = scene.resolve(values, 0, duration)
        self._base = scene.base(first.structure)
        deciding: dict[str, list[str]] = {}
        for axis in application_order(values):
            for name in () if axis in DRIVE_AXES else settings_of(axis):
                deciding.setdefault(name, []).append(axis)
        varying = sorted(name for name, axes in deciding.items() if not set(axes) <= set(grouping))
        self.settings = tuple(
            _Setting(name, name in first.initial, axes, itemgetter(*axes), {})
            for name, axes in ((name, deciding[name]) for name in varying)
        )
        self.places = {name: place for place, name in enumerate(varying)}
        starting = {*first.initial, *START_SETTINGS}
        self.starting = [place for place, name in enumerate(varying) if name in starting]
        self.identity = RunIdentity(self._base, first, scene.hash, varying)

    def row(self, values: Values) -> ResolvedRow:
        """Return a row of this group, resolved."""
        return ResolvedRow(self, [each.part(self._base, values) for each in self.settings])


class RowResolver:
    """Resolves the rows of one sweep, which last a duration [s] or as long as the scene says."""

    def __init__(self, scene: Scene, duration: float | None) -> None:
        self._scene = scene
        self._duration = duration
        self._grouping: dict[tuple[str, ...], Sequence[str]] = {}
        self._groups: dict[tuple[object, ...], RowGroup] = {}

    def row(self, values: Values) -> ResolvedRow:
        """Return the row of canonical axis values, resolved."""
        if self._scene.switched:
            values = {**self._scene.switched, **values}
        names = tuple(values)
        grouping = self._grouping.get(names)
        if grouping is None:
            grouping = self._grouping[names] = [name for name in names if self._is_grouping(name)]
        duration = self._scene.lasts(values) if self._duration is None else self._duration
        key = (names, duration, *[repr(values[name]) for name in grouping])
        group = self._groups.get(key)
        if group is None:
            group = RowGroup(self._scene, values, grouping, duration)
            self._groups[key] = group
        return group.row(values)

    def _is_grouping(self, name: str) -> bool:
        """Return whether an axis writes more than a setting or an initial value."""
        manifest = self._scene.source.manifest
        own = {"engine", *self._scene.lacking, *(manifest.structure if manifest else ())}
        return name not in PARAMETERS and (name in EFFECTS or name in DRIVE_AXES or name in own)


def _has_zero(value: object) -> bool:
    if isinstance(value, tuple):
        return any(_has_zero(part) for part in cast("tuple[object, ...]", value))
    return value == 0
