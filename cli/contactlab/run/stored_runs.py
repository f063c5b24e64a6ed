"""Repeats stored runs from their store alone: replays them bit for bit, or times them.

Runs are timed in processes that `contactlab compare --remeasure` controls. Each line of such a
process's input requests a run: {"run": id, "repeats": n}. Each line of its output answers:
{"seconds": CPU time, "steps": made}, or {"error": reason}. The first line names the engine.
"""

import gc
import json
import subprocess
import sys
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any

import numpy as np

from contactlab.engines import ENGINES, engine_of, find_engine
from contactlab.engines.engine import Buffers, PreparedRuns, Rollout, Segments, TimesSteps
from contactlab.engines.rollout_trace import trajectory_hash
from contactlab.errors import ContactlabError, PluginError, PolicyError, StoreError
from contactlab.mjcf import MODEL_ENGINE
from contactlab.plugins import loaded_plugins
from contactlab.registry import fill_registry, registry_fillers
from contactlab.run.planned_runs import open_store_scene
from contactlab.scene.compiled_scene import PreparedModel
from contactlab.scene.initial_states import InitialStates
from contactlab.scene.mujoco_versions import silence_mujoco
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.store_reports import RunReplay
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import trace_damage


@dataclass(frozen=True)
class PreparedReplay:
    """A stored run that is ready to be simulated again."""

    record: EvidenceRecord
    runs: PreparedRuns

    @property
    def prepared_model(self) -> PreparedModel:
        """Its model."""
        return self.runs.prepared[0]


def prepare_replay(store: Store, run: str) -> PreparedReplay:
    """Return a stored run's model and initial state, made from the store's own files.

    Raises the errors of `stored_run`, and a SceneError if the stored scene does not compile here.
    """
    record, scene, resolved = stored_run(store, run)
    runs = PreparedRuns.of(scene, resolved)
    starts = stored_start(record, runs.prepared[0], runs.starts)
    runs = replace(runs, starts=starts, steps=record.steps_asked)
    return PreparedReplay(record, runs.with_recorded_controls([store.controls(record)]))


def stored_run(store: Store, run: str) -> tuple[EvidenceRecord, Scene, RunSpec]:
    """Return a stored run, its scene and its settings, made from the store's own files.

    Raises a StoreError if there is no such run, or its settings do not give its id; an EngineError
    if the engine that computed it is not here; a PluginError if it cannot be prepared, and a
    plug-in that it was run with is not loaded.
    """
    record = store.record(run)
    loaded_names = {plugin.name for plugin in loaded_plugins()}
    missing = [str(plugin) for plugin in record.plugins if plugin.name not in loaded_names]
    try:
        find_engine(record.engine.name)
        scene = open_store_scene(store)
        return record, scene, resolve_record(scene, record)
    except ContactlabError as error:
        if not missing:
            raise
        raise PluginError(
            f"run {record.run_id} was run with plug-in {', '.join(missing)}, not loaded here; "
            f"install it or name its file with --plugin: {error}"
        ) from error


def resolve_record(scene: Scene, record: EvidenceRecord) -> RunSpec:
    """Return everything that decides a stored run. Raises a StoreError if its id differs."""
    resolved = scene.resolve(canonical_values(scene, record.axes), record.seed, record.duration)
    if (run_id := scene.run_id(resolved)) != record.run_id:
        raise StoreError(differing_id_text(record.run_id, run_id))
    return resolved


def differing_id_text(stored: str, again: str) -> str:
    """Return the message that a run resolves to an id other than the stored one."""
    return (
        f"run {stored}: the stored scene and settings give another id, {again}; the store or this "
        "version's defaults changed"
    )


def canonical_values(scene: Scene, axes: Mapping[str, object]) -> dict[str, object]:
    """Return the axis values of a stored run.

    Raises a StoreError if the scene does not accept them.
    """
    return {name: _parse_value(scene, name, value) for name, value in axes.items()}


def replay_run(store: Store, run: str, *, allow_code: bool = False) -> RunReplay:
    """Simulate a stored run again. Return whether it is equal, or where it first differs.

    A SceneError says that it is an episode of an environment with code that is not allowed.
    """
    silence_mujoco()
    start = prepare_replay(store, run)
    record = start.record
    if environment := start.runs.scene.source.environment:
        rollout = environment.replay_episode(record, start.runs, allow_code)
    else:
        rollout = find_engine(record.engine.name).roll_out(start.runs, Buffers())
    old, new = record.trajectory_hash, trajectory_hash(rollout, 0)
    step, difference, damage = None, None, trace_damage(store, record)
    if new != old and damage is None:
        step, difference = _first_difference(store, record, rollout)
    engine = f"{record.engine.name} {record.engine.version}"
    return RunReplay(
        run_id=record.run_id,
        equal=new == old,
        stored_hash=old,
        hash=new,
        step=step,
        difference=difference,
        stored_engine=engine,
        damage=damage,
    )


def stored_start(
    record: EvidenceRecord, prepared: PreparedModel, again: InitialStates
) -> InitialStates:
    """Return the stored state; time-dependent controls and holds come from scene and settings."""
    initial = record.initial
    applied = initial.applied or (0.0,) * (6 * prepared.model.nbody)
    rows = (initial.qpos, initial.qvel, initial.ctrl, applied)
    qpos, qvel, ctrl, forces = (np.array([row], dtype=np.float64) for row in rows)
    return again._replace(qpos=qpos, qvel=qvel, ctrl=ctrl, applied=forces)


def _parse_value(scene: Scene, name: str, value: object) -> object:
    spec = scene.catalogue.find_axis(name)
    if spec is None:
        raise StoreError(f"the stored scene has no axis '{name}'")
    try:
        return spec.parse(value)
    except ValueError as error:
        raise StoreError(f"stored axis '{name}': {error}") from error


def _first_difference(
    store: Store, record: EvidenceRecord, rollout: Rollout
) -> tuple[int | None, float | None]:
    if record.trace is None:
        return None, None
    stored = store.trace(record)
    width = stored.qpos.shape[1] + stored.qvel.shape[1]
    old = np.concatenate([stored.qpos, stored.qvel], axis=1)
    new = rollout.state[0, : rollout.steps[0] + 1, 1 : 1 + width]
    rows = min(len(old), len(new))
    differs = np.flatnonzero((old[:rows] != new[:rows]).any(axis=1))
    if len(differs) == 0:
        return None if len(old) == len(new) else rows, None
    first = int(differs[0])
    return first, float(np.abs(old[first] - new[first]).max())


MAX_STEPS = 2_000  # steps that are timed from each start state along a run


def answer_requests(store: Store, lines: Iterator[str]) -> Iterator[dict[str, Any]]:
    """Yield engine and version, then an answer to each line."""
    own = ENGINES[MODEL_ENGINE]
    yield {
        "engine": f"{own.name} {own.version}",
        "timed_engines": [
            engine_class.name
            for engine_class in ENGINES.values()
            if isinstance(engine_class, TimesSteps)
        ],
        "contactlab": version("contactlab"),
    }
    prepared: dict[str, tuple[TimesSteps, Segments]] = {}
    for line in lines:
        request = json.loads(line)
        try:
            run = str(request["run"])
            if run not in prepared:
                # Keep one run only: two processes time the same run, interleaved.
                prepared = {run: timed_run(store, run)}
            engine, segments = prepared[run]
            seconds, steps = engine.time_segments(segments, MAX_STEPS, int(request["repeats"]))
            yield {"seconds": seconds, "steps": steps}
        except ContactlabError as error:
            yield {"error": str(error)}


def timed_run(store: Store, run: str) -> tuple[TimesSteps, Segments]:
    """Return a stored run's engine and segments for timing.

    Raises a ContactlabError if impossible.
    """
    record, scene, resolved = stored_run(store, run)
    engine = engine_of(resolved)
    if not isinstance(engine, TimesSteps):
        raise ContactlabError(f"run {run}: the {resolved.engine} engine does not time its steps")
    start = PreparedRuns.of(scene, resolved).with_recorded_controls([store.controls(record)]).starts
    compiled = scene.written_model(resolved)
    model = scene.prepare(resolved, start, compiled).model
    work = engine.count_work(model, start, resolved.steps)
    if work is None:
        raise ContactlabError(f"run {run} does not complete")
    return engine, Segments(model, start, work)


def main(*fillers: Callable[[], None]) -> None:
    """Answer until the input ends; functions fill the registry."""
    fill_registry(*fillers)
    silence_mujoco()
    gc.disable()
    try:
        for answer in answer_requests(Store.open(Path(sys.argv[1])), iter(sys.stdin.readline, "")):
            sys.stdout.write(json.dumps(answer) + "\n")
            sys.stdout.flush()
    except ContactlabError as error:
        raise SystemExit(f"error: {error}") from error


class TimingProcess:
    """Times runs, stepped by a version of MuJoCo or by other engines; see `timing_process`."""

    def __init__(self, python: Path, requests: IO[str], answers: IO[str]) -> None:
        self._python, self._requests, self._answers = python, requests, answers
        greeting = self._read_answer()
        self.engine = str(greeting["engine"])
        self.timed_engines = frozenset(map(str, greeting["timed_engines"]))

    def time(self, run: str, repeats: int) -> tuple[float, float]:
        """Return the CPU time of all steps that were made of a run, and of one step [s]."""
        with suppress(BrokenPipeError):
            self._requests.write(json.dumps({"run": run, "repeats": repeats}) + "\n")
            self._requests.flush()
        answer = self._read_answer()
        if "error" in answer:
            raise StoreError(f"{self._python} cannot time run {run}: {answer['error']}")
        seconds = float(answer["seconds"])
        return seconds, seconds / int(answer["steps"])

    def _read_answer(self) -> dict[str, Any]:
        try:
            return dict(json.loads(self._answers.readline()))
        except ValueError as error:
            raise PolicyError(
                f"{self._python} does not time runs: is this version of contactlab installed there?"
            ) from error


@contextmanager
def timing_process(python: Path, store: Path) -> Generator[TimingProcess]:
    """Yield a process that times the runs of a store; raise PolicyError if it cannot."""
    fillers = registry_fillers()
    imports = [f"from {each.__module__} import {each.__name__}" for each in (main, *fillers)]
    call = f"{main.__name__}({', '.join(filler.__name__ for filler in fillers)})"
    code = "; ".join([*imports, call])
    command = [str(python), "-P", "-c", code, str(store)]
    try:
        process = subprocess.Popen(  # noqa: S603 - the user's own Python
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
    except OSError as error:
        raise PolicyError(f"cannot run {python}: {error.strerror}") from error
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        yield TimingProcess(python, process.stdin, process.stdout)
    finally:
        # Killing it loses nothing: it only answers requests.
        process.kill()
        process.communicate()
