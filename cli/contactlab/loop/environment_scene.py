"""Environments as the scenes of sweeps: an episode is a run.

The scene is the model that the environment has when it is made, as it was compiled; its file of
Python lies beside it in the store. Code runs only where the user allows it, to find the model and
to play episodes.
"""

import os
import shutil
import site
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco

from contactlab.accuracy.reference import PlannedModel
from contactlab.code_limit import code_limit
from contactlab.engines import PreparedRuns, Rollout
from contactlab.engines.closed_loop import load_code, load_policy
from contactlab.engines.engine import PolicyClass
from contactlab.errors import SceneError, SweepFileError, in_one_line, install_command
from contactlab.loop.player import Player
from contactlab.loop.recording import lacking_checks
from contactlab.loop.simulation import bare, simulation
from contactlab.run.mujoco_environment import PACKAGES
from contactlab.scene.run_spec import START_SETTINGS, RunSpec
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import BINARY, MANIFEST, SceneSource, stored_scene
from contactlab.schema.drive import ObservationNoise, PolicyDrive, drive_files
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.scene_manifest import SceneManifest
from contactlab.schema.strict_model import is_inner_name
from contactlab.schema.sweep_schema import Sweep
from contactlab.store.table_layout import LOOP_COLUMNS

_CODE = ".py:"
_MODEL = f"model{BINARY}"
_USUAL_DURATION = 2.0  # of an environment that says nothing of its length [s]
_OTHERS_TO_SAY = ("initial", "structure", "control", "recording", "perturb", "keyframe")
_ASK_AGAIN = ("knife_edge", "accuracy", "timing")
_opened: list[TemporaryDirectory[str]] = []  # removed when the process ends


@dataclass(frozen=True)
class Environment:
    """Maker of an environment: FILE.py:FACTORY, relative to a folder, or an id of Gymnasium."""

    name: str
    folder: Path
    columns = LOOP_COLUMNS  # of the table of its runs, besides those of all sweeps

    @property
    def files(self) -> tuple[Path, ...]:
        """Its file of Python, if it has one."""
        file, code, _ = self.name.rpartition(_CODE)
        return (self.folder / Path(f"{file}.py").expanduser(),) if code else ()

    def open(self, said: SceneManifest | None, allowed: bool) -> SceneSource:
        """Make the environment, and return the scene of its model, given what a manifest says.

        Raises a SceneError if its code is not allowed, or fails, or steps no MuJoCo.
        """
        if not allowed:
            raise SceneError(
                f"environment {self.name} is Python code, which runs only in a sweep that allows "
                "it: `contactlab sweep FILE --allow-code`, or allow_code=True in Python; studies, "
                "such as tradeoff and tune, need steps of MuJoCo's own"
            )
        if said and (others := [option for option in _OTHERS_TO_SAY if getattr(said, option)]):
            raise SceneError(f"{others[0]}: the environment {self.name} has its own; leave it out")
        env = self.make()
        try:
            model, _ = simulation(bare(env))
        except SceneError as error:
            raise SceneError(f"environment {self.name}: {error}") from error
        kept = TemporaryDirectory(prefix="contactlab-")
        _opened.append(kept)
        folder = Path(kept.name)
        mujoco.mj_saveModel(model, str(folder / _MODEL))
        self._write(folder, said or _usual(self.name, env))
        name = self.files[0].stem if self.files else self.name.replace("/", "-")
        return replace(stored_scene(folder, _MODEL, name), environment=self)

    def _write(self, folder: Path, said: SceneManifest) -> None:
        """Write the manifest of a scene, and the files that it names, beside its model."""
        for file in self.files:
            shutil.copyfile(file, folder / file.name)
        for beside in drive_files(said.drive):
            if not is_inner_name(beside):
                raise SceneError(f"drive: {beside} is not below the folder of the manifest")
            (folder / beside).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(self.folder / beside, folder / beside)
        named = Path(self.name).name if self.files else self.name
        effects = {**said.effects, "base": "all"}
        fixed = {"model": _MODEL, "environment": named, "effects": effects}
        manifest = said.model_copy(update=fixed)
        text = manifest.model_dump_json(indent=2, by_alias=True, exclude_defaults=True)
        (folder / MANIFEST).write_text(text, encoding="utf-8")

    def make(self) -> Any:  # noqa: ANN401 - whatever it is
        """Return the environment, by its code; a SceneError says why there is none."""
        if folder := os.environ.get(PACKAGES):  # What both have is this Python's, as its MuJoCo.
            site.addsitedir(folder)
        try:
            with redirect_stdout(sys.stderr), code_limit():
                return self._factory()()
        except SceneError:
            raise
        except (Exception, SystemExit) as error:
            what = f"environment {self.name}: {in_one_line(error, __file__)}"
            raise SceneError(what) from error

    def _factory(self) -> Callable[[], Any]:
        if not self.files:
            try:
                import gymnasium  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - an extra
            except ModuleNotFoundError as error:
                raise SceneError(
                    f"environment {self.name} is an id of Gymnasium, which is not installed; "
                    f"{install_command('gymnasium')}, or write FILE.py:FACTORY"
                ) from error
            return lambda: gymnasium.make(self.name)
        if not self.files[0].is_file():
            raise SceneError(f"environment {self.name}: there is no file {self.files[0]}")
        return load_code("environment", self.files[0], self.name.rpartition(_CODE)[2])

    def refusal(self, run: RunSpec) -> str | None:
        """Return why an episode cannot be such a run; None if it can."""
        drive = run.drive
        if isinstance(drive, PolicyDrive):
            if drive.latency_seconds or drive.noise != ObservationNoise():
                return "a policy has no latency or noise in an environment; leave them out"
        elif drive != "none":
            return (
                "an environment takes actions of a policy, or of its own action_space; write "
                "`drive: {policy: FILE.py:CLASS}`, or leave `drive` out"
            )
        for name in sorted(run.changed & {*START_SETTINGS}):
            return f"{name}: an environment starts as its reset(seed=...) says; leave it out"
        for name in sorted(run.changed & run.without):
            return f"{name}: the model of an environment is compiled with it; leave it out"
        return None

    def lacking(self, sweep: Sweep) -> Mapping[str, str]:
        """Return what is null in its records, and why; a SweepFileError if the sweep wants it."""
        for name in _ASK_AGAIN:
            if getattr(sweep, name):
                raise SweepFileError(f"{name} needs steps of MuJoCo's own, not of an environment")
        return lacking_checks(
            "only the environment's own code makes its steps", "an episode takes its own time"
        )

    def seconds_per_step(self, runs: PreparedRuns) -> float:
        """Return what MuJoCo alone takes for a step [s], from where its model begins."""
        (model,) = runs.models
        begin = time.thread_time()
        mujoco.mj_step(model, mujoco.MjData(model), nstep=runs.steps)
        return (time.thread_time() - begin) / runs.steps

    def player(self, scene: Scene, policy: PolicyClass | None) -> Player:
        """Return what plays its episodes; by the store's copy of its file if that is not here."""
        here = self if all(file.is_file() for file in self.files) else scene.source.environment
        copies = scene.source.environment.files
        for file, copy in zip(here.files, copies, strict=True):
            if file.read_bytes() != copy.read_bytes():
                raise SceneError(f"environment {file} is not what it was when the sweep began")
        return Player(scene, here.make, policy)

    def again(self, record: EvidenceRecord, runs: PreparedRuns, allowed: bool) -> Rollout:
        """Return the episode of a stored run, played again; a SceneError if that is not allowed."""
        if not allowed:
            raise SceneError(
                f"run {record.run_id} is an episode of {self.name}, which is Python code and is "
                "repeated only if you allow it; add --allow-code"
            )
        drive = runs.scene.drive
        policy = load_policy(drive) if isinstance(drive.drive, PolicyDrive) else None
        run = replace(runs.resolved[0], index=record.index, run_id=record.run_id)
        plan = PlannedModel(run, runs.prepared[0], runs.starts)
        rollout = self.player(runs.scene, policy).play(plan).rollout
        if (error := rollout.errors[0]) is not None:
            raise SceneError(f"run {record.run_id}: {error}")
        return rollout


def _usual(name: str, env: Any) -> SceneManifest:  # noqa: ANN401 - as above
    """Return what is said of an environment that has no manifest."""
    most = getattr(getattr(env, "spec", None), "max_episode_steps", None)
    step = getattr(bare(env), "dt", None)
    long = float(most * step) if most and step else _USUAL_DURATION
    about = {"title": name, "description": "Episodes of an environment."}
    return SceneManifest.model_validate({"version": 1, **about, "duration": long})
