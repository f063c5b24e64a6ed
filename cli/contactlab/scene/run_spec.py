"""Derives everything that decides a run from its sweep values: settings, flags, effects.

Only `write_axis` decides how the value of an axis changes the settings.
"""

import copy
import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from typing import Any

from contactlab.mjcf import CONTACT, OPTIONS
from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.effects.effect import EffectRequest
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.effects.proofs import RunState
from contactlab.scene.model_edits import (
    FLAG_NAMES,
    base_settings,
    non_default_flags,
    read_flags,
)
from contactlab.scene.parameters import PARAMETERS, application_order
from contactlab.scene.variants import load_variants
from contactlab.schema.drive import Drive, drive_identity
from contactlab.schema.setting_values import Settings, as_number
from contactlab.schema.task import QPOS0
from contactlab.schema.vocabulary import VARIANT


@dataclass(frozen=True)
class RunSpec:
    """Everything besides the scene's files that decides a run's trajectory, and its plan index.

    It is resolved once, in the process of the sweep, and passed on unchanged: jobs contain it,
    workers compile it, records store it. Runs that differ only in their seed share their mappings,
    which must not be changed.
    """

    structure: Mapping[str, object]  # structure values, by name
    settings: Settings  # every engine and contact setting
    changed_settings: frozenset[str]  # names of the settings that differ from the model as written
    flags: Mapping[str, bool]  # every engine flag
    initial: Mapping[str, float]  # the scene's initial values
    seed: int  # seed of the perturbation of the initial state
    duration: float  # simulated time [s]
    effect_request: EffectRequest  # the effects that it requests
    without: frozenset[str]  # effects that its model is compiled without
    drive: Drive = "none"  # its drive, with the values of the drive's axes
    # Canonical values of the axes in its plan.
    axes: Mapping[str, object] = field(default_factory=dict[str, object])
    index: int = 0  # its place in the plan
    run_id: str = ""  # see `Scene.run_id`; empty for a run that is not planned
    controls: str | None = None  # hash of its policy's actions, for passes over recorded runs

    def __hash__(self) -> int:
        """Return a hash that differs between planned runs; equal runs have equal hashes."""
        return hash((self.run_id, self.index, self.seed))

    @property
    def engine(self) -> str:
        """Name of the engine that simulates it."""
        return str(self.settings["engine"])

    @cached_property
    def timestep(self) -> float:
        """Length of a step [s]."""
        return as_number(self.settings["timestep"])

    @property
    def keyframe(self) -> str:
        """The keyframe to start from, or `QPOS0`."""
        return str(self.settings.get("keyframe", QPOS0))

    @property
    def joint_speed(self) -> float:
        """Speed of joints at the start, added to the initial state [rad/s]."""
        return as_number(self.settings.get("joint_speed", 0.0))

    @property
    def start(self) -> tuple[Mapping[str, float], int, float]:
        """Its initial values, its seed, and the factor of the seed's perturbation."""
        return self.initial, self.seed, as_number(self.settings.get("perturbation", 1.0))

    @cached_property
    def steps(self) -> int:
        """Number of steps that cover the duration; at least one."""
        return step_count(self.duration, self.timestep)

    @property
    def values(self) -> dict[str, Any]:
        """Structure, settings and initial values in one table."""
        return {**self.structure, **self.settings, **self.initial}

    def with_seed(
        self, axes: Mapping[str, object], seed: int, run_id: str, index: int
    ) -> "RunSpec":
        """Return the run with another seed at an index of a plan."""
        run = object.__new__(RunSpec)
        # This takes a fifth of the time of `replace`, which matters for each run of a plan.
        vars(run).update(vars(self), axes=axes, seed=seed, run_id=run_id, index=index)
        return run

    def is_sibling(self, other: "RunSpec | None") -> bool:
        """Return whether it differs from another run of its plan only in seed, id and index."""
        return other is not None and self.settings is other.settings

    def list_edits(self) -> dict[str, object]:
        """Return the settings, flags and effects to write into the compiled scene's model."""
        # Model fields go last: they override settings that write the same fields.
        names = sorted(
            self.changed_settings & set(self.settings), key=lambda name: ("[" in name, name)
        )
        edits = {name: self.settings[name] for name in names}
        # Gravity is a setting, although a flag has the same name.
        flagged = sorted(self.changed_settings & set(FLAG_NAMES) - set(self.settings))
        edits |= {name: self.flags[name] for name in flagged}
        requested = self.effect_request.requested
        other = sorted(requested.keys() & self.changed_settings - set(FLAG_NAMES) - self.without)
        return edits | {name: requested[name] for name in other}


def settings_table(runs: Sequence[RunSpec]) -> dict[str, list[object]]:
    """Return the values of runs by name, run by run; NaN if a run lacks the name."""
    names = dict.fromkeys(chain.from_iterable(run.values for run in runs))
    table: dict[str, list[object]] = {name: [] for name in names}
    for run in runs:
        values = run.values
        for name, column in table.items():
            column.append(values.get(name, math.nan))
    return table


def step_count(duration: float, timestep: float) -> int:
    """Return the number of steps that cover a duration; at least one."""
    return max(1, round(duration / timestep))


def write_axes(
    settings: Settings, flags: dict[str, bool], values: Mapping[str, object]
) -> tuple[set[str], dict[str, bool]]:
    """Write the canonical values of axes of a model into settings and flags, in place.

    Return the names of the changed settings, and the requested effects.
    """
    changed = set[str]()
    requested = dict[str, bool]()
    for axis in application_order([*values]):
        if axis in EFFECTS and axis not in PARAMETERS:
            requested[axis] = bool(values[axis])
            if axis in _FLAG_NAMES:
                flags[axis] = requested[axis]
        changed.update(write_axis(settings, axis, values[axis]))
    return changed, requested


def write_axis(settings: Settings, axis: str, value: object) -> tuple[str, ...]:
    """Write an axis' canonical value into settings, in place, and return the changed names.

    The changed name is the axis itself if settings do not contain it.
    """
    if axis in PARAMETERS:
        PARAMETERS[axis].write_value(settings, value)
        return (PARAMETERS[axis].sets,)
    if axis in EFFECTS:
        switch = EFFECTS[axis].switch
        return switch.settings if switch.fold(settings, bool(value)) else (axis,)
    settings[axis] = value
    return (axis,)


def resolve_variant(base: CompiledScene, run: RunSpec, name: str) -> RunSpec:
    """Return a run with a variant: with its options and flags, its step and its contacts."""
    variant = load_variants()[name]
    own = base.prepare(run.list_edits()).model
    model = copy.copy(own)
    variant.change(model, own)
    model.opt.timestep = run.timestep / variant.rate
    subject = base.targets.subject
    before, after = (base_settings(each, base.pairs, subject) for each in (own, model))
    flags, on = read_flags(own), read_flags(model)
    differing = {key for key, value in after.items() if value != before.get(key)}
    switched = {key: on[key] for key in FLAG_NAMES if on[key] != flags[key]}
    # Contact settings of the record are those of the first pair; only the change writes them.
    updated = {key: after[key] for key in differing & {*OPTIONS, *CONTACT, "mass"}}
    return replace(
        run,
        settings=Settings({**run.settings, **updated, VARIANT: name}),
        flags={**run.flags, **switched},
        changed_settings=run.changed_settings | {VARIANT, *switched} | (differing & {*OPTIONS}),
    )


START_SETTINGS = ("keyframe", "joint_speed", "perturbation")
"""Settings that affect the initial state, besides initial values."""
_FLAG_NAMES = frozenset(FLAG_NAMES)
_encode_json = json.JSONEncoder(sort_keys=True, separators=(",", ":")).encode


def run_ids(base: CompiledScene, run: RunSpec, scene: str, seeds: Iterable[int]) -> Iterator[str]:
    """Yield the ids of a run with other seeds.

    An id is a hash of the JSON of everything that decides a run, without model fields that keep the
    value in the file. `base` is its structure with all effects; `scene` is the hash of the scene's
    files.
    """
    flags = non_default_flags(run.flags) | other_effects(base, run)
    drive = {} if run.drive == "none" else {"drive": drive_identity(run.drive)}
    head = _encode_json({**drive, "duration": run.duration, "flags": flags, "scene": scene})
    own, entries = base.settings, dict(base.id_entries)
    for name, value in run.values.items():
        if value is not own.get(name):
            entries[name] = base.id_entry(name, value)
    settings = ",".join(filter(None, map(entries.__getitem__, sorted(entries))))
    over = run.changed_settings & base.nonuniform
    written_over = _encode_json(sorted(over)) if over else "[]"
    tail = f'"settings":{{{settings}}},"written_over":{written_over}}}'
    before, after = f'{head[:-1]},"seed":'.encode(), f",{tail}".encode()
    id_digits = 16  # 64 bits: 1 of 30 million sweeps of a million runs has two equal ids
    for seed in seeds:
        text = b"%b%d%b" % (before, seed, after)
        yield hashlib.sha256(text).hexdigest()[:id_digits]


def other_effects(base: CompiledScene, run: RunSpec) -> dict[str, bool]:
    """Return the requested effects without flag or setting, if they change the run.

    An effect that is left out because it provably changes nothing is not part of a run's identity.
    """
    names = (
        run.effect_request.requested.keys()
        & run.changed_settings - _FLAG_NAMES - run.settings.keys()
    )
    if not names:
        return {}
    written_state = RunState(base.model, base.facts, straight=False)
    return {
        name: run.effect_request.requested[name]
        for name in sorted(names)
        if "condim" in run.changed_settings
        or EFFECTS[name].switch.is_on(written_state) != run.effect_request.requested[name]
    }
