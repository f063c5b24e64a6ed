"""An engine that ran elsewhere: results in the folder of a bundle."""

import json
from collections import Counter
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import mujoco
import numpy as np

from contactlab.engines.adapted_engine import SERVER, AdaptedEngine, load_adapter
from contactlab.engines.engine import PreparedRuns, Watch, no_limit
from contactlab.errors import StoreError
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.resources import ADAPTERS
from contactlab.scene.model_xml import check_regular
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.store.table_bounds import check_archive
from contactlab.studies.parity.bundle import ENGINE, Bundle


class BundledEngine(AdaptedEngine):
    """Results of a bundle, instead of a process: of each run twice, then of its single steps.

    Sensor values are measured by MuJoCo in the states of the engine.
    """

    def __init__(self, folder: Path, bundle: Bundle) -> None:
        super().__init__(ADAPTERS / f"{ENGINE}.py")
        self._folder, self._bundle, self._asked = folder, bundle, Counter[str]()
        try:
            about = json.loads((folder / "results" / "engine.json").read_text(encoding="utf-8"))
            names = [str(about[name]) for name in ("engine", "version", "device")]
        except (OSError, ValueError, LookupError, TypeError) as error:
            raise StoreError(
                f"{folder} has no results yet; run its check_newton.py where Newton is"
            ) from error
        self.name, self._version, self.device = names
        self._read: dict[tuple[str, str], dict[str, np.ndarray]] = {}

    @property
    def version(self) -> str:
        """The version that made the results."""
        return self._version

    def refusal(self, scene: Scene, run: RunSpec) -> str | None:
        """Return why the bundle is without a run."""
        return self._bundle.refused.get(scene.run_id(run))

    def ask(
        self,
        runs: PreparedRuns,
        watch: Watch = no_limit,  # noqa: ARG002 - nothing is simulated
        operation: str = "simulate",
        **more: float,  # noqa: ARG002 - as above
    ) -> dict[str, Any] | str:
        """Return the results of whole runs, at first and once more, then of single steps of one."""
        if operation != "simulate":
            return "a bundle has only states"
        ids = [runs.scene.run_id(run) for run in runs.resolved]
        prefix = ("", "again_", "step_")[min(self._asked[ids[0]], 2)]
        self._asked.update(set(ids))
        answers: dict[str, list[Any]] = {"state": [], "sensors": [], "cnstrfull": []}
        for row, run_id in enumerate(ids):
            expected = self._load_arrays("runs", run_id)
            step = int(expected["places"][row]) if prefix == "step_" else 0
            if np.abs(expected["qpos"][step] - runs.starts.qpos[row]).max(initial=0) > SUM_ROUNDING:
                raise StoreError(
                    f"MuJoCo {mujoco.__version__} here makes another run {run_id[:8]} than MuJoCo "
                    f"{self._bundle.mujoco} did where the bundle was written; judge it there"
                )
            try:
                arrays = self._load_arrays("results", run_id)
                states = np.hstack([arrays[f"{prefix}qpos"], arrays[f"{prefix}qvel"]])
                answers["cnstrfull"].append(bool(arrays["full"]))
            except (OSError, ValueError, LookupError) as error:
                return f"no result of run {run_id[:8]}: {' '.join(str(error).split())}"
            if prefix == "step_":
                answers["state"].append(np.stack([states[row], states[row]]))
                answers["sensors"].append(np.zeros((1, runs.base.model.nsensordata)))
                continue
            # A run that MuJoCo did not complete is compared up to its end.
            rest = np.repeat(states[-1:], runs.steps + 1 - len(states), axis=0)
            states = np.concatenate([states, rest])
            answers["state"].append(states)
            model = runs.models[row]
            inputs = runs.starts.input_rows(row, model.opt.timestep, np.arange(runs.steps))
            answers["sensors"].append(
                load_adapter(SERVER).measured(model, states, inputs[:, : model.nu])
            )
        return {name: np.array(values) for name, values in answers.items()} | {
            "cost": np.full(len(ids), np.nan)
        }

    def _load_arrays(self, part: str, run_id: str) -> dict[str, np.ndarray]:
        key = part, run_id
        if key not in self._read:
            path = self._folder / part / f"{run_id}.npz"
            check_regular(path)
            try:
                check_archive(path)
                with np.load(path, allow_pickle=False) as arrays:
                    self._read[key] = dict(arrays)
            except FileNotFoundError:
                raise
            except (OSError, ValueError, EOFError, BadZipFile) as error:
                raise StoreError(f"{path} is not a file of arrays (.npz): {error}") from error
        return self._read[key]
