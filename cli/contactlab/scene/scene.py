"""A scene ready for its runs: from a run's values to settings, model and start state."""

import copy
import json
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path

from contactlab.scene.axis_catalogue import SceneCatalogue
from contactlab.scene.compiled_scene import CompiledScene, PreparedModel, compile_scene
from contactlab.scene.effects import EFFECTS, EffectRequest, is_straight, left_uncompiled
from contactlab.scene.initial_states import (
    InitialStateRule,
    InitialStates,
    initial_states,
    nudged_states,
)
from contactlab.scene.mujoco_versions import missing_flags
from contactlab.scene.parameters import PARAMETERS, application_order
from contactlab.scene.resolved import ResolvedRun
from contactlab.scene.row_resolution import RowResolver
from contactlab.scene.run_identity import digest, entries_of, head_of, tail_of, written_over_of
from contactlab.scene.scene_source import SceneSource, find_scene
from contactlab.scene.settings import ENGINES
from contactlab.scene.switching import is_auto, own_switches, switch_effect
from contactlab.schema import InitialValue


class Scene:
    """A scene and the structures of it that were compiled so far."""

    def __init__(self, source: SceneSource) -> None:
        self.source = source
        self.auto = is_auto(source.manifest)
        self._bases: dict[tuple[str, frozenset[str]], CompiledScene] = {}
        self._starts: dict[str, InitialStateRule] = {}
        base = self.base({})
        self._lacking = missing_flags()
        with source.named_in_errors():
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

    def base(
        self, structure: Mapping[str, object], without: frozenset[str] = frozenset()
    ) -> CompiledScene:
        """Return the compiled base of the given structure values, over the scene's defaults.

        Args:
            structure: structure values.
            without: effects that it is compiled without.
        """
        full = self._structure(structure)
        key = json.dumps(full, sort_keys=True), without
        if key not in self._bases:
            self._bases[key] = compile_scene(self.source, full, without)
        return self._bases[key]

    def base_of(self, run: ResolvedRun) -> CompiledScene:
        """Return the compiled base that a run's model is made from."""
        return self.base(run.structure, run.without)

    def prepare(self, run: ResolvedRun, start: InitialStates) -> PreparedModel:
        """Return a run's model, without the effects that it does not call for.

        Args:
            run: the run.
            start: its start state, n being 1.
        """
        base = self.base_of(run)
        return base.prepare(
            run.edits(), run.effect_request, straight=is_straight(base.model, start)
        )

    def model_key(self, run: ResolvedRun, start: InitialStates) -> str:
        """Return what two runs have in common if their models are the same."""
        straight = is_straight(self.base_of(run).model, start)
        return json.dumps([run.structure, sorted(run.without), run.edits(), straight])

    def resolve(
        self, values: Mapping[str, object], seed: int, duration: float | None
    ) -> ResolvedRun:
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
        for name in application_order(values):
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
        effect_request = EffectRequest(asked, frozenset(changed), auto)
        return ResolvedRun(
            structure=structure,
            settings=settings,
            changed=frozenset(changed),
            flags=flags,
            initial=initial,
            seed=seed,
            duration=self.duration if duration is None else duration,
            effect_request=effect_request,
            without=left_uncompiled(base.facts, effect_request),
        )

    @property
    def duration(self) -> float:
        """The scene's own duration [s]; 2 s for a bare model."""
        return self.source.manifest.duration if self.source.manifest else 2.0

    def run_id(self, run: ResolvedRun) -> str:
        """Return a hash of scene content, settings, seed and duration, but not of the engine.

        Runs that are resolved to the same model and start have the same one.
        """
        base = self.base(run.structure)
        tail = tail_of(entries_of(base, run.values).values(), written_over_of(base, run))
        return digest(head_of(base, run, self.hash), run.seed, tail).hex()

    def rows(self, duration: float | None) -> RowResolver:
        """Return what resolves the rows of a sweep faster than one by one.

        Args:
            duration: simulated time of each run [s]; the scene's own if None.
        """
        return RowResolver(self, self._switches, duration)

    def is_plain(self, name: str) -> bool:
        """Say whether an axis writes a setting or initial value, and no structure."""
        manifest = self.source.manifest
        return name not in self._lacking and not (manifest and name in manifest.structure)

    def starts(self, runs: Sequence[ResolvedRun]) -> InitialStates:
        """Return the start states of runs of one structure."""
        groups = [list(group) for _, group in groupby(runs, lambda run: run.keyframe)]
        with self.source.named_in_errors():
            return InitialStates.joined(
                [
                    initial_states(
                        self._start(group[0]), [(run.initial, run.seed) for run in group]
                    )
                    for group in groups
                ]
            )

    @property
    def is_timed(self) -> bool:
        """Whether anything in a run depends on time: control, or a hold."""
        manifest = self.source.manifest
        return manifest is not None and bool(manifest.control or manifest.hold)

    def check(self, run: ResolvedRun) -> None:
        """Compute what depends on time in a run, so that mistakes show before anything runs.

        Raises:
            SceneError: times of its control decrease, or its hold is no stretch of time.
        """
        if not self.is_timed:
            return
        self.starts([run])
        holding = self.base(run.structure).holding
        with self.source.named_in_errors():
            if holding is not None:
                holding.window(run.initial)

    def nudged(self, starts: InitialStates, runs: Sequence[ResolvedRun]) -> InitialStates:
        """Return starts with every place moved by up to 1e-6 m or rad, as each run's seed says."""
        start = self._start(runs[0])
        return nudged_states(start, starts, [run.seed for run in runs])

    def _start(self, run: ResolvedRun) -> InitialStateRule:
        key = json.dumps([run.structure, run.keyframe], sort_keys=True)
        if key not in self._starts:
            model, manifest = self.base(run.structure).model, self.source.manifest
            with self.source.named_in_errors():
                self._starts[key] = InitialStateRule.of(model, manifest, run.keyframe)
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
