"""An engine that ran elsewhere: the results that lie in a bundle's folder."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from contactlab.engines.adapted_engine import SERVER, load_adapter
from contactlab.engines.engine import (
    Buffers,
    PreparedRuns,
    Proceed,
    Rollout,
    SimulationEngine,
    Watch,
    no_limit,
    proceed_always,
)
from contactlab.engines.mujoco_batch import record_starts
from contactlab.errors import StoreError
from contactlab.scene.resolution import ResolvedRun
from contactlab.scene.scene import Scene
from contactlab_parity.bundle import Bundle

_SAME = 1e-9  # difference of MuJoCo's own coordinates from those in the bundle [m or rad]


class BundledEngine(SimulationEngine):
    """Results of a bundle, which it gives for the runs in it: of each run twice, and single steps.

    What sensors measure, MuJoCo measures in its states.
    """

    def __init__(self, folder: Path, bundle: Bundle) -> None:
        self._folder, self._bundle, self._asked = folder, bundle, Counter[str]()
        self._results: dict[str, dict[str, np.ndarray]] = {}
        try:
            about = json.loads((folder / "results" / "engine.json").read_text(encoding="utf-8"))
            names = [str(about[name]) for name in ("engine", "version", "device")]
        except (OSError, ValueError, LookupError, TypeError) as error:
            raise StoreError(
                f"{folder} has no results yet; run its check_newton.py where Newton is"
            ) from error
        self.name, self._version, self.device = names
        self.summary = f"results in {folder}"

    @property
    def version(self) -> str:
        """The version that made the results."""
        return self._version

    def refusal(self, scene: Scene, run: ResolvedRun) -> str | None:
        """Return why the bundle is without a run."""
        return self._bundle.refused.get(scene.run_id(run))

    def roll_out(
        self,
        runs: PreparedRuns,
        buffers: Buffers,
        watch: Watch = no_limit,  # noqa: ARG002 - nothing is simulated
        proceed: Proceed = proceed_always,  # noqa: ARG002 - as above
    ) -> Rollout:
        """Return the results of whole runs, at first and once more, then of single steps of one."""
        ids = [runs.scene.run_id(each) for each in runs.resolved]
        asked = min(self._asked[ids[0]], 2)
        self._asked.update(set(ids))
        arrays = buffers.arrays(runs.base.model, len(ids), runs.steps)
        arrays.iterations[:], arrays.sensors[:], arrays.state[:] = 0, 0.0, 0.0
        record_starts(runs.starts, arrays)
        ends: list[tuple[int, dict[str, int], str | None]] = []
        for row, run_id in enumerate(ids):
            try:
                told = self._result(run_id)
                self._check_start(run_id, runs.starts.qpos[row], row if asked == 2 else None)
                if asked == 2:
                    after = np.concatenate([told["step_qpos"][row], told["step_qvel"][row]])
                    arrays.state[row, 1, 1:] = after
                    steps = 1
                else:
                    prefix = ("", "again_")[asked]
                    states = np.hstack([told[f"{prefix}qpos"], told[f"{prefix}qvel"]])
                    steps = len(states) - 1
                    arrays.state[row, : steps + 1, 1:] = states
                    arrays.sensors[row, :steps] = _measured(runs, row, states)
                ends.append((steps, {"cnstrfull": 1} if told["full"] else {}, None))
            except (OSError, ValueError, LookupError) as error:
                ends.append((0, {}, f"no result of it: {' '.join(str(error).split())}"))
        timesteps = np.array([model.opt.timestep for model in runs.models])
        arrays.state[:, :, 0] = timesteps[:, None] * np.arange(runs.steps + 1)
        made, warnings, errors = zip(*ends, strict=True)
        completed = Rollout.completed(arrays, np.full(len(ids), np.nan))
        return replace(completed, steps=made, warnings=warnings, errors=errors)

    def _result(self, run_id: str) -> dict[str, np.ndarray]:
        if run_id not in self._results:
            with np.load(self._folder / "results" / f"{run_id}.npz") as told:
                self._results = {run_id: dict(told)}
        return self._results[run_id]

    def _check_start(self, run_id: str, qpos: np.ndarray, place: int | None) -> None:
        """Refuse to judge single steps, or a run, from other states than MuJoCo has here."""
        with np.load(self._folder / "runs" / f"{run_id}.npz") as expected:
            step = 0 if place is None else int(expected["places"][place])
            if np.abs(expected["qpos"][step] - qpos).max(initial=0) <= _SAME:
                return
        raise StoreError(
            f"MuJoCo {mujoco.__version__} here makes another run {run_id[:8]} than MuJoCo "
            f"{self._bundle.mujoco} did where the bundle was written; judge it there"
        )


def _measured(runs: PreparedRuns, run: int, states: np.ndarray) -> np.ndarray:
    model = runs.models[run]
    inputs = runs.starts.inputs(run, model.opt.timestep, np.arange(len(states) - 1))
    return load_adapter(SERVER).measured(model, states, inputs[:, : model.nu])
