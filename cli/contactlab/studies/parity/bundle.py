"""A panel as a folder that a script simulates elsewhere; it needs only `newton` and NumPy.

The folder has the models, states and controls of the runs, and the motion of MuJoCo with its noise
floor. The sweep with its scene is for judging the results.
"""

import copy
import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np
from pydantic import ValidationError
from ruamel.yaml import YAML

from contactlab.contact.trace_arrays import Floats
from contactlab.engines import ENGINES
from contactlab.engines.adapted_engine import SERVER, AdaptedEngine, load_adapter
from contactlab.engines.engine import PreparedRuns, Rollout
from contactlab.errors import EngineError, OutputError, StoreError
from contactlab.mjcf import MODEL_ENGINE
from contactlab.plan.overrides import Overrides, drive_option
from contactlab.resources import ADAPTERS, short_hash
from contactlab.scene.model_files import relative_path
from contactlab.schema.strict_model import InnerName, Model
from contactlab.studies.parity.panel import Panel, roll_out
from contactlab.studies.parity.rounding import round_starts, rounded_at_each_step, without_warmstart
from contactlab.studies.parity.run_parity import contact_counts, max_difference, single_step_places
from contactlab.temporary_folders import temporary_folder

ENGINE = "newton"
"""Engine of a bundle; its adapter states the features of that engine."""
_FILE = "bundle.json"


class BundledRun(Model):
    """One run: its model's file, and the options of Newton's solver."""

    id: str
    model: str
    timestep: float
    room: tuple[int, int]  # for contacts, for rows of constraints
    solver: dict[str, bool]


class Bundle(Model):
    """Contents of a folder, and the options of its sweep that make these runs."""

    version: int = 1
    sweep: InnerName
    mujoco: str
    assign: tuple[str, ...]
    only: tuple[str, ...]
    limit: int | None
    drive: str | None
    runs: tuple[BundledRun, ...]
    refused: dict[str, str]  # why runs are left out, by run id

    @classmethod
    def read(cls, folder: Path) -> "Bundle":
        """Read a folder; a StoreError says that it is not a bundle."""
        try:
            return cls.model_validate_json((folder / _FILE).read_bytes())
        except (OSError, ValidationError) as error:
            raise StoreError(f"{folder} has no {_FILE} that `--bundle` wrote") from error

    def panel(self, folder: Path) -> Panel:
        """Return the runs of the sweep in the folder."""
        overrides = Overrides(self.assign, self.only, self.limit)
        path = folder / f"{self.sweep}.yaml"
        return Panel.read(path, ENGINE, overrides, (), drive_option(self.drive))


def write_bundle(panel: Panel, overrides: Overrides, drive: str | None, folder: Path) -> Bundle:
    """Write a panel into a new folder; an OutputError says that it cannot be.

    An EngineError says that Newton can simulate none of its runs.
    """
    if folder.exists():
        raise OutputError(f"{folder} exists; name a new folder")
    with temporary_folder() as temporary:
        new_bundle = Path(temporary) / "bundle"
        for part in ("models", "runs"):
            (new_bundle / part).mkdir(parents=True)
        # Write the sweep with its scene next to it.
        source, request = panel.scene.source, panel.request
        scene_copy = Path("scene") / Path(panel.scene.name).name
        source.content.copy_to(new_bundle / scene_copy)
        path = scene_copy / relative_path(source.path, source.content.root)
        document = YAML(typ="safe", pure=True).load(request.source)
        document["scene"] = f"{path.parent.as_posix()}/" if source.manifest else path.as_posix()
        # JSON is YAML, and has every number in full.
        sweep = new_bundle / f"{request.name}.yaml"
        sweep.write_text(json.dumps(document, indent=2), encoding="utf-8")
        runs, refused = _write_runs(panel, new_bundle)
        if not runs:
            raise EngineError(f"no run can be simulated elsewhere: {next(iter(refused.values()))}")
        bundle = Bundle(
            sweep=panel.request.name,
            mujoco=mujoco.__version__,
            assign=tuple(overrides.assign),
            only=tuple(overrides.where),
            limit=overrides.limit,
            drive=drive,
            runs=tuple(runs),
            refused=refused,
        )
        (new_bundle / _FILE).write_text(bundle.model_dump_json(indent=2), encoding="utf-8")
        if {run.run_id for run in bundle.panel(new_bundle).runs} != {
            run.run_id for run in panel.runs
        }:
            raise OutputError(
                "the sweep depends on files next to it, which a bundle cannot include"
            )
        for script in (ADAPTERS / "bundle").glob("*.py"):
            shutil.copy(script, new_bundle)
        try:
            shutil.copytree(new_bundle, folder)
        except OSError as error:
            raise OutputError(f"cannot write {folder}: {error.strerror or error}") from error
    return bundle


def _write_runs(panel: Panel, folder: Path) -> tuple[list[BundledRun], dict[str, str]]:
    """Write models and runs; return the runs, and why others are left out."""
    engine, serve = ENGINES[ENGINE], load_adapter(SERVER)
    assert isinstance(engine, AdaptedEngine)
    refused = panel.find_refusals(engine.refusal_anywhere)
    bundled_runs: list[BundledRun] = []
    headroom = 2  # factor over MuJoCo's own peak, as its documentation advises
    rows_per_contact = 10  # of constraints that a contact has at most, of condim 6 with a pyramid
    for group in panel.group_runs(refused):
        ours = PreparedRuns.of(panel.scene, *[run.ours for run in group])
        reference = ENGINES[MODEL_ENGINE]
        rollouts = (
            roll_out(reference, ours),
            roll_out(reference, without_warmstart(round_starts(ours))),
        )
        peaks = contact_counts(ours, rollouts[0])
        for run, member in enumerate(group):
            model = copy.copy(ours.models[run])
            model.opt.disableflags = 0  # flags that recording needs; runs with others are refused
            try:
                mjcf = serve.mjcf_of(model)
                arrays = _run_arrays(ours, run, rollouts)
            except ValueError as error:
                refused[member.run_id] = str(error)
                continue
            name = f"models/{short_hash([mjcf])}.xml"
            (folder / name).write_text(mjcf, encoding="utf-8")
            np.savez(folder / "runs" / f"{member.run_id}.npz", allow_pickle=False, **arrays)
            contacts = headroom * max(4, int(peaks[run].max()))
            room = contacts, rows_per_contact * contacts + 2 * model.nv
            # Several contacts of convex shapes: on by default in MuJoCo 4, off in Newton.
            solver = {"enable_multiccd": hasattr(mujoco.mjtDisableBit, "mjDSBL_MULTICCD")}
            step = float(model.opt.timestep)
            bundled_runs.append(
                BundledRun(id=member.run_id, model=name, timestep=step, room=room, solver=solver)
            )
    return bundled_runs, refused


def _run_arrays(ours: PreparedRuns, run: int, rollouts: Sequence[Rollout]) -> Mapping[str, Floats]:
    """Return the arrays of a run: MuJoCo's motion, its noise floor, controls, and single steps."""
    model, steps = ours.models[run], min(rollout.steps[run] for rollout in rollouts)
    inputs = ours.starts.input_rows(run, model.opt.timestep, np.arange(steps))
    if inputs[:, model.nu :].any():
        raise ValueError("the drive applies forces to bodies; use actuators instead")
    if not steps:
        raise ValueError("MuJoCo completes no step of it")
    (qpos, qvel), (around, _) = (
        np.split(rollout.state[run, : steps + 1, 1:], [model.nq, model.nq + model.nv], axis=1)[:2]
        for rollout in rollouts
    )
    single = rounded_at_each_step(ours, run, steps)
    return {
        "qpos": qpos,
        "qvel": qvel,
        "floor": np.maximum(max_difference(qpos, around), max_difference(qpos, single)),
        "ctrl": inputs[:, : model.nu],
        "places": single_step_places(steps),
    }
