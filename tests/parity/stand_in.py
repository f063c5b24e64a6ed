"""An adapter that needs only MuJoCo, with one defect of what CONTACTLAB_DEFECT names."""

import os
import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

PACKAGE = "mujoco"
REQUIREMENTS = ("mujoco=={mujoco}",)
_TILT = np.deg2rad(0.5)


def refusal(model: mujoco.MjModel) -> str | None:
    """Return why it cannot simulate a model."""
    pgs = model.opt.solver == mujoco.mjtSolver.mjSOL_PGS
    return "it has no PGS; set solver to Newton or CG" if pgs else None


def simulate(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    if _defect() == "crash":
        raise RuntimeError("planted")
    runs = [_run(request, run, tick) for run in range(len(request["models"]))]
    return {key: np.array([each[key] for each in runs]) for key in runs[0]}


def forward(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    import serve  # pyright: ignore[reportMissingImports]

    told: dict[str, list[np.ndarray]] = {name: [] for name in (*serve.FORWARD, "contacts")}
    for run in range(len(request["models"])):
        model, data = _start(request, run)
        mujoco.mj_forward(model, data)
        for name in serve.FORWARD:
            told[name].append(np.array(getattr(data, name)))
        told["contacts"].append(serve.contact_rows(data.contact))
    tick()
    return told


def _defect() -> str:
    return os.environ.get("CONTACTLAB_DEFECT", "")


def _start(request: dict[str, Any], run: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    import serve  # pyright: ignore[reportMissingImports]

    model = serve.model_of(request, run)
    if _defect() == "friction":
        model.geom_friction *= 1.05
        model.pair_friction *= 1.05
    if _defect() == "contact":
        model.geom_contype[-1] = model.geom_conaffinity[-1] = 0
    if _defect() == "gravity":
        x, y, z = model.opt.gravity
        model.opt.gravity[:] = x - z * np.sin(_TILT), y, z * np.cos(_TILT)
    return model, serve.start_of(request, run, model)


def _run(request: dict[str, Any], run: int, tick: Callable[[], None]) -> dict[str, Any]:
    import serve  # pyright: ignore[reportMissingImports]

    model, data = _start(request, run)
    controls, forces, _ = serve.inputs_of(request, run, model)
    if _defect() == "late":
        controls = np.concatenate([controls[:1], controls[:-1]])
    half, most, full = _defect() == "buffer", _peak(request, run) // 2, False
    states = [np.concatenate([data.qpos, data.qvel, data.act])]
    sensors, begin = np.zeros((len(controls), model.nsensordata)), time.process_time()
    for step, control in enumerate(controls):
        data.ctrl[:], data.xfrc_applied[:] = control, forces[step]
        mujoco.mj_step(model, data)
        full |= half and data.ncon > most
        sensors[step] = data.sensordata
        states.append(np.concatenate([data.qpos, data.qvel, data.act]))
    tick()
    cost = time.process_time() - begin
    return {"state": np.array(states), "sensors": sensors, "cost": cost, "contactfull": full}


def _peak(request: dict[str, Any], run: int) -> int:
    import serve  # pyright: ignore[reportMissingImports]

    model = serve.model_of(request, run)
    data, most = serve.start_of(request, run, model), 0
    for control in serve.inputs_of(request, run, model)[0]:
        data.ctrl[:] = control
        mujoco.mj_step(model, data)
        most = max(most, data.ncon)
    return most
