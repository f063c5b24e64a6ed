"""What a page that simulates holds of each run: start, inputs, settings, stored end, sliders."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats, RecordedControls
from contactlab.engines import find_engine
from contactlab.engines.engine import Buffers, PreparedRuns
from contactlab.engines.rollout_trace import trajectory_hash
from contactlab.errors import ContactlabError
from contactlab.live.browser_models import BrowserModel
from contactlab.live.budget_switches import rows_of, switched
from contactlab.live.sliders import offered_values, value_text
from contactlab.mjcf import MODEL_ENGINE
from contactlab.run.planned_runs import stored_sweep_scene
from contactlab.run.stored_runs import canonical_values, resolve_record, stored_start
from contactlab.scene.initial_states import PARTS, InitialStates
from contactlab.scene.model_edits import LOOP_ENGINE
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.examination import Examination
from contactlab.store.finished_store import Store

_GHOST_RATE = 60.0  # stored poses per simulated second


@dataclass(frozen=True)
class Variant:
    """A run as it is, or with another value of one axis, which `text` says."""

    base: int  # place of its structure among the models
    model: mujoco.MjModel
    start: InitialStates  # n = 1
    steps: int
    text: str = ""

    @property
    def parts(self) -> dict[str, Floats]:
        """The numbers of its start by part, flat."""
        return {name: np.ravel(getattr(self.start, name)) for name in PARTS}


@dataclass(frozen=True)
class Slider:
    """An axis whose value can be changed, and the place of the run's own value."""

    name: str
    unit: str
    own: int
    stops: tuple[Variant, ...]


@dataclass(frozen=True)
class Switch:
    """A change of a run that is made or not: of what kind, what it is, and what is known of it."""

    kind: str
    name: str
    summary: str
    told: str
    variant: Variant


@dataclass(frozen=True)
class StoredMotion:
    """What is stored of a run's motion, or came out of it again here, bit for bit."""

    times: Floats  # (T,) [s]
    qpos: Floats  # (T, nq) there
    end: tuple[Floats, Floats]  # qpos and qvel after the last step


@dataclass(frozen=True)
class LiveRun:
    """One run: all that a browser simulates it from, or `why` none can."""

    record: EvidenceRecord
    variant: Variant | None
    motion: StoredMotion | None = None
    sliders: tuple[Slider, ...] = ()
    switches: tuple[Switch, ...] = ()
    notes: tuple[str, ...] = ()
    why: str = ""


@dataclass
class LiveRuns:
    """Runs of a store, prepared for a page; each of their structures is compiled once.

    Of a model that was examined, the rows of its budget and the changes that mend it are switches.
    """

    store: Store
    examination: Examination | None = None
    models: list[BrowserModel] = field(default_factory=list[BrowserModel])
    _places: dict[str, int] = field(default_factory=dict[str, int])

    @cached_property
    def _scene(self) -> Scene:
        return stored_sweep_scene(self.store.manifest.sweep, self.store.scene_folder)

    def geom_names(self, place: int) -> list[str]:
        """Return the names of the geoms of a structure, its bodies' where they have none."""
        model = self.models[place].model
        geoms = [model.geom(index) for index in range(model.ngeom)]
        return [geom.name or model.body(int(geom.bodyid[0])).name for geom in geoms]

    def run(self, run_id: str) -> LiveRun:
        """Return one run, with its sliders; a StoreError if the store has none of this id."""
        record = self.store.record(run_id)
        try:
            return self._prepared(record)
        except ContactlabError as error:
            return LiveRun(record, None, why=str(error))

    def _prepared(self, record: EvidenceRecord) -> LiveRun:
        find_engine(record.engine.name)
        axes, controls = canonical_values(self._scene, record.axes), self.store.controls(record)
        resolved = resolve_record(self._scene, record)
        runs = PreparedRuns.of(self._scene, resolved)
        starts = stored_start(record, runs.prepared[0], runs.starts)
        runs = replace(runs, starts=starts, steps=record.steps_asked).repeating([controls])
        variant = replace(self._variant(resolved, runs.starts), steps=record.steps)
        motion = self._motion(record, runs)
        if why := _never(record, variant.model):
            return LiveRun(record, variant, motion, why=why)
        sliders = tuple(self._sliders(record, axes, variant, controls))
        switches = (*self._mending(record, axes, controls), *self._rows(variant))
        notes = tuple(_notes(record, motion))
        return LiveRun(record, variant, motion, sliders, switches, notes)

    def _variant(self, resolved: RunSpec, start: InitialStates, text: str = "") -> Variant:
        key = repr((dict(resolved.structure), sorted(resolved.without)))
        if key not in self._places:
            model = BrowserModel.of(self._scene, resolved)
            self._places[key] = len(self.models)
            self.models.append(model)
        base = self._places[key]
        model = self._scene.prepare(resolved, start, self.models[base].model).model
        return Variant(base, model, start, resolved.steps, text)

    def _motion(self, record: EvidenceRecord, runs: PreparedRuns) -> StoredMotion | None:
        """Return a run's stored motion, or the same one made again; None without either."""
        if record.trace is not None and not self.store.manifest.traces_left_out:
            trace = self.store.trace(record)
            return _thinned(trace.time, trace.qpos, trace.qvel)
        if record.engine.name != MODEL_ENGINE or record.trajectory_hash is None:
            return None
        rollout, model = find_engine(MODEL_ENGINE).roll_out(runs, Buffers()), runs.models[0]
        if trajectory_hash(rollout, 0) != record.trajectory_hash:
            return None
        rows = rollout.state[0, : rollout.steps[0] + 1]
        speed = 1 + model.nq
        return _thinned(rows[:, 0], rows[:, 1:speed], rows[:, speed : speed + model.nv])

    def _sliders(
        self,
        record: EvidenceRecord,
        axes: Mapping[str, object],
        variant: Variant,
        controls: RecordedControls | None,
    ) -> Iterator[Slider]:
        for spec, own, values in offered_values(self._scene, self.store.columns, record, axes):
            stops: list[Variant] = []
            place = 0
            for value in values:
                text = value_text(value)
                if value == own:
                    place = len(stops)
                    stops.append(replace(variant, text=text))
                    continue
                stops.append(self._with({**axes, spec.name: value}, record, controls, text))
            if len(stops) > 1:
                yield Slider(spec.name, spec.unit, place, tuple(stops))

    def _with(
        self,
        axes: Mapping[str, object],
        record: EvidenceRecord,
        controls: RecordedControls | None,
        text: str = "",
    ) -> Variant:
        """Return a run with other values of its axes, resolved as in a sweep."""
        resolved = self._scene.resolve(axes, record.seed, record.duration)
        start = self._scene.starts([resolved])
        if controls is not None:
            start = start.acted_on([controls])
        return self._variant(resolved, start, text)

    def _mending(
        self,
        record: EvidenceRecord,
        axes: Mapping[str, object],
        controls: RecordedControls | None,
    ) -> Iterator[Switch]:
        """Yield the changes that an examination proposes, but those of the structure."""
        for change in self.examination.changes if self.examination else ():
            specs = {name: self._scene.catalogue.find(name) for name in change.settings}
            if change.is_structural or None in specs.values():
                continue
            values = {
                spec.name: spec.parse(change.settings[name])
                for name, spec in specs.items()
                if spec is not None
            }
            cost = f"{change.price.ratio:.2g} x time" if change.price else ""
            variant = self._with({**axes, **values}, record, controls)
            said = ", ".join(f"{name} {value_text(value)}" for name, value in values.items())
            yield Switch("Changes that mend it", change.name, said, cost, variant)

    def _rows(self, variant: Variant) -> Iterator[Switch]:
        budget = self.examination.budget if self.examination else None
        for row, told in rows_of(budget) if budget else ():
            for name, model in switched(variant.model, row):
                changed = replace(variant, model=model)
                yield Switch("Rows of the budget", name, row.summary, told, changed)


def _thinned(time: Floats, qpos: Floats, qvel: Floats) -> StoredMotion | None:
    """Return so many poses as a film has; None if there is none."""
    if not len(time):
        return None
    wanted = np.arange(time[0], time[-1], 1 / _GHOST_RATE)
    shown = np.union1d(np.searchsorted(time, wanted), [len(time) - 1])
    return StoredMotion(time[shown], qpos[shown], (qpos[-1].copy(), qvel[-1].copy()))


def _never(record: EvidenceRecord, model: mujoco.MjModel) -> str:
    """Return why no browser simulates a run; nothing if one may."""
    if model.nplugin:
        return "its model needs plug-ins of the engine, which no browser has"
    if record.engine.name not in {MODEL_ENGINE, LOOP_ENGINE}:
        return f"the engine '{record.engine.name}' computed it, which no browser has"
    return ""


def _notes(record: EvidenceRecord, motion: StoredMotion | None) -> Iterator[str]:
    if record.engine.name == LOOP_ENGINE:
        yield "A loop made this run: its controls are replayed, not what its code did besides."
    if record.status != "ok":
        yield f"The run ended after {record.steps} steps: {record.status_reason or record.status}."
    if motion is None:
        yield "No trace of it is stored, and it does not come out again here: there is no ghost."
