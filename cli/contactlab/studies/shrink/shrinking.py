"""Parts are taken out of a failing run's model for as long as it fails in the same way.

What to try next is delta debugging (Zeller and Hildebrandt 2002, ddmin): all at once, then halves,
then ever smaller shares of what is left.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from ruamel.yaml import YAML

from contactlab.errors import ContactlabError, SceneError, StoreError
from contactlab.run.stored_runs import prepare_replay
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import BINARY
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.shrink_report import ShrinkReport
from contactlab.store.finished_store import Store
from contactlab.studies.shrink.failing_model import (
    PARTS,
    START,
    FailingModel,
    Start,
    as_one_file,
    sizes,
)
from contactlab.studies.shrink.issue_text import issue_text
from contactlab.tasks.session import Session

MODEL, SCENE, CONTROLS = "model.xml", "scene.yaml", "controls.csv"
SWEEP, ISSUE = "sweep.yaml", "issue.md"
_PAIR = 2  # bodies
_AFTER = (1.1, 2.0)  # times of the onset after which a run may end
_BEFORE = (64, 16, 4)  # shares of the time to the onset that a run may keep, as 1 / each
_VERTICES = (4, 8, 16, 32, 64)
_KEPT = ("checks", "thresholds", "must")  # keys of the sweep by which its runs are judged


@dataclass(frozen=True)
class ShrinkRequest:
    """Which run to shrink, where to, and for how long.

    Attributes:
        store: of the run.
        run: its id, or the beginning of it.
        folder: for the small model, the sweep that runs it, and the text of an issue.
        seconds: after which no other model is tried.
    """

    store: Store
    run: str
    folder: Path
    seconds: float = 60.0


@dataclass(frozen=True)
class _Failure:
    """The way in which a run fails."""

    label: str
    bodies: frozenset[str]  # those that the label is of

    @classmethod
    def of(cls, record: EvidenceRecord) -> "_Failure":
        return cls(record.label, frozenset(record.labels[0].bodies))

    def covers(self, other: "_Failure") -> bool:
        """Return whether another run fails in this way: of the same pair, or of no further bodies.

        A label of many bodies, as of what diverges, may be of a part of them.
        """
        if other.label != self.label:
            return False
        if len(self.bodies) <= _PAIR:
            return other.bodies == self.bodies
        return bool(other.bodies) and other.bodies <= self.bodies


def run(request: ShrinkRequest, notify: Callable[[str], None] = lambda _: None) -> ShrinkReport:
    """Shrink the model of a stored run, and write it with what runs it.

    Raises:
        StoreError: there is no such run, or it is stable.
        SceneError: its model cannot be written as one file, or does not fail by itself.
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
    with TemporaryDirectory(prefix="contactlab-") as folder:
        notify("running the model as one file")
        trials = _reproducing(whole, record, Path(folder), _judged_by(request.store, scene))
        trials.end = begun + request.seconds
        smallest = _smallest(whole, trials, notify)
        entry = trials.failed[smallest].labels[0]
        report = ShrinkReport(
            run=record.run_id,
            label=record.label,
            bodies=entry.bodies,
            reason=entry.reason,
            stored_reason=record.labels[0].reason,
            before=sizes(whole.compiled()),
            after=sizes(smallest.compiled()),
            start_time=smallest.start_time,
            duration=smallest.duration,
            stored_duration=record.duration,
            models_run=trials.count,
            finished=not trials.over,
            seconds=time.monotonic() - begun,
            folder=str(request.folder),
        )
        files = trials.files(smallest)
        files[ISSUE] = issue_text(report, files[MODEL], driven=CONTROLS in files)
        Session(request.folder).write(files)
    return report


class _Judging(NamedTuple):
    """Keys of a sweep, and thresholds of its scene, by which runs are judged."""

    keys: Mapping[str, Any]
    thresholds: Mapping[str, float]


def _judged_by(store: Store, scene: Scene) -> Iterator[_Judging]:
    """Yield the judging of a store's runs, first without checks, which many labels do not need."""
    resolved, manifest = store.manifest.sweep.resolved, scene.source.manifest
    keys = {key: resolved[key] for key in _KEPT if resolved.get(key)}
    thresholds = manifest.thresholds if manifest else {}
    yield _Judging({**keys, "checks": "none"}, thresholds)
    yield _Judging(keys, thresholds)


def _reproducing(
    model: FailingModel, record: EvidenceRecord, folder: Path, judgings: Iterator[_Judging]
) -> "_Trials":
    """Return trials by whose judging a model fails as a stored run does."""
    why = ""
    for judging in judgings:
        trials = _Trials(folder, judging, _Failure.of(record))
        why = trials.difference(model)
        if not why:
            return trials
    raise SceneError(
        f"run {record.run_id} is {record.label}; its model in one file, without what the scene "
        f"says of it, {why}: so it is not the model alone that fails"
    )


@dataclass
class _Trials:
    """Runs models, and says which fail as a stored run does.

    Attributes:
        folder: of a model at a time, and of its store.
        judging: of its runs.
        failure: of the stored run.
        end: by the monotonic clock, after which none is run [s].
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

    def fails(self, model: FailingModel) -> bool:
        """Return whether a model fails as the stored run does; no if the time is over."""
        if model not in self.failed and model not in self._stood:
            if time.monotonic() > self.end:
                self.over = True
                return False
            self.difference(model)
        return model in self.failed

    def difference(self, model: FailingModel) -> str:
        """Run a model; return how its run differs from the stored one, empty if it fails alike."""
        self.count += 1
        record, why = self._outcome(model)
        if record is not None and not why:
            self.failed[model] = record
        else:
            self._stood.add(model)
        return why

    def _outcome(self, model: FailingModel) -> tuple[EvidenceRecord | None, str]:
        try:
            files = self.files(model)
            session, scenes = Session(self.folder), SceneLoader(self.folder)
            session.write(files)
            store = session.run_derived("store", self._sweep(), scenes)
            (record,) = store.records()
        except ContactlabError as error:
            return None, f"cannot be run: {str(error).splitlines()[0]}"
        own = _Failure.of(record)
        of = f" of {', '.join(sorted(own.bodies))}" if own.bodies else ""
        return record, "" if self.failure.covers(own) else f"is {own.label}{of}"

    def files(self, model: FailingModel) -> dict[str, str]:
        """Return the files of a scene of a model, and of the sweep that runs it."""
        table = model.start.table(model.compiled(), model.duration)
        manifest = {
            "version": 1,
            "title": f"The smallest model found that is {self.failure.label}",
            "description": "What is left of a larger one that fails in the same way.",
            "model": MODEL,
            "duration": model.duration,
            "keyframe": START,
            "pairs": model.monitored(),
            "thresholds": dict(self.judging.thresholds),
            "drive": {"file": CONTROLS, "interpolation": "hold"} if table else "none",
            "effects": "all",
        }
        sweep = {**self._sweep(), "expect": [{"label": self.failure.label}]}
        files = {MODEL: model.whole_text(), SCENE: _yaml(manifest), SWEEP: _yaml(sweep)}
        return files | ({CONTROLS: table} if table else {})

    def _sweep(self) -> dict[str, Any]:
        return {"version": 1, "scene": "./", **self.judging.keys}


def _yaml(data: Mapping[str, Any]) -> str:
    text = StringIO()
    YAML().dump({key: value for key, value in data.items() if value != {}}, text)
    return text.getvalue()


def _smallest(model: FailingModel, trials: _Trials, notify: Callable[[str], None]) -> FailingModel:
    """Return the model without all that can go; what went last may let go what stayed before."""
    notify("shortening the run")
    model = _shorter(_later(_shorter(model, trials), trials), trials)
    # Thousands of vertices are read and hulled anew in each trial.
    coarser = model.coarser(model.parts("meshes"), _VERTICES[-1])
    if coarser is not None and trials.fails(coarser):
        model = coarser
    while True:
        before = model.text
        for kind in PARTS:
            notify(f"removing {kind}")
            model = _without(model, kind, partial(FailingModel.without, kind=kind), trials)
        notify("removing joints")
        model = _without(model, "joints", FailingModel.still, trials)
        notify("simplifying options and meshes")
        for changed in _plainer(model):
            if trials.over:
                break
            smaller = changed(model)
            if smaller is not None and trials.fails(smaller):
                model = smaller
        if model.text == before or trials.over:
            return model


def _shorter(model: FailingModel, trials: _Trials) -> FailingModel:
    """Return the model with a run that ends soon after it fails."""
    step = trials.failed[model].labels[0].step
    if not step:
        return model
    timestep = float(model.compiled().opt.timestep)
    for times in _AFTER:
        duration = math.ceil(times * (step + 1)) * timestep
        shorter = replace(model, duration=duration)
        if duration < model.duration and trials.fails(shorter):
            return shorter
    return model


def _later(model: FailingModel, trials: _Trials) -> FailingModel:
    """Return the model with a run that begins soon before it fails, in the state it has there.

    A part that only made the motion up to there can go then, and each trial takes less time.
    """
    step = trials.failed[model].labels[0].step or 0
    for share in _BEFORE:
        steps = step - math.ceil(step / share)
        if steps > 0 and not trials.over and trials.fails(later := model.later(steps)):
            return later
    return model


def _without(
    model: FailingModel,
    kind: str,
    without: Callable[..., FailingModel | None],
    trials: _Trials,
) -> FailingModel:
    """Return the model without as many parts of a kind as can go."""
    kept, share = model.parts(kind), 1
    while kept and not trials.over:
        size = math.ceil(len(kept) / share)
        for first in range(0, len(kept), size):
            smaller = without(model, names=kept[first : first + size])
            if smaller is not None and trials.fails(smaller):
                left = {*smaller.parts(kind)}
                kept = [name for name in kept if name in left]
                model, share = smaller, max(share - 1, 1)
                break
        else:
            if size == 1:
                break
            share = min(2 * share, len(kept))
    return model


def _plainer(model: FailingModel) -> Iterator[Callable[[FailingModel], FailingModel | None]]:
    """Yield changes that make a model's options and meshes simpler, one at a time."""
    yield FailingModel.fused
    for option in model.options:
        yield partial(FailingModel.plain, option=option)
    for mesh in model.parts("meshes"):
        yield partial(FailingModel.without, kind="meshes", names=[mesh])
        for vertices in reversed(_VERTICES):
            yield partial(FailingModel.coarser, meshes=[mesh], vertices=vertices)
