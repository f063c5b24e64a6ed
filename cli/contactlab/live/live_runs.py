"""The data of each run for a page that simulates: start, inputs, settings, stored end, sliders."""

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
from contactlab.live.budget_switches import rows_of, switched_models
from contactlab.live.sliders import offered_values, value_text
from contactlab.mjcf import MODEL_ENGINE
from contactlab.run.planned_runs import open_store_scene
from contactlab.run.stored_runs import canonical_values, resolve_record, stored_start
from contactlab.scene.initial_states import STATE_PARTS, InitialStates
from contactlab.scene.model_edits import LOOP_ENGINE
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.examination import Examination
from contactlab.store.finished_store import Store


@dataclass(frozen=True)
class Variant:
    """A run unchanged, or with another value of one axis, written in `text`."""

    base: int  # place of its structure among the models
    model: mujoco.MjModel
    start: InitialStates  # n = 1
    steps: int
    text: str = ""

    @property
    def parts(self) -> dict[str, Floats]:
        """Flat numbers of its start, by part."""
        return {name: np.ravel(getattr(self.start, name)) for name in STATE_PARTS}


@dataclass(frozen=True)
class Slider:
    """An axis with a changeable value, and the place of the run's own value."""

    name: str
    unit: str
    own: int
    stops: tuple[Variant, ...]


@dataclass(frozen=True)
class Switch:
    """An optional change of a run: its kind, its name, its summary and its known effect."""

    kind: str
    name: str
    summary: str
    finding: str
    variant: Variant


@dataclass(frozen=True)
class StoredMotion:
    """The stored motion of a run, or the same motion simulated again, bit for bit."""

    times: Floats  # (T,) [s]
    qpos: Floats  # (T, nq) there
    end: tuple[Floats, Floats]  # qpos and qvel after the last step


@dataclass(frozen=True)
class LiveRun:
    """One run: all data for a browser's simulation, or `why` it is impossible."""

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

    For an examined model, the rows of its budget and the proposed changes are switches.
    """

    store: Store
    examination: Examination | None = None
    models: list[BrowserModel] = field(default_factory=list[BrowserModel])
    _places: dict[str, int] = field(default_factory=dict[str, int])

    @cached_property
    def _scene(self) -> Scene:
        return open_store_scene(self.store)

    def geom_names(self, place: int) -> list[str]:
        """Return the names of the geoms of a structure; without a name, those of their bodies."""
        model = self.models[place].model
        geoms = [model.geom(index) for index in range(model.ngeom)]
        return [geom.name or model.body(int(geom.bodyid[0])).name for geom in geoms]

    def run(self, run_id: str) -> LiveRun:
        """Return one run, with its sliders; a StoreError if the store lacks this id."""
        record = self.store.record(run_id)
        try:
            return self._prepare_run(record)
        except ContactlabError as error:
            return LiveRun(record, None, why=str(error))

    def _prepare_run(self, record: EvidenceRecord) -> LiveRun:
        find_engine(record.engine.name)
        axes, controls = canonical_values(self._scene, record.axes), self.store.controls(record)
        resolved = resolve_record(self._scene, record)
        runs = PreparedRuns.of(self._scene, resolved)
        starts = stored_start(record, runs.prepared[0], runs.starts)
        runs = replace(runs, starts=starts, steps=record.steps_asked).with_recorded_controls(
            [controls]
        )
        variant = replace(self._add_variant(resolved, runs.starts), steps=record.steps)
        motion = self._stored_motion(record, runs)
        if why := _impossible_reason(record, variant.model):
            return LiveRun(record, variant, motion, why=why)
        sliders = tuple(self._axis_sliders(record, axes, variant, controls))
        switches = (*self._change_switches(record, axes, controls), *self._budget_switches(variant))
        notes = list[str]()
        if record.engine.name == LOOP_ENGINE:
            notes.append(
                "A loop made this run: its controls are replayed, but not other actions of its "
                "code."
            )
        if record.status != "ok":
            reason = record.status_reason or record.status
            notes.append(f"The run ended after {record.steps} steps: {reason}.")
        if motion is None:
            notes.append(
                "No trace is stored, and the run is not reproducible here, so there is no ghost."
            )
        return LiveRun(record, variant, motion, sliders, switches, tuple(notes))

    def _add_variant(self, resolved: RunSpec, start: InitialStates, text: str = "") -> Variant:
        key = repr((dict(resolved.structure), sorted(resolved.without)))
        if key not in self._places:
            model = BrowserModel.of(self._scene, resolved)
            self._places[key] = len(self.models)
            self.models.append(model)
        base = self._places[key]
        model = self._scene.prepare(resolved, start, self.models[base].model).model
        return Variant(base, model, start, resolved.steps, text)

    def _stored_motion(self, record: EvidenceRecord, runs: PreparedRuns) -> StoredMotion | None:
        """Return a run's stored motion, or the same one simulated again; None without either."""
        if record.trace is not None and not self.store.manifest.traces_left_out:
            trace = self.store.trace(record)
            return _thin_poses(trace.time, trace.qpos, trace.qvel)
        if record.engine.name != MODEL_ENGINE or record.trajectory_hash is None:
            return None
        rollout, model = find_engine(MODEL_ENGINE).roll_out(runs, Buffers()), runs.models[0]
        if trajectory_hash(rollout, 0) != record.trajectory_hash:
            return None
        rows = rollout.state[0, : rollout.steps[0] + 1]
        speed = 1 + model.nq
        return _thin_poses(rows[:, 0], rows[:, 1:speed], rows[:, speed : speed + model.nv])

    def _axis_sliders(
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
                stops.append(self._with_axes({**axes, spec.name: value}, record, controls, text))
            if len(stops) > 1:
                yield Slider(spec.name, spec.unit, place, tuple(stops))

    def _with_axes(
        self,
        axes: Mapping[str, object],
        record: EvidenceRecord,
        controls: RecordedControls | None,
        text: str = "",
    ) -> Variant:
        """Return a run with other values of its axes, resolved as in a sweep."""
        resolved = self._scene.resolve(axes, record.seed, record.duration)
        start = self._scene.initial_states([resolved])
        if controls is not None:
            start = start.with_recorded_inputs([controls])
        return self._add_variant(resolved, start, text)

    def _change_switches(
        self,
        record: EvidenceRecord,
        axes: Mapping[str, object],
        controls: RecordedControls | None,
    ) -> Iterator[Switch]:
        for fix in self.examination.fixes if self.examination else ():
            specs = {name: self._scene.catalogue.find_axis(name) for name in fix.settings}
            if fix.is_structural or None in specs.values():
                continue
            values = {
                spec.name: spec.parse(fix.settings[name])
                for name, spec in specs.items()
                if spec is not None
            }
            cost = f"x{fix.time_ratio.ratio:.2f} time" if fix.time_ratio else ""
            variant = self._with_axes({**axes, **values}, record, controls)
            values_words = ", ".join(
                f"{name} {value_text(value)}" for name, value in values.items()
            )
            yield Switch("Fixes", fix.name, values_words, cost, variant)

    def _budget_switches(self, variant: Variant) -> Iterator[Switch]:
        budget = self.examination.budget if self.examination else None
        for row, error_text in rows_of(budget) if budget else ():
            for name, model in switched_models(variant.model, row):
                changed = replace(variant, model=model)
                yield Switch("Rows of the budget", name, row.summary, error_text, changed)


def _thin_poses(time: Floats, qpos: Floats, qvel: Floats) -> StoredMotion | None:
    if not len(time):
        return None
    ghost_rate = 60.0  # stored poses per simulated second
    instants = np.arange(time[0], time[-1], 1 / ghost_rate)
    rows = np.union1d(np.searchsorted(time, instants), [len(time) - 1])
    return StoredMotion(time[rows], qpos[rows], (qpos[-1].copy(), qvel[-1].copy()))


def _impossible_reason(record: EvidenceRecord, model: mujoco.MjModel) -> str:
    """Return the reason why no browser can simulate a run; empty if one can."""
    if model.nplugin:
        return "its model needs plug-ins of the engine, which browsers lack"
    if record.engine.name not in {MODEL_ENGINE, LOOP_ENGINE}:
        return f"the engine '{record.engine.name}' computed it, which browsers lack"
    return ""
