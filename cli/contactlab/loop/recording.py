"""Somebody's own loop, recorded: each episode becomes a run of a store, as one of a sweep.

The scene of the store is the model as it was compiled. It does not know how long an episode will
be, nor how many there are; so the store's identity is completed when the recording is closed.
"""

import hashlib
import math
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, Self

import mujoco
from pydantic import ValidationError

from contactlab.accuracy.reference import PlannedModel
from contactlab.engines import ENGINES, PreparedRuns
from contactlab.errors import OutputError, SceneError, in_one_line
from contactlab.loop.listener import Episode, Listener, known_of
from contactlab.loop.reader import LoopReader
from contactlab.loop.simulation import other_parts
from contactlab.measure import METRICS
from contactlab.plugins import load_plugins, loaded_plugins
from contactlab.printable import shell_word
from contactlab.run.evidence_record import provenance
from contactlab.run.sweep_runner import identity_fields, measured_columns, shared_fields
from contactlab.run.tasks import Task
from contactlab.run.worker import Worker
from contactlab.scene.contact_pairs import colliding, declared_pairs, geom_pairs, may_touch
from contactlab.scene.model_names import matching, name_of
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import BINARY, MANIFEST, stored_scene
from contactlab.schema.evidence import SweepIdentity
from contactlab.schema.requirement import explained
from contactlab.schema.scene_manifest import SceneManifest
from contactlab.schema.sweep_schema import Sweep
from contactlab.store import store_files
from contactlab.store.store_writer import StoreWriter, open_writer
from contactlab.store.table_layout import LOOP_COLUMNS

Monitored = str | Sequence[str] | Mapping[str, object]
"""A geom or body with all that it may touch, two geoms or two bodies, or an entry of `pairs`."""

_UNCHECKED = "backward errors and repeats: the code that made the steps is not in the store"
_LONG = 1e6  # how long an episode may last [s]; a hold without an end lasts as long as its episode
_MODEL = f"model{BINARY}"
_USUAL = {"title": "A recorded loop", "description": "The model that a loop of one's own stepped."}


def record(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    store: str | Path,
    *,
    monitor: Sequence[Monitored] | None = None,
    scene: Mapping[str, Any] | None = None,
    trace: str = "all",
    fresh: bool = False,
) -> "Recording":
    """Record a loop of your own over MuJoCo's steps: each episode becomes a run of a store.

    Within `with contactlab.record(model, data, "results/mine") as recording:`, steps are made by
    `recording.step()`, and a reset of the data begins another episode. `monitor` has names of geoms
    or bodies, for all that these may touch; two names, for a pair of geoms or bodies; or entries of
    `pairs` as in a scene's manifest. Left out, what can touch is monitored, up to 64 pairs.
    `scene` has other keys of a manifest, as `subject`, `hold`, `thresholds` and `pairs`; `trace`
    says of which episodes traces are kept, and `fresh` replaces a store. One that was interrupted
    goes on.

    Raises:
        SceneError: the data is of another model, or nothing that is monitored can touch.
        OutputError: the store cannot be written, is in use, or is finished.
    """
    if data.model is not model:
        raise SceneError("the data is not of this model; make it by mujoco.MjData(model)")
    load_plugins()
    folder = Path(store)
    if (folder / store_files.MANIFEST).is_file() and not fresh:
        raise OutputError(f"{folder} has a finished recording; name another, or add fresh=True")
    name = folder.absolute().name
    sweep, manifest = _declared(model, name, monitor, trace, scene or {})
    with ExitStack() as opening, TemporaryDirectory() as written:
        text = manifest.model_dump_json(indent=2, by_alias=True, exclude_defaults=True)
        (Path(written) / MANIFEST).write_text(text, encoding="utf-8")
        mujoco.mj_saveModel(model, str(Path(written) / _MODEL))
        source = stored_scene(Path(written), _MODEL, name)
        own = Scene(source, ENGINES)
        if not own.base({}).pairs:
            raise SceneError("no two geoms of the model can touch, so nothing is monitored")
        unknown: dict[str, Any] = {
            "source": "",
            "overrides": (),
            "runs_asked": 0,
            "plan_hash": _hash([]),
        }
        known = identity_fields(name, own, sweep)
        identity = SweepIdentity(**known, lacking=lacking_checks(), **unknown)
        writer = opening.enter_context(open_writer(folder, identity, source.content, fresh=fresh))
        assert isinstance(writer, StoreWriter)
        where = writer.scene_folder.resolve()
        task = Task(sweep, (), identity, folder.resolve(), where, provenance(), loaded_plugins())
        worker = Worker(task, None)
        reader = LoopReader(worker.scene.base({}), model, data)
        return Recording(writer, worker, reader, opening.pop_all())


class Recording(Listener):
    """A loop over MuJoCo's steps that is recorded; made by `contactlab.record`.

    Attributes:
        store: the folder of the store.
        episodes: how many episodes the store has.
    """

    def __init__(
        self, writer: StoreWriter, worker: Worker, reader: LoopReader, opened: ExitStack
    ) -> None:
        super().__init__(reader)
        self.store, self.episodes = writer.path, len(writer.done)
        self._labels: Counter[str] = Counter()  # of the episodes of this process
        self._writer, self._worker, self._opened = writer, worker, opened

    def __repr__(self) -> str:
        """Say what is recorded, where, and by which command it is read."""
        count = f"{self.episodes} episode{'s' if self.episodes != 1 else ''}"
        labels = ", ".join(f"{number} {label}" for label, number in self._labels.most_common())
        said = f"{count} in {self.store}{f': {labels}' if labels else ''}"
        if not self.closed:
            return f"<recording, {said}>"
        if not self.episodes:
            return f"<{said}>"
        return f"{said}\nnext: contactlab report {shell_word(self.store)}"

    def follow(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """End the episode and record another simulation, as environments make when they are reset.

        What differs in its model stands in the records. Raises a SceneError if the model has other
        parts, or names them otherwise.
        """
        if data is self._reader.data:
            return
        self._end(None)
        base = self._worker.scene.base({})
        if differing := other_parts(model, base.model):
            raise SceneError(
                f"the model has other parts than that of {self.store} ({differing}); "
                "record it in a store of its own"
            )
        self._reader = LoopReader(base, model, data)

    def reset(self, *, success: bool | None = None, total_reward: float | None = None) -> None:
        """End the episode, if it has a step, and say how it went; the next step begins another.

        The data is not touched. Resets of the data are noticed without it.
        """
        self._end(None, success=success, total_reward=total_reward)

    def close(self, error: BaseException | None = None) -> None:
        """End the episode and finish the store; an error that ended the loop is said of it."""
        if self.closed:
            return
        self.closed = f"the recording of {self.store} is closed"
        with self._opened:
            self._end(error and f"the loop ended by {in_one_line(error, __file__)}")
            if not self.episodes:
                self._writer.discard()
                if error is None:
                    raise OutputError(
                        f"nothing was recorded in {self.store}: no step was made by the "
                        "recording's step() or mj_step()"
                    )
                return
            ids = [str(row["run_id"]) for row in self._writer.rows()]
            update = {"runs_asked": len(ids), "plan_hash": _hash(ids)}
            identity = self._writer.identity.model_copy(update=update)
            run = self._worker.scene.resolve({}, 0, 1.0)
            columns = [*measured_columns([run]), *LOOP_COLUMNS]
            shared = shared_fields(identity)
            self._writer.finish(columns, shared, provenance(), identity=identity)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _: object, error: BaseException | None, __: TracebackType | None) -> None:
        self.close(error)
        if error is None:
            sys.stderr.write(f"{self!r}\n")

    def _cut(self, why: str | None) -> None:
        self._end(why)

    def _end(
        self,
        cut: str | None,
        *,
        success: bool | None = None,
        total_reward: float | None = None,
    ) -> None:
        """Store the episode, if it has a step; it may have been cut."""
        reader, scene, model = self._reader, self._worker.scene, self._before
        if not reader.steps:
            reader.clear()
            return
        steps = self._taken()
        made, base = len(steps.rows), scene.base({})
        duration = made * model.opt.timestep
        (run,) = scene.planned({}, [self.episodes], duration, self.episodes)
        start = steps.starts(model)
        prepared = scene.prepare(run, start, model)
        total = math.nan if total_reward is None else float(total_reward)
        rollout = steps.rollout(PreparedRuns(scene, [run], [prepared], start, made))
        said: dict[str, object] = {
            "success": None if success is None else bool(success),
            # What is no number is no return.
            "total_reward": total if math.isfinite(total) else None,
            "loop": self._noticed(base.model, _UNCHECKED),
        }
        if cut:
            said |= {"status": "stopped", "status_reason": f"cut after {made} steps: {cut}"}
        plan = PlannedModel(run, prepared, start)
        episode = Episode(plan, rollout, known_of(steps), self._started, said)
        finished = self._worker.finish_loop(*episode)
        self._writer.append([finished.row])
        self._labels[finished.label] += 1
        self.episodes += 1
        reader.clear()


def _declared(
    model: mujoco.MjModel,
    name: str,
    monitor: Sequence[Monitored] | None,
    trace: str,
    said: Mapping[str, Any],
) -> tuple[Sweep, SceneManifest]:
    """Return what a sweep file and a manifest would say; a SceneError if that is wrong."""
    entries = [entry for one in monitor or () for entry in _entries(model, one)]
    fixed = {"version": 1, "model": _MODEL, "duration": _LONG, "effects": {"base": "all"}}
    own = {**_USUAL, **said, **fixed, "pairs": [*entries, *said.get("pairs", ())]}
    if "hold" in said:
        own["hold"] = {"to": _LONG, **said["hold"]}
    try:
        manifest = SceneManifest.model_validate(own)
        sweep = Sweep(version=1, scene=name, effects={"base": "all"}, trace=trace)
    except ValidationError as error:
        first = error.errors()[0]
        raise SceneError(f"{'.'.join(map(str, first['loc']))}: {explained(first)}") from error
    touch = may_touch(model)
    for pair in declared_pairs(model, manifest.pairs):
        if not colliding(touch, pair):
            raise SceneError(f"monitor: MuJoCo's filters keep {pair.name} from touching")
    return sweep, manifest


def _entries(model: mujoco.MjModel, monitored: Monitored) -> list[Mapping[str, object]]:
    """Return what is monitored as entries of a manifest; a SceneError if nothing can touch it."""
    if isinstance(monitored, Mapping):
        return [monitored]
    names = [name_of(model, "geom", geom) for geom in range(model.ngeom)]
    if not isinstance(monitored, str):
        return [{"geoms" if set(monitored) <= set(names) else "bodies": monitored}]
    bodies = [name_of(model, "body", body) for body in model.geom_bodyid]
    of = set(matching([*names, *bodies], monitored))
    pairs = geom_pairs(may_touch(model))
    found = [pair for pair in pairs if any(of & {names[geom], bodies[geom]} for geom in pair)]
    if not found:
        raise SceneError(f"monitor: no geom or body '{monitored}' can touch anything")
    return [{"geoms": tuple(names[geom] for geom in pair)} for pair in found]


def lacking_checks(
    why: str = "the code that made the steps is not here to repeat them",
    cost: str = "a recorded loop takes its own time",
) -> dict[str, str]:
    """Return what recorded loops have not, and why."""
    return {
        **{name: why for name, metric in METRICS.items() if metric.kind == "check"},
        "cost": cost,
    }


def _hash(ids: Sequence[str]) -> str:
    return hashlib.sha256("".join(ids).encode()).hexdigest()[:32]
