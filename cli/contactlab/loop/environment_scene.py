"""Environments as the scenes of sweeps: an episode is a run.

The scene is the compiled model of the environment at its creation; its Python file is stored next
to it. Code runs only where the user allows it, to find the model and to play episodes.
"""

import os
import shutil
import site
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco

from contactlab.accuracy.reference import PlannedModel
from contactlab.engines import PreparedRuns, Rollout
from contactlab.engines.closed_loop import load_code, load_policy
from contactlab.engines.engine import PolicyClass
from contactlab.errors import SceneError, SweepFileError, in_one_line, install_command, no_file
from contactlab.foreign_code import ends_command, limited_code
from contactlab.loop.player import Player
from contactlab.loop.recording import lacking_checks
from contactlab.loop.simulation import find_simulation, unwrap_environment
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
from contactlab.temporary_folders import temporary_folder

_CODE_SUFFIX = ".py:"
_MODEL_FILE = f"model{BINARY}"
_FIXED_OPTIONS = ("initial", "structure", "control", "recording", "perturb", "keyframe")
_REPEATING_OPTIONS = ("knife_edge", "accuracy", "timing")
_scene_folders: list[TemporaryDirectory[str]] = []  # removed when the process ends


@dataclass(frozen=True)
class Environment:
    """Maker of an environment: FILE.py:FACTORY, relative to a folder, or an id of Gymnasium."""

    name: str
    folder: Path
    columns = LOOP_COLUMNS  # of the table of its runs, in addition to those of all sweeps

    @property
    def files(self) -> tuple[Path, ...]:
        """Its Python file, if it has one."""
        file, code, _ = self.name.rpartition(_CODE_SUFFIX)
        return (self.folder / Path(f"{file}.py").expanduser(),) if code else ()

    def open(self, given_manifest: SceneManifest | None, allowed: bool) -> SceneSource:
        """Create the environment, and return the scene of its model and of a manifest, if any.

        Raises a SceneError if its code is not allowed, fails, or does not step MuJoCo.
        """
        if self.name.endswith(_CODE_SUFFIX[:-1]):
            raise SceneError(f"environment {self.name}: write {self.name}:FACTORY, its function")
        for file in self.files:
            if not file.is_file():
                raise SceneError(f"environment {self.name}: {no_file(file, 'file', {'.py'})}")
        if not allowed:
            raise SceneError(
                f"environment {self.name} is Python code, which runs only if you allow it: add "
                "--allow-code to `success` or `sweep`, or allow_code=True in Python; other "
                "commands take models that MuJoCo alone steps"
            )
        if given_manifest and (
            fixed := [option for option in _FIXED_OPTIONS if getattr(given_manifest, option)]
        ):
            raise SceneError(
                f"{fixed[0]}: the environment {self.name} sets it; remove it from the manifest"
            )
        env = self.make_environment()
        try:
            model, _ = find_simulation(unwrap_environment(env))
        except SceneError as error:
            raise SceneError(f"environment {self.name}: {error}") from error
        temporary = temporary_folder()
        _scene_folders.append(temporary)
        folder = Path(temporary.name)
        mujoco.mj_saveModel(model, str(folder / _MODEL_FILE))
        self._write_manifest(folder, given_manifest or _default_manifest(self.name, env))
        name = self.files[0].stem if self.files else self.name.replace("/", "-")
        return replace(stored_scene(folder, _MODEL_FILE, name), environment=self)

    def _write_manifest(self, folder: Path, declared: SceneManifest) -> None:
        for file in self.files:
            shutil.copyfile(file, folder / file.name)
        for drive_file in drive_files(declared.drive):
            if not is_inner_name(drive_file):
                raise SceneError(f"drive: {drive_file} is not below the folder of the manifest")
            (folder / drive_file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(self.folder / drive_file, folder / drive_file)
        environment_name = Path(self.name).name if self.files else self.name
        effects = {**declared.effects, "base": "all"}
        fixed = {"model": _MODEL_FILE, "environment": environment_name, "effects": effects}
        manifest = declared.model_copy(update=fixed)
        text = manifest.model_dump_json(indent=2, by_alias=True, exclude_defaults=True)
        (folder / MANIFEST).write_text(text, encoding="utf-8")

    def make_environment(self) -> Any:  # noqa: ANN401 - whatever it is
        """Return the environment from its code; raise a SceneError if that fails."""
        if folder := os.environ.get(PACKAGES):  # Packages of this Python, as its MuJoCo, go first.
            site.addsitedir(folder)
        try:
            with limited_code():
                return self._load_factory()()
        except SceneError:
            raise
        except BaseException as error:
            if ends_command(error):
                raise
            message = f"environment {self.name}: {in_one_line(error, __file__)}"
            raise SceneError(message) from error

    def _load_factory(self) -> Callable[[], Any]:
        if not self.files:
            try:
                import gymnasium  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - an extra
            except ModuleNotFoundError as error:
                raise SceneError(
                    f"environment {self.name} is an id of Gymnasium, which is not installed; "
                    f"{install_command('gymnasium')}, or write FILE.py:FACTORY"
                ) from error
            return lambda: gymnasium.make(self.name)
        return load_code("environment", self.files[0], self.name.rpartition(_CODE_SUFFIX)[2])

    def refusal(self, run: RunSpec) -> str | None:
        """Return the reason why an episode cannot be such a run; None if it can."""
        drive = run.drive
        if isinstance(drive, PolicyDrive):
            if drive.latency_seconds or drive.noise != ObservationNoise():
                return "a policy has no latency or noise in an environment; remove them"
        elif drive != "none":
            return (
                "an environment takes actions of a policy, or of its own action_space; write "
                "`drive: {policy: FILE.py:CLASS}`, or remove `drive`"
            )
        for name in (*sorted(run.changed_settings & {*START_SETTINGS}), *run.initial):
            return f"{name}: reset(seed=...) sets the start of an environment; remove {name}"
        for name in sorted(run.changed_settings & run.without):
            return f"{name}: the model of an environment is already compiled; remove {name}"
        return None

    def missing_fields(self, sweep: Sweep) -> Mapping[str, str]:
        """Return null fields of its records with reasons; a SweepFileError if one is needed."""
        for name in _REPEATING_OPTIONS:
            if getattr(sweep, name):
                raise SweepFileError(f"{name} needs steps of MuJoCo's own, not of an environment")
        return lacking_checks(
            "only the environment's own code makes its steps",
            "the duration of an episode depends on the environment's own code",
        )

    def seconds_per_step(self, runs: PreparedRuns) -> float:
        """Return MuJoCo's own time for a step [s], from the initial state of its model."""
        (model,) = runs.models
        begin = time.thread_time()
        mujoco.mj_step(model, mujoco.MjData(model), nstep=runs.steps)
        return (time.thread_time() - begin) / runs.steps

    def player(self, scene: Scene, policy: PolicyClass | None) -> Player:
        """Return the player of its episodes; it uses the store's copy of a missing file."""
        here = self if all(file.is_file() for file in self.files) else scene.source.environment
        copies = scene.source.environment.files
        for file, copy in zip(here.files, copies, strict=True):
            if file.read_bytes() != copy.read_bytes():
                raise SceneError(f"environment {file} has changed since the sweep began")
        return Player(scene, here.make_environment, policy)

    def replay_episode(self, record: EvidenceRecord, runs: PreparedRuns, allowed: bool) -> Rollout:
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


def _default_manifest(name: str, env: Any) -> SceneManifest:  # noqa: ANN401 - as above
    own = unwrap_environment(env)
    # Those of robosuite have the other names.
    most, step = (
        next(
            (
                name_of_holder
                for holder, word in names
                if (name_of_holder := getattr(holder, word, None))
            ),
            None,
        )
        for names in (
            ((getattr(env, "spec", None), "max_episode_steps"), (own, "horizon")),
            ((own, "dt"), (own, "control_timestep")),
        )
    )
    default_duration = 2.0  # of an environment without a known length [s]
    seconds = float(most * step) if most and step else default_duration
    about = {"title": name, "description": "Episodes of an environment."}
    return SceneManifest.model_validate({"version": 1, **about, "duration": seconds})
