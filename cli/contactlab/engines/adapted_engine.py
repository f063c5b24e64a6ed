"""Engines in separate environments: adapters, the processes that run them, and arrays between.

An adapter is a file of the folder `adapters` that does not import contactlab. Its docstring names
the engine. PACKAGE is the package with the version, REQUIREMENTS the packages for pip, with
`{mujoco}` for this MuJoCo's version, and ENVIRONMENT the engine with the shared environment, if it
has no separate one. `refusal(model)` is called here, without the engine; `simulate(request, tick)`
runs in the environment: for n runs of N steps it returns the arrays `state`
(n, N + 1, nq + nv + na), `sensors` (n, N, nsensordata), `cost` (n,) [s], and optionally
`iterations` of its solver (n, N), and `contactfull` and `cnstrfull` (n,), which tell that memory
was short. The optional `forward(request, tick)` returns (n) quantities of the n starts, named as in
MuJoCo's data; the optional `derivative` the derivative of ends. DEVICES are the words that the
request's `device` may have, which is empty otherwise. IGNORED names settings and effects that an
engine ignores, with reasons. OWN_LAWS and CONTROLS_ERROR are an engine's `own_laws` and
`controls_error`.
"""

import os
import pickle
import select
import subprocess
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from importlib.metadata import distributions
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from contactlab.engines.engine import (
    ENGINES,
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
from contactlab.errors import EngineError
from contactlab.resources import ADAPTERS, short_hash, user_cache
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene

SERVER = ADAPTERS / "serve.py"
"""Script that runs adapters, with the code that they share."""


def load_adapter(file: Path) -> Any:  # noqa: ANN401 - a module that is known by its path only
    """Return an adapter, or the code that adapters share, as a module."""
    spec = spec_from_file_location(f"contactlab_adapter_{file.stem}", file)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class AdaptedEngine(SimulationEngine):
    """An engine that an adapter drives in another process."""

    def __init__(self, file: Path, device: str = "") -> None:
        self._adapter = load_adapter(file)
        self._file, self._device = file, device
        self.name, self.summary = file.stem, self._adapter.__doc__.rstrip(".")
        self.own_laws = getattr(self._adapter, "OWN_LAWS", True)
        self.controls_error = getattr(self._adapter, "CONTROLS_ERROR", False)

    @property
    def requirements(self) -> list[str]:
        """Packages of its environment, in pip's form."""
        return [
            requirement.format(mujoco=mujoco.__version__)
            for requirement in self._adapter.REQUIREMENTS
        ]

    @property
    def environment(self) -> Path:
        """The folder of its environment, which may not exist."""
        name = getattr(self._adapter, "ENVIRONMENT", self.name)
        return user_cache() / f"{name}-{short_hash(self.requirements)}"

    @property
    def _python_place(self) -> Path:
        return self.environment / "bin" / "python"

    @property
    def version(self) -> str:
        """The installed version; empty if none is installed, or its Python is gone."""
        if not self._python_place.exists():
            return ""
        folders = [str(folder) for folder in self.environment.glob("lib/python*/site-packages")]
        packages = distributions(name=self._adapter.PACKAGE, path=folders) if folders else ()
        return next((distribution.version for distribution in packages), "")

    @property
    def size(self) -> int:
        """Disk space of its environment [bytes]; 0 if it is not installed."""
        files = self.environment.rglob("*")
        return sum(file.lstat().st_size for file in files if not file.is_dir())

    @property
    def absence(self) -> str:
        """Why it is not installed, and the command that adds it; empty if it is installed."""
        add = f"install it once with `contactlab parity --install {self.name}`"
        return "" if self.version else f"the {self.name} engine is not installed; {add}"

    def refusal(self, scene: Scene, run: RunSpec) -> str | None:
        """Return why it cannot simulate a run: it is not installed, or the adapter refuses."""
        return self.absence or self.refusal_anywhere(scene, run)

    def refusal_anywhere(self, scene: Scene, run: RunSpec) -> str | None:
        """Return why it could not simulate a run even if it were installed; None if it could."""
        if why := self._adapter.refusal(scene.base_of(run).prepare(run.list_edits()).model):
            return f"the {self.name} engine cannot simulate this: {why}"
        return super().refusal(scene, run)

    def ignored(self, run: RunSpec) -> Mapping[str, str]:  # noqa: ARG002 - of all runs alike
        """Return settings and effects that it ignores, with reasons, from the adapter."""
        return getattr(self._adapter, "IGNORED", {})

    def roll_out(
        self,
        runs: PreparedRuns,
        buffers: Buffers,
        watch: Watch = no_limit,
        proceed: Proceed = proceed_always,  # noqa: ARG002 - all runs go through together
    ) -> Rollout:
        """Simulate runs in the adapter's process."""
        count = len(runs.prepared)
        arrays = buffers.arrays(runs.base.model, count, runs.steps)
        arrays.iterations[:] = 0
        record_starts(runs.starts, arrays)
        answer = self.ask(runs, watch)
        if isinstance(answer, str):
            arrays.state[:, 1:], arrays.sensors[:] = arrays.state[:, :1], 0.0
            failed = Rollout.completed(arrays, np.full(count, np.nan))
            return replace(failed, errors=(answer,) * count, steps=(0,) * count)
        arrays.state[:, 1:, 1:] = answer["state"][:, 1:]
        timesteps = np.array([model.opt.timestep for model in runs.models])
        # A clock in single precision would drift.
        arrays.state[:, :, 0] = timesteps[:, None] * np.arange(runs.steps + 1)
        arrays.sensors[:] = answer["sensors"]
        arrays.iterations[:, :, 0] = answer.get("iterations", 0)
        rollout = Rollout.completed(arrays, answer["cost"])
        full = {name: answer[name] for name in ("contactfull", "cnstrfull") if name in answer}
        warnings = [{name: 1 for name in full if full[name][run]} for run in range(count)]
        return replace(rollout, warnings=tuple(warnings))

    def on(self, device: str) -> "AdaptedEngine":
        """Return the engine computing on a device. Raises an EngineError if it cannot."""
        devices = getattr(self._adapter, "DEVICES", ("cpu",))
        EngineError.unless_known(
            device, devices, f"the {self.name} engine has no device '{device}'"
        )
        return type(self)(self._file, device)

    @property
    def goes_forward(self) -> bool:
        """Whether it reports quantities that it computes from states before a step."""
        return hasattr(self._adapter, "forward")

    def ask(
        self,
        runs: PreparedRuns,
        watch: Watch = no_limit,
        operation: str = "simulate",
        **more: float,
    ) -> dict[str, Any] | str:
        """Return the answer of the adapter's function for runs, or an error message."""
        starts, places = runs.starts, runs.starts.driven_inputs
        steps = np.arange(runs.steps)
        width = sum(inputs.shape[1] for inputs in (starts.ctrl, starts.applied, starts.mocap))
        levels = [
            starts.input_rows(run, model.opt.timestep, steps, width)[:, places]
            for run, model in enumerate(runs.models)
        ]
        arrays = ("qpos", "qvel", "ctrl", "applied", "act", "mocap")
        # Models go as MuJoCo's binaries; runs of one model share one.
        binaries = {
            id(model): _model_binary(model)
            for model in {id(shared): shared for shared in runs.models}.values()
        }
        request = {
            "operation": operation,
            "device": self._device,
            **more,
            "models": [binaries[id(model)] for model in runs.models],
            "steps": runs.steps,
            "places": places,
            "levels": np.array(levels),
            **{name: getattr(starts, name) for name in arrays},
        }
        return self._process.ask(request, watch)

    @cached_property
    def _process(self) -> "_EngineProcess":
        if self.absence:
            raise EngineError(self.absence)
        command = [str(self._python_place), "-P", str(SERVER), str(self._file)]
        return _EngineProcess(self.name, command)


class _EngineProcess:
    """A process that answers requests; it ends with this one, or when it fails."""

    def __init__(self, name: str, command: Sequence[str]) -> None:
        self._name, self._command = name, command
        self._process: subprocess.Popen[bytes] | None = None

    def ask(self, request: Mapping[str, object], tick: Callable[[], None]) -> dict[str, Any] | str:
        """Return the answer to a request, or an error message; call back as work gets done."""
        process = self._process or self._start_process()
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            pickle.dump(request, process.stdin, protocol=5)
            process.stdin.flush()
            setup_limit_s = 900.0  # longest time for compiling and making the first step [s]
            if not select.select([process.stdout], [], [], setup_limit_s)[0]:
                raise TimeoutError(f"no step was made within {setup_limit_s:g} s")
            while (answer := pickle.load(process.stdout)) is None:  # noqa: S301 - from our process
                tick()
        except (EOFError, OSError, pickle.UnpicklingError) as error:
            self._process = None
            code = _end_process(process)
            reason = str(error) if isinstance(error, TimeoutError) else f"exit code {code}"
            return f"the {self._name} process failed: {reason}"
        return answer

    def _start_process(self) -> subprocess.Popen[bytes]:
        # Its output would be mixed with this command's, and its messages about kernels are useless.
        self._process = subprocess.Popen(  # noqa: S603
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={name: text for name, text in os.environ.items() if name != "PYTHONPATH"},
        )
        weakref.finalize(self, _end_process, self._process)
        return self._process


def _end_process(process: subprocess.Popen[bytes]) -> int:
    for pipe in (process.stdin, process.stdout):
        with suppress(OSError):
            assert pipe is not None
            pipe.close()
    with suppress(subprocess.TimeoutExpired):
        return process.wait(1)
    process.kill()
    return process.wait()


def _model_binary(model: mujoco.MjModel) -> bytes:
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def adapted_engines() -> list[AdaptedEngine]:
    """Return an engine for each adapter, whether or not it is installed."""
    files = sorted(ADAPTERS.glob("*.py"))
    return [AdaptedEngine(file) for file in files if file != SERVER]


for _engine in adapted_engines():
    ENGINES.add(_engine)
