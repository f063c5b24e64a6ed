"""From the values that a sweep gives a run to everything that decides it: settings, flags, effects.

`write_axis` alone decides what the value of an axis does to the settings.
"""

import hashlib
import json
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, cast

from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.effects.effect import EffectRequest
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.effects.proofs import RunState
from contactlab.scene.initial_states import QPOS0, keyframe_names
from contactlab.scene.model_edits import FLAGS, is_as_written, non_default
from contactlab.scene.model_names import is_address
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.setting_values import Settings, as_number
from contactlab.schema.drive import Drive, drive_identity


@dataclass(frozen=True, slots=True)
class ResolvedRun:
    """Everything besides the scene's files that decides a run's trajectory."""

    structure: Mapping[str, object]  # structure values, by name
    settings: Settings  # every engine and contact setting
    changed: frozenset[str]  # names of the settings that differ from the model as written
    flags: Mapping[str, bool]  # every engine flag
    initial: Mapping[str, float]  # the scene's initial values
    seed: int  # what perturbs the initial state
    duration: float  # simulated time [s]
    effect_request: EffectRequest  # the effects that it requests
    without: frozenset[str]  # effects that its model is compiled without
    drive: Drive = "none"  # what drives it, with the values of its axes

    @property
    def engine(self) -> str:
        """Name of the engine that simulates it."""
        return str(self.settings["engine"])

    @property
    def timestep(self) -> float:
        """Length of a step [s]."""
        return as_number(self.settings["timestep"])

    @property
    def keyframe(self) -> str:
        """The keyframe to start from, or `QPOS0`."""
        return str(self.settings.get("keyframe", QPOS0))

    @property
    def joint_speed(self) -> float:
        """How fast joints turn at the start, on top of the initial state [rad/s]."""
        return as_number(self.settings.get("joint_speed", 0.0))

    @property
    def start(self) -> tuple[Mapping[str, float], int, float]:
        """Its initial values, its seed, and the factor of the seed's perturbation."""
        return self.initial, self.seed, as_number(self.settings.get("perturbation", 1.0))

    @property
    def steps(self) -> int:
        """Steps that cover the duration; at least one."""
        return steps_of(self.duration, self.timestep)

    @property
    def values(self) -> dict[str, Any]:
        """Structure, settings and initial values in one table."""
        return {**self.structure, **self.settings, **self.initial}

    def seeded(self, seed: int) -> "ResolvedRun":
        """Return the same run of another seed."""
        before = self.structure, self.settings, self.changed, self.flags, self.initial
        # Three times as fast as `replace`.
        after = self.duration, self.effect_request, self.without, self.drive
        return ResolvedRun(*before, seed, *after)

    def edits(self) -> dict[str, object]:
        """Return the settings, flags and effects to write into the compiled scene's model."""
        # Model fields go last: they are more particular than the settings that write them too.
        names = sorted(self.changed & set(self.settings), key=lambda name: ("[" in name, name))
        edits = {name: self.settings[name] for name in names}
        # Gravity is a setting, though there is a flag of that name too.
        flagged = sorted(self.changed & set(FLAGS) - set(self.settings))
        edits |= {name: self.flags[name] for name in flagged}
        requested = self.effect_request.requested
        other = sorted(requested.keys() & self.changed - set(FLAGS) - self.without)
        return edits | {name: requested[name] for name in other}


def steps_of(duration: float, timestep: float) -> int:
    """Return how many steps cover a duration; at least one."""
    return max(1, round(duration / timestep))


def settings_of(axis: str) -> tuple[str, ...]:
    """Return the settings that an axis may write."""
    if axis in PARAMETERS:
        return (PARAMETERS[axis].sets,)
    return EFFECTS[axis].switch.settings if axis in EFFECTS else (axis,)


def write_axis(settings: Settings, axis: str, value: object) -> bool:
    """Write an axis' canonical value into settings, in place; return whether they carry it."""
    if axis in PARAMETERS:
        PARAMETERS[axis].write(settings, value)
    elif axis in EFFECTS:
        return EFFECTS[axis].switch.fold(settings, bool(value))
    else:
        settings[axis] = value
    return True


START_SETTINGS = ("keyframe", "joint_speed", "perturbation")
"""Settings that decide the initial state, besides initial values."""
ID_BYTES = 8


class RunIdentity:
    """What the ids of runs share that differ only in some settings and in their seeds.

    Args:
        base: their structure, with all effects.
        run: one of them.
        scene: hash of the scene's files.
        varying: settings and initial values in which they differ.
    """

    def __init__(
        self, base: CompiledScene, run: ResolvedRun, scene: str, varying: Collection[str] = ()
    ) -> None:
        flags = non_default(run.flags) | other_effects(base, run)
        drive = {} if run.drive == "none" else {"drive": drive_identity(run.drive)}
        first = _json({**drive, "duration": run.duration, "flags": flags, "scene": scene})
        self._head = f'{first[:-1]},"seed":'
        self._written_over = _json(sorted(run.changed & base.nonuniform))
        # Entries in the order of their names; every second piece is left empty for one that varies.
        self._pieces = [""]
        values = run.values
        for name in sorted(values):
            if name in varying:
                self._pieces += ["", ""]
            else:
                self._pieces[-1] += id_entry(base, name, values[name])

    def digests(self, entries: Sequence[str], seeds: Iterable[int]) -> bytes:
        """Return the ids of runs of some seeds, `ID_BYTES` each.

        Entries are those of what varies, from `id_entry`, in the order of their names.
        """
        pieces = self._pieces.copy()
        pieces[1::2] = entries
        settings = "".join(pieces)[1:]
        tail = f',"settings":{{{settings}}},"written_over":{self._written_over}}}'
        texts = (f"{self._head}{seed}{tail}".encode() for seed in seeds)
        return b"".join([hashlib.sha256(text).digest()[:ID_BYTES] for text in texts])


def id_entry(base: CompiledScene, name: str, value: object) -> str:
    """Return the entry of one setting, after a comma; empty if it equals the model as written."""
    if name not in base.settings and is_as_written(base.model, name, value):
        return ""
    # Where no keyframe has a name, ids are those of versions that knew none of them.
    if name == "keyframe" and value == QPOS0 and all(map(is_address, keyframe_names(base.model))):
        return ""
    return f",{_name(name)}:{_value(value)}"


@cache
def _name(name: str) -> str:
    return json.dumps(name)


def _value(value: object) -> str:
    """Return a value as JSON, rounded to 12 digits, since machines may differ in the last ones."""
    if isinstance(value, tuple):
        return f"[{','.join([_value(part) for part in cast('tuple[object, ...]', value)])}]"
    if isinstance(value, float):
        value = float(f"{value:.12g}")
        # The same text as the encoder's, ten times as fast.
        return repr(value) if math.isfinite(value) else _json(value)
    return _json(value)


def _json(value: object) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def other_effects(base: CompiledScene, run: ResolvedRun) -> dict[str, bool]:
    """Return the requested effects that no flag or setting carries, where they change the run.

    What is left out because it provably changes nothing is not part of a run's identity.
    """
    written = RunState(base.model, base.facts, straight=False)
    names = run.effect_request.requested.keys() & run.changed - set(FLAGS) - run.settings.keys()
    return {
        name: run.effect_request.requested[name]
        for name in sorted(names)
        if "condim" in run.changed
        or EFFECTS[name].switch.is_on(written) != run.effect_request.requested[name]
    }
