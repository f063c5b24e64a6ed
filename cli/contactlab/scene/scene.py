"""A scene ready for its runs: from a run's values to settings, model and start state."""

import copy
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from contactlab.scene.base import Base, Prepared, compile_base
from contactlab.scene.capabilities import lacking_switches
from contactlab.scene.catalogue import SceneCatalogue
from contactlab.scene.effects import EFFECTS, Situation, Wishes, is_straight, left_uncompiled
from contactlab.scene.fields import is_as_written
from contactlab.scene.flags import FLAGS, unusual
from contactlab.scene.keyframes import OWN_START
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.settings import ENGINES
from contactlab.scene.source import SceneSource, find_scene
from contactlab.scene.start import StartState, nudged_states, start_states
from contactlab.scene.starts import Starts
from contactlab.scene.switching import is_auto, own_switches, switch_effect
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
        wishes: what is asked of its effects.
        without: effects that its model is compiled without.
    """

    structure: Mapping[str, object]
    settings: Mapping[str, object]
    changed: frozenset[str]
    flags: Mapping[str, bool]
    initial: Mapping[str, float]
    seed: int
    duration: float
    wishes: Wishes
    without: frozenset[str]

    @property
    def timestep(self) -> float:
        """Length of a step [s]."""
        return float(str(self.settings["timestep"]))

    @property
    def keyframe(self) -> str:
        """The keyframe to start from, or `OWN_START`."""
        return str(self.settings.get("keyframe", OWN_START))

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
        switched = sorted(self.changed & set(FLAGS) - set(self.settings))
        edits |= {name: self.flags[name] for name in switched}
        return edits | {name: self.wishes.asked[name] for name in self._written()}

    def _written(self) -> list[str]:
        """Return the effects asked for that are neither switches nor settings."""
        asked = self.wishes.asked.keys() - set(FLAGS) - self.without
        return sorted(name for name in asked if EFFECTS[name].turn and name in self.changed)


class Scene:
    """A scene and the structures of it that were compiled so far."""

    def __init__(self, source: SceneSource) -> None:
        self.source = source
        self.auto = is_auto(source.manifest)
        self._bases: dict[tuple[str, frozenset[str]], Base] = {}
        self._starts: dict[str, StartState] = {}
        base = self.base({})
        self._lacking = lacking_switches()
        with source.blamed():
            self.catalogue = SceneCatalogue(base, source.manifest)
            self._switches = own_switches(source.manifest, self.catalogue)
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

    def with_effects(self, rest: str | None) -> "Scene":
        """Return the scene with another rule for effects that nobody asks for by name.

        Args:
            rest: `auto` leaves out what provably changes nothing, `all` nothing; None for the
                scene's own rule.
        """
        if rest is None or (rest == "auto") == self.auto:
            return self
        scene = copy.copy(self)
        scene.auto = rest == "auto"
        return scene

    def base(self, structure: Mapping[str, object], without: frozenset[str] = frozenset()) -> Base:
        """Return the compiled base of the given structure values, over the scene's defaults.

        Args:
            structure: structure values.
            without: effects that it is compiled without.
        """
        full = self._structure(structure)
        key = json.dumps(full, sort_keys=True), without
        if key not in self._bases:
            self._bases[key] = compile_base(self.source, full, without)
        return self._bases[key]

    def base_of(self, run: Resolved) -> Base:
        """Return the compiled base that a run's model is made from."""
        return self.base(run.structure, run.without)

    def prepare(self, run: Resolved, start: Starts) -> Prepared:
        """Return a run's model, without the effects that it does not call for.

        Args:
            run: the run.
            start: its start state, n being 1.
        """
        base = self.base_of(run)
        return base.prepare(run.edits(), run.wishes, straight=is_straight(base.model, start))

    def model_key(self, run: Resolved, start: Starts) -> str:
        """Return what two runs have in common if their models are the same."""
        straight = is_straight(self.base_of(run).model, start)
        return json.dumps([run.structure, sorted(run.without), run.edits(), straight])

    def resolve(self, values: Mapping[str, object], seed: int, duration: float | None) -> Resolved:
        """Return everything that decides a run, from the values its sweep gives it.

        Args:
            values: canonical axis values by name.
            seed: the run's seed.
            duration: simulated time [s]; the scene's own if None.
        """
        # What an engine has no switch for it does as it is by default; it was asked for no other.
        values = _without({**self._switches, **values}, self._lacking)
        structure = self._structure(values)
        base = self.base(structure)
        settings, flags = dict(base.settings), dict(base.flags)
        changed: set[str] = set()
        asked: dict[str, bool] = {}
        for name in sorted(values, key=lambda name: _RANK.get(name, len(_RANK))):
            if name in PARAMETERS:
                PARAMETERS[name].update(settings, values[name])
                changed.add(PARAMETERS[name].sets)
            elif name in EFFECTS:
                asked[name] = bool(values[name])
                changed |= switch_effect(name, asked[name], settings, flags)
            elif name not in structure and name not in self._initial():
                settings[name] = values[name]
                changed.add(name)
        initial = {
            name: float(str(values.get(name, entry.default)))
            for name, entry in self._initial().items()
        }
        auto = self.auto and settings["engine"] == ENGINES[0]
        wishes = Wishes(asked, frozenset(changed), auto)
        return Resolved(
            structure=structure,
            settings=settings,
            changed=frozenset(changed),
            flags=flags,
            initial=initial,
            seed=seed,
            duration=self.duration if duration is None else duration,
            wishes=wishes,
            without=left_uncompiled(base.facts, wishes),
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
            "flags": unusual(run.flags) | _others(base, run),
            "seed": run.seed,
            "duration": run.duration,
        }
        text = json.dumps(identity, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def starts(self, runs: Sequence[Resolved]) -> Starts:
        """Return the start states of runs of one structure."""
        groups = [list(group) for _, group in groupby(runs, lambda run: run.keyframe)]
        with self.source.blamed():
            return Starts.joined(
                [
                    start_states(self._start(group[0]), [(run.initial, run.seed) for run in group])
                    for group in groups
                ]
            )

    def check(self, run: Resolved) -> None:
        """Compute what depends on time in a run, so that mistakes show before anything runs.

        Raises:
            SceneError: times of its control decrease, or its hold is no stretch of time.
        """
        manifest = self.source.manifest
        if manifest is None or not (manifest.control or manifest.hold):
            return
        self.starts([run])
        holding = self.base(run.structure).holding
        with self.source.blamed():
            if holding is not None:
                holding.window(run.initial)

    def nudged(self, starts: Starts, runs: Sequence[Resolved]) -> Starts:
        """Return starts with every place moved by up to 1e-6 m or rad, as each run's seed says."""
        start = self._start(runs[0])
        return nudged_states(start, starts, [run.seed for run in runs])

    def _start(self, run: Resolved) -> StartState:
        key = json.dumps([run.structure, run.keyframe], sort_keys=True)
        if key not in self._starts:
            model, manifest = self.base(run.structure).model, self.source.manifest
            with self.source.blamed():
                self._starts[key] = StartState.of(model, manifest, run.keyframe)
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


def _without(values: Mapping[str, object], names: frozenset[str]) -> dict[str, object]:
    return {name: value for name, value in values.items() if name not in names}


def _others(base: Base, run: Resolved) -> dict[str, bool]:
    """Return the effects asked for that no switch or setting holds, if that changes anything.

    What is left out because it provably changes nothing is no part of what a run is.
    """
    written = Situation(base.model, base.facts, straight=False)
    names = run.wishes.asked.keys() & run.changed - set(FLAGS) - run.settings.keys()
    return {
        name: run.wishes.asked[name]
        for name in sorted(names)
        if "condim" in run.changed or EFFECTS[name].is_on(written) != run.wishes.asked[name]
    }


def _rounded(value: object) -> object:
    """Drop the digits in which machines may differ when they compute one value."""
    if isinstance(value, tuple):
        return [_rounded(part) for part in value]
    return float(f"{value:.12g}") if isinstance(value, float) else value
