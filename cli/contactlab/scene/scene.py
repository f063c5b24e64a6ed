"""A scene ready for its runs: from a run's values to settings, model and start state."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from contactlab.scene.base import Base, compile_base
from contactlab.scene.catalogue import SceneCatalogue
from contactlab.scene.fields import is_as_written
from contactlab.scene.flags import FLAGS, unusual
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.source import SceneSource, find_scene
from contactlab.scene.start import Starts, StartState, nudged_states, start_states
from contactlab.schema import InitialValue

_RANK = {name: rank for rank, name in enumerate(PARAMETERS)}


@dataclass(frozen=True, slots=True)
class Resolved:
    """Everything that decides one run's trajectory, but for the scene's own files.

    Attributes:
        structure: structure values, by name.
        settings: every engine and contact setting.
        changed: names of the settings that differ from the model as written.
        flags: every engine switch.
        initial: the scene's initial values.
        seed: what perturbs the start state.
        duration: simulated time [s].
    """

    structure: Mapping[str, object]
    settings: Mapping[str, object]
    changed: frozenset[str]
    flags: Mapping[str, bool]
    initial: Mapping[str, float]
    seed: int
    duration: float

    @property
    def timestep(self) -> float:
        """Length of a step [s]."""
        return float(str(self.settings["timestep"]))

    @property
    def steps(self) -> int:
        """Steps that cover the duration; at least one."""
        return max(1, round(self.duration / self.timestep))

    @property
    def values(self) -> dict[str, Any]:
        """Structure, settings and initial values in one table."""
        return {**self.structure, **self.settings, **self.initial}

    def edits(self) -> dict[str, object]:
        """Return the settings and switches to write into the base model."""
        # Model fields go last: they are more particular than the settings that write them too.
        names = sorted(self.changed & set(self.settings), key=lambda name: ("[" in name, name))
        edits = {name: self.settings[name] for name in names}
        # Gravity is a setting, though there is a switch of that name too.
        switched = sorted(self.changed & set(self.flags) - set(self.settings))
        return edits | {name: self.flags[name] for name in switched}


class Scene:
    """A scene and the structures of it that were compiled so far."""

    def __init__(self, source: SceneSource) -> None:
        self.source = source
        self._bases: dict[str, Base] = {}
        self._starts: dict[str, StartState] = {}
        base = self.base({})
        with source.blamed():
            self.catalogue = SceneCatalogue(base, source.manifest)
        self.starts([self.resolve({}, 0, None)])

    @classmethod
    def open(cls, reference: str, folder: Path | None = None) -> "Scene":
        """Find and compile the scene that a sweep names; `folder` is where paths start.

        Raises:
            SceneError: there is no such scene, or it does not compile.
        """
        return cls(find_scene(reference, folder))

    @property
    def name(self) -> str:
        """The scene's name."""
        return self.source.name

    @property
    def hash(self) -> str:
        """Hash of the scene's files."""
        return self.source.content.hash

    def base(self, structure: Mapping[str, object]) -> Base:
        """Return the compiled base of the given structure values, over the scene's defaults."""
        full = self._structure(structure)
        key = json.dumps(full, sort_keys=True)
        if key not in self._bases:
            self._bases[key] = compile_base(self.source, full)
        return self._bases[key]

    def resolve(self, values: Mapping[str, object], seed: int, duration: float | None) -> Resolved:
        """Return everything that decides a run, from the values its sweep gives it.

        Args:
            values: canonical axis values by name.
            seed: the run's seed.
            duration: simulated time [s]; the scene's own if None.
        """
        structure = self._structure(values)
        base = self.base(structure)
        settings, flags = dict(base.settings), dict(base.flags)
        changed: set[str] = set()
        for name in sorted(values, key=lambda name: _RANK.get(name, len(_RANK))):
            if name in PARAMETERS:
                PARAMETERS[name].update(settings, values[name])
                changed.add(PARAMETERS[name].sets)
            elif name in FLAGS:
                flags[name] = bool(values[name])
                changed.add(name)
            elif name not in structure and name not in self._initial():
                settings[name] = values[name]
                changed.add(name)
        initial = {
            name: float(str(values.get(name, entry.default)))
            for name, entry in self._initial().items()
        }
        return Resolved(
            structure=structure,
            settings=settings,
            changed=frozenset(changed),
            flags=flags,
            initial=initial,
            seed=seed,
            duration=self.duration if duration is None else duration,
        )

    @property
    def duration(self) -> float:
        """The scene's own duration [s]; 2 s for a bare model."""
        return self.source.manifest.duration if self.source.manifest else 2.0

    def run_id(self, run: Resolved) -> str:
        """Return a hash of scene content, settings, seed and duration, but not of the engine.

        Runs that are resolved to the same model and start have the same one.
        """
        base = self.base(run.structure)
        identity = {
            "scene": self.hash,
            "settings": {
                name: _rounded(value)
                for name, value in run.values.items()
                if name in base.settings or not is_as_written(base.model, name, value)
            },
            "written_over": sorted(run.changed & base.varied),
            "flags": unusual(run.flags),
            "seed": run.seed,
            "duration": run.duration,
        }
        text = json.dumps(identity, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def starts(self, runs: Sequence[Resolved]) -> Starts:
        """Return the start states of runs of one structure."""
        start = self._start(runs[0].structure)
        with self.source.blamed():
            return start_states(start, [(run.initial, run.seed) for run in runs])

    def nudged(self, starts: Starts, runs: Sequence[Resolved]) -> Starts:
        """Return starts with every place moved by up to 1e-6 m or rad, as each run's seed says."""
        start = self._start(runs[0].structure)
        return nudged_states(start, starts, [run.seed for run in runs])

    def _start(self, structure: Mapping[str, object]) -> StartState:
        key = json.dumps(structure, sort_keys=True)
        if key not in self._starts:
            model = self.base(structure).model
            with self.source.blamed():
                self._starts[key] = StartState.of(model, self.source.manifest)
        return self._starts[key]

    def _structure(self, values: Mapping[str, object]) -> dict[str, object]:
        manifest = self.source.manifest
        entries = manifest.structure if manifest else {}
        full: dict[str, object] = {}
        for name, entry in entries.items():
            value = float(str(values.get(name, entry.default)))
            full[name] = int(value) if entry.integer else value
        return full

    def _initial(self) -> Mapping[str, InitialValue]:
        return self.source.manifest.initial if self.source.manifest else {}


def _rounded(value: object) -> object:
    """Drop the digits in which machines may differ when they compute one value."""
    if isinstance(value, tuple):
        return [_rounded(part) for part in value]
    return float(f"{value:.12g}") if isinstance(value, float) else value
