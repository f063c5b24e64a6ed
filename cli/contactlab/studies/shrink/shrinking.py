"""Parts are taken out of a failing run's model for as long as it fails in the same way.

What to try next is delta debugging (Zeller and Hildebrandt 2002, ddmin): all at once, then halves,
then ever smaller shares of the rest.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from ruamel.yaml import YAML

from contactlab.errors import ContactlabError, SceneError, StoreError
from contactlab.run.stored_runs import prepare_replay
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import BINARY
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.shrink_report import ShrinkReport
from contactlab.step_progress import count_steps
from contactlab.store.finished_store import Store
from contactlab.studies.shrink.failing_model import (
    PARTS,
    START,
    FailingModel,
    Start,
    as_one_file,
    count_parts,
)
from contactlab.studies.shrink.issue_text import issue_text
from contactlab.tasks.session import Session
from contactlab.temporary_folders import temporary_folder

MODEL, SCENE, CONTROLS = "model.xml", "scene.yaml", "controls.csv"
SWEEP, ISSUE = "sweep.yaml", "issue.md"
_VERTICES = (4, 8, 16, 32, 64)
_KEPT = ("checks", "thresholds", "must")  # keys of the sweep that decide about its runs


@dataclass(frozen=True)
class ShrinkRequest:
    """Which run to shrink, where to, and for how long.

    Attributes:
        store: of the run.
        run: its id, or the beginning of it.
        folder: for the small model, the sweep that runs it, and the text of an issue.
        seconds: no other model is tried later.
    """

    store: Store
    run: str
    folder: Path
    seconds: float = 60.0


@dataclass(frozen=True)
class _Failure:
    """The failure of a run."""

    label: str
    bodies: frozenset[str]  # those that the label is of

    @classmethod
    def of(cls, record: EvidenceRecord) -> "_Failure":
        return cls(record.label, frozenset(record.labels[0].bodies))

    def covers_failure(self, other: "_Failure") -> bool:
        """Return whether another run fails in this way: of the same pair, or of no further bodies.

        A label of many bodies, such as a divergence, may be of some of them.
        """
        if other.label != self.label:
            return False
        pair_size = 2  # bodies
        if len(self.bodies) <= pair_size:
            return other.bodies == self.bodies
        return bool(other.bodies) and other.bodies <= self.bodies


def shrink_run(
    request: ShrinkRequest, notify: Callable[[str], None] = lambda _: None
) -> ShrinkReport:
    """Shrink the model of a stored run, and write it with a script that runs it.

    Raises:
        StoreError: there is no such run, or it is stable.
        SceneError: its model cannot be written as one file, or does not fail alone.
        OutputError: the folder cannot be written.
    """
    begun = time.monotonic()
    replayed = prepare_replay(request.store, request.run)
    record, scene = replayed.record, replayed.runs.scene
    if record.label == "stable":
        raise StoreError(f"run {record.run_id} is stable; name one that is not")
    if scene.source.model.suffix == BINARY or scene.source.environment is not None:
        raise SceneError(
            f"run {record.run_id}: its store has the compiled model alone, whose parts cannot be "
            "taken out; sweep its MJCF"
        )
    runs, controls = replayed.runs, request.store.controls(record)
    start = Start.of(runs.models[0], runs.starts, controls)
    text = as_one_file(scene, runs.resolved[0], runs.starts)
    whole = FailingModel(text, start, record.duration, pairs=runs.base.pairs)
    with temporary_folder() as folder:
        notify("running the model as one file")
        trials = _find_trials(whole, record, Path(folder), request.store, scene)
        trials.end = begun + request.seconds

        notify("shortening the run")
        smallest = whole
        changes = (_shorten_run, _start_later, _shorten_run)
        for shorten in count_steps(changes, "shorter runs", len(changes)):
            smallest = shorten(smallest, trials)
        smallest = remove_unneeded_parts(smallest, trials, notify)

        entry = trials.failed[smallest].labels[0]
        report = ShrinkReport(
            run=record.run_id,
            label=record.label,
            bodies=entry.bodies,
            reason=entry.reason,
            stored_reason=record.labels[0].reason,
            before=count_parts(whole.compile_spec()),
            after=count_parts(smallest.compile_spec()),
            start_time=smallest.start_time,
            duration=smallest.duration,
            stored_duration=record.duration,
            models_run=trials.count,
            finished=not trials.over,
            seconds=time.monotonic() - begun,
            folder=str(request.folder),
        )
        files = trials.write_files(smallest)
        files[ISSUE] = issue_text(report, files[MODEL], driven=CONTROLS in files)
        Session(request.folder).write(files)
    return report


class _Judging(NamedTuple):
    """Keys of a sweep, and thresholds of its scene, for judging runs."""

    keys: Mapping[str, Any]
    thresholds: Mapping[str, float]


def _find_trials(
    model: FailingModel, record: EvidenceRecord, folder: Path, store: Store, scene: Scene
) -> "_Trials":
    """Return trials with judgements that let a model fail like a stored run."""
    resolved, manifest = store.manifest.sweep.resolved, scene.source.manifest
    keys = {key: resolved[key] for key in _KEPT if resolved.get(key)}
    thresholds = manifest.thresholds if manifest else {}
    why = ""
    # The first judging has no checks, which many labels do not need.
    for sweep_keys in ({**keys, "checks": "none"}, keys):
        trials = _Trials(folder, _Judging(sweep_keys, thresholds), _Failure.of(record))
        why = trials.find_difference(model)
        if not why:
            return trials
    raise SceneError(
        f"run {record.run_id} is {record.label}; its model in one file, without what the scene "
        f"says of it, {why}: so it is not the model alone that fails"
    )


class Trials(Protocol):
    """Tries models, and says which fail alike."""

    @property
    def over(self) -> bool:
        """Whether the time for trials is over."""
        ...

    def still_fails(self, model: FailingModel) -> bool:
        """Return whether a model fails as the first one does."""
        ...


@dataclass
class _Trials:
    """Runs models, and says which fail as a stored run does.

    Attributes:
        folder: of a model at a time, and of its store.
        judging: of its runs.
        failure: of the stored run.
        end: by the monotonic clock; no trial begins later [s].
        count: of models that were run.
        over: whether one was not run, since the time had ended.
        failed: records of models that failed alike.
    """

    folder: Path
    judging: _Judging
    failure: _Failure
    end: float = math.inf
    count: int = 0
    over: bool = False
    failed: dict[FailingModel, EvidenceRecord] = field(
        default_factory=dict[FailingModel, EvidenceRecord]
    )
    _stood: set[FailingModel] = field(default_factory=set[FailingModel])

    def still_fails(self, model: FailingModel) -> bool:
        """Return whether a model fails as the stored run does; no if the time is over."""
        if model not in self.failed and model not in self._stood:
            if time.monotonic() > self.end:
                self.over = True
                return False
            self.find_difference(model)
        return model in self.failed

    def find_difference(self, model: FailingModel) -> str:
        """Run a model; return how its run differs from the stored one, empty if it fails alike."""
        self.count += 1
        record, why = self._run_outcome(model)
        if record is not None and not why:
            self.failed[model] = record
        else:
            self._stood.add(model)
        return why

    def _run_outcome(self, model: FailingModel) -> tuple[EvidenceRecord | None, str]:
        try:
            files = self.write_files(model)
            session, scenes = Session(self.folder), SceneLoader(self.folder)
            session.write(files)
            store = session.run_derived("store", self._trial_sweep(), scenes)
            (record,) = store.records()
        except ContactlabError as error:
            return None, f"cannot be run: {str(error).splitlines()[0]}"
        own = _Failure.of(record)
        of = f" of {', '.join(sorted(own.bodies))}" if own.bodies else ""
        return record, "" if self.failure.covers_failure(own) else f"is {own.label}{of}"

    def write_files(self, model: FailingModel) -> dict[str, str]:
        """Return the files of a scene of a model, and of the sweep that runs it."""
        table = model.start.input_table(model.compile_spec(), model.duration)
        manifest = {
            "version": 1,
            "title": f"The smallest model found that is {self.failure.label}",
            "description": "What is left of a larger one that fails in the same way.",
            "model": MODEL,
            "duration": model.duration,
            "keyframe": START,
            "pairs": model.monitored_pairs(),
            "thresholds": dict(self.judging.thresholds),
            "drive": {"file": CONTROLS, "interpolation": "hold"} if table else "none",
            "effects": "all",
        }
        sweep = {**self._trial_sweep(), "expect": [{"label": self.failure.label}]}
        files = {MODEL: model.whole_text(), SCENE: _write_yaml(manifest), SWEEP: _write_yaml(sweep)}
        return files | ({CONTROLS: table} if table else {})

    def _trial_sweep(self) -> dict[str, Any]:
        return {"version": 1, "scene": "./", **self.judging.keys}


def _write_yaml(data: Mapping[str, Any]) -> str:
    text = StringIO()
    YAML().dump({key: value for key, value in data.items() if value != {}}, text)
    return text.getvalue()


def remove_unneeded_parts(
    model: FailingModel, trials: Trials, notify: Callable[[str], None] = lambda _: None
) -> FailingModel:
    """Return the model without parts that its failure does not need.

    Without the last ones, earlier ones may go.
    """
    # Each trial reads thousands of vertices and computes their hulls.
    coarser = model.coarsen_meshes(model.part_names("meshes"), _VERTICES[-1])
    if coarser is not None and trials.still_fails(coarser):
        model = coarser
    while True:
        before = model.text
        for kind in count_steps(PARTS, "kinds of parts", len(PARTS)):
            notify(f"removing {kind}")
            model = _remove_parts(
                model, kind, partial(FailingModel.remove_parts, kind=kind), trials
            )
        notify("removing joints")
        model = _remove_parts(model, "joints", FailingModel.remove_joints, trials)
        notify("simplifying options and meshes")
        for changed in _simplify_model(model):
            if trials.over:
                break
            smaller = changed(model)
            if smaller is not None and trials.still_fails(smaller):
                model = smaller
        if model.text == before or trials.over:
            return model


def _shorten_run(model: FailingModel, trials: _Trials) -> FailingModel:
    """Return the model with a run that ends soon after it fails."""
    step = trials.failed[model].labels[0].step
    if not step:
        return model
    timestep = float(model.compile_spec().opt.timestep)
    ends = (1.1, 2.0)  # multiples of the onset's time as ends of a run
    for times in ends:
        duration = math.ceil(times * (step + 1)) * timestep
        shorter = replace(model, duration=duration)
        if duration < model.duration and trials.still_fails(shorter):
            return shorter
    return model


def _start_later(model: FailingModel, trials: _Trials) -> FailingModel:
    """Return the model with a run that begins soon before it fails, in the state it has there.

    A part that only made the motion up to there can go then, and each trial takes less time.
    """
    step = trials.failed[model].labels[0].step or 0
    begins = (64, 16, 4)  # shares of the time to the onset that a run may keep, as 1 / each
    for share in begins:
        steps = step - math.ceil(step / share)
        if steps > 0 and not trials.over and trials.still_fails(later := model.start_later(steps)):
            return later
    return model


def _remove_parts(
    model: FailingModel,
    kind: str,
    without: Callable[..., FailingModel | None],
    trials: Trials,
) -> FailingModel:
    """Return the model without as many parts of a kind as can go."""
    part_names, share = model.part_names(kind), 1
    while part_names and not trials.over:
        size = math.ceil(len(part_names) / share)
        for first in range(0, len(part_names), size):
            smaller = without(model, names=part_names[first : first + size])
            if smaller is not None and trials.still_fails(smaller):
                remaining_names = {*smaller.part_names(kind)}
                part_names = [name for name in part_names if name in remaining_names]
                model, share = smaller, max(share - 1, 1)
                break
        else:
            if size == 1:
                break
            share = min(2 * share, len(part_names))
    return model


def _simplify_model(model: FailingModel) -> Iterator[Callable[[FailingModel], FailingModel | None]]:
    """Yield changes that make a model's options and meshes simpler, one at a time."""
    yield FailingModel.fuse_bodies
    for option in model.options:
        yield partial(FailingModel.reset_option, option=option)
    for mesh in model.part_names("meshes"):
        yield partial(FailingModel.remove_parts, kind="meshes", names=[mesh])
        for vertices in reversed(_VERTICES):
            yield partial(FailingModel.coarsen_meshes, meshes=[mesh], vertices=vertices)
