"""Records a user's own loop: each episode becomes a run of a store, like one of a sweep.

The scene of the store is the compiled model. The number and length of episodes are not
known in advance, so the store's identity is completed when the recording is closed.
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
from contactlab.loop.listener import Episode, Listener, known_setup
from contactlab.loop.reader import LoopReader
from contactlab.loop.simulation import differing_parts
from contactlab.measure import METRICS
from contactlab.plugins import load_plugins, loaded_plugins
from contactlab.printable import shell_word
from contactlab.run.evidence_record import find_provenance
from contactlab.run.sweep_runner import identity_fields, measured_columns, shared_fields
from contactlab.run.tasks import Task
from contactlab.run.worker import Worker
from contactlab.scene.contact_pairs import colliding_geoms, declared_pairs, touch_pairs
from contactlab.scene.model_names import match_names, name_of
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import BINARY, MANIFEST, stored_scene
from contactlab.schema.evidence import SweepIdentity
from contactlab.schema.explained_errors import explain_error
from contactlab.schema.scene_manifest import SceneManifest
from contactlab.schema.sweep_schema import Sweep
from contactlab.store import store_files
from contactlab.store.store_writer import StoreWriter, open_writer
from contactlab.store.table_layout import LOOP_COLUMNS

Monitored = str | Sequence[str] | Mapping[str, object]
"""A geom or body with all its possible contacts, two geoms or bodies, or an entry of `pairs`."""

_UNCHECKED_TEXT = "backward errors and repeats: the code that made the steps is not in the store"
_MODEL_FILE = f"model{BINARY}"
_DEFAULT_TEXTS = {
    "title": "A recorded loop",
    "description": "The model that a loop of one's own stepped.",
}


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
    or bodies, with all their possible contacts; two names, for a pair of geoms or bodies; or
    entries of `pairs` as in a scene's manifest. Without it, all possible contacts are monitored, up
    to 64 pairs.

    `scene` has other keys of a manifest, such as `subject`, `hold`, `thresholds` and `pairs`;
    `trace` chooses the episodes with stored traces, and `fresh` replaces a store. An interrupted
    recording is continued.

    Raises:
        SceneError: the data is of another model, or no monitored pair can touch.
        OutputError: the store cannot be written, is in use, or is finished.
    """
    if data.model is not model:
        raise SceneError("the data is not of this model; make it by mujoco.MjData(model)")
    load_plugins()
    folder = Path(store)
    if (folder / store_files.MANIFEST).is_file() and not fresh:
        raise OutputError(f"{folder} has a finished recording; name another, or add fresh=True")
    name = folder.absolute().name
    sweep, manifest = _read_declarations(model, name, monitor, trace, scene or {})
    with ExitStack() as opening, TemporaryDirectory() as scene_folder:
        text = manifest.model_dump_json(indent=2, by_alias=True, exclude_defaults=True)
        (Path(scene_folder) / MANIFEST).write_text(text, encoding="utf-8")
        mujoco.mj_saveModel(model, str(Path(scene_folder) / _MODEL_FILE))
        source = stored_scene(Path(scene_folder), _MODEL_FILE, name)
        own = Scene(source, ENGINES)
        if not own.base({}).pairs:
            raise SceneError("no two geoms of the model can touch, so there is no pair to monitor")
        unknown: dict[str, Any] = {
            "source": "",
            "overrides": (),
            "runs_asked": 0,
            "plan_hash": _hash_ids([]),
        }
        identity_values = identity_fields(name, own, sweep)
        identity = SweepIdentity(**identity_values, lacking=lacking_checks(), **unknown)
        writer = opening.enter_context(open_writer(folder, identity, source.content, fresh=fresh))
        assert isinstance(writer, StoreWriter)
        where = writer.scene_folder.resolve()
        task = Task(
            sweep, (), identity, folder.resolve(), where, find_provenance(), loaded_plugins()
        )
        worker = Worker(task, None)
        reader = LoopReader(worker.scene.base({}), model, data)
        return Recording(writer, worker, reader, opening.pop_all())


class Recording(Listener):
    """A recorded loop over MuJoCo's steps; created by `contactlab.record`.

    Attributes:
        store: the folder of the store.
        episodes: number of episodes in the store.
    """

    def __init__(
        self, writer: StoreWriter, worker: Worker, reader: LoopReader, opened: ExitStack
    ) -> None:
        super().__init__(reader)
        self.store, self.episodes = writer.path, len(writer.done)
        self._labels: Counter[str] = Counter()  # of the episodes of this process
        self._writer, self._worker, self._opened = writer, worker, opened

    def __repr__(self) -> str:
        """Return the number of episodes, their store, and the command that reads it."""
        count = f"{self.episodes} episode{'s' if self.episodes != 1 else ''}"
        labels = ", ".join(f"{number} {label}" for label, number in self._labels.most_common())
        summary = f"{count} in {self.store}{f': {labels}' if labels else ''}"
        if not self.closed:
            return f"<recording, {summary}>"
        if not self.episodes:
            return f"<{summary}>"
        return f"{summary}\nnext: contactlab report {shell_word(self.store)}"

    def follow(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """End the episode and record another simulation, such as environments create at a reset.

        Differences of its model are recorded. Raises a SceneError if the model has other parts or
        names.
        """
        if data is self._reader.data:
            return
        self._end_episode(None)
        base = self._worker.scene.base({})
        if differing := differing_parts(model, base.model):
            raise SceneError(
                f"the model and that of {self.store} have different parts ({differing}); "
                "record it in a separate store"
            )
        self._reader = LoopReader(base, model, data)

    def reset(self, *, success: bool | None = None, total_reward: float | None = None) -> None:
        """End the episode, if it has a step, with its success and reward; the next step begins one.

        The data is not changed. Resets of the data are noticed without this call.
        """
        self._end_episode(None, success=success, total_reward=total_reward)

    def close(self, error: BaseException | None = None) -> None:
        """End the episode and finish the store. Record an error that ended the loop."""
        if self.closed:
            return
        self.closed = f"the recording of {self.store} is closed"
        with self._opened:
            self._end_episode(error and f"the loop ended by {in_one_line(error, __file__)}")
            if not self.episodes:
                self._writer.discard_store()
                if error is None:
                    raise OutputError(
                        f"nothing was recorded in {self.store}: no step was made by the "
                        "recording's step() or mj_step()"
                    )
                return
            ids = [str(row["run_id"]) for row in self._writer.read_rows()]
            update = {"runs_asked": len(ids), "plan_hash": _hash_ids(ids)}
            identity = self._writer.identity.model_copy(update=update)
            run = self._worker.scene.resolve({}, 0, 1.0)
            columns = [*measured_columns([run]), *LOOP_COLUMNS]
            shared = shared_fields(identity)
            self._writer.finish_store(columns, shared, find_provenance(), identity=identity)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _: object, error: BaseException | None, __: TracebackType | None) -> None:
        self.close(error)
        if error is None:
            sys.stderr.write(f"{self!r}\n")

    def _cut_episode(self, why: str | None) -> None:
        self._end_episode(why)

    def _end_episode(
        self,
        cut: str | None,
        *,
        success: bool | None = None,
        total_reward: float | None = None,
    ) -> None:
        """Store the episode, if it has a step; a reason is given if it was cut."""
        reader, scene, model = self._reader, self._worker.scene, self._before
        if not reader.steps:
            reader.clear()
            return
        steps = self._take_steps()
        step_count, base = len(steps.rows), scene.base({})
        duration = step_count * model.opt.timestep
        (run,) = scene.plan_runs({}, [self.episodes], duration, self.episodes)
        start = steps.starts(model)
        prepared = scene.prepare(run, start, model)
        total = math.nan if total_reward is None else float(total_reward)
        rollout = steps.rollout(PreparedRuns(scene, [run], [prepared], start, step_count))
        fields: dict[str, object] = {
            "success": None if success is None else bool(success),
            # A return that is not finite is not stored.
            "total_reward": total if math.isfinite(total) else None,
            "loop": self._loop_record(base.model, _UNCHECKED_TEXT),
        }
        if cut:
            fields |= {"status": "stopped", "status_reason": f"cut after {step_count} steps: {cut}"}
        plan = PlannedModel(run, prepared, start)
        episode = Episode(plan, rollout, known_setup(steps), self._started, fields)
        finished = self._worker.finish_loop(*episode)
        self._writer.append_rows([finished.row])
        self._labels[finished.label] += 1
        self.episodes += 1
        reader.clear()


def _read_declarations(
    model: mujoco.MjModel,
    name: str,
    monitor: Sequence[Monitored] | None,
    trace: str,
    declared: Mapping[str, Any],
) -> tuple[Sweep, SceneManifest]:
    """Return a sweep and a manifest from the arguments; raise a SceneError for wrong ones."""
    entries = [entry for one in monitor or () for entry in _pair_entries(model, one)]
    most_seconds = 1e6  # longest episode [s]; a hold without an end lasts as long as its episode
    fixed = {
        "version": 1,
        "model": _MODEL_FILE,
        "duration": most_seconds,
        "effects": {"base": "all"},
    }
    own = {**_DEFAULT_TEXTS, **declared, **fixed, "pairs": [*entries, *declared.get("pairs", ())]}
    if "hold" in declared:
        own["hold"] = {"to": most_seconds, **declared["hold"]}
    try:
        manifest = SceneManifest.model_validate(own)
        sweep = Sweep(version=1, scene=name, effects={"base": "all"}, trace=trace)
    except ValidationError as error:
        first = error.errors()[0]
        raise SceneError(
            f"{'.'.join(map(str, first['loc']))}: {explain_error(first, SceneManifest)}"
        ) from error
    pairs = declared_pairs(model, manifest.pairs)
    for pair, geoms in zip(pairs, colliding_geoms(model, pairs), strict=True):
        if not geoms:
            raise SceneError(f"monitor: MuJoCo's filters exclude contacts of {pair.name}")
    return sweep, manifest


def _pair_entries(model: mujoco.MjModel, monitored: Monitored) -> list[Mapping[str, object]]:
    """Return monitored pairs as entries of a manifest; raise a SceneError if none can touch."""
    if isinstance(monitored, Mapping):
        return [monitored]
    names = [name_of(model, "geom", geom) for geom in range(model.ngeom)]
    if not isinstance(monitored, str):
        return [{"geoms" if set(monitored) <= set(names) else "bodies": monitored}]
    bodies = [name_of(model, "body", body) for body in model.geom_bodyid]
    of = set(match_names([*names, *bodies], monitored))
    pairs = touch_pairs(model)
    monitored_pairs = [
        pair for pair in pairs if any(of & {names[geom], bodies[geom]} for geom in pair)
    ]
    if not monitored_pairs:
        raise SceneError(f"monitor: no geom or body '{monitored}' can touch anything")
    return [{"geoms": tuple(names[geom] for geom in pair)} for pair in monitored_pairs]


def lacking_checks(
    why: str = "the code that made the steps is not here to repeat them",
    cost: str = "the duration of a recorded loop depends on its own code",
) -> dict[str, str]:
    """Return the fields that recorded loops lack, with reasons."""
    return {
        **{name: why for name, metric in METRICS.items() if metric.kind == "check"},
        "cost": cost,
    }


def _hash_ids(ids: Sequence[str]) -> str:
    return hashlib.sha256("".join(ids).encode()).hexdigest()[:32]
