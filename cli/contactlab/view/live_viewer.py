"""A run in MuJoCo's interactive viewer."""

import time
import warnings

import mujoco
import numpy as np

from contactlab.errors import SceneError
from contactlab.scene.initial_states import InitialStates, apply_inputs


def open_viewer(model: mujoco.MjModel, start: InitialStates) -> None:
    """Simulate from an initial state in MuJoCo's viewer, in real time, until it is closed.

    Raises:
        SceneError: there is no display.
    """
    import glfw  # noqa: PLC0415 - it looks for a display

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # Checked beforehand: without a display, MuJoCo's viewer ends the process.
        has_display = bool(glfw.init())
    if not has_display:
        raise SceneError("no display for the viewer; replay without --view")
    import mujoco.viewer  # noqa: PLC0415 - it looks for a display

    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = start.qpos[0], start.qvel[0], start.ctrl[0]
    data.xfrc_applied[:] = start.applied[0].reshape(-1, 6)
    data.act[:] = start.act[0]
    try:
        window = mujoco.viewer.launch_passive(model, data)
    except (RuntimeError, OSError) as error:
        raise SceneError(f"no viewer: {error}; replay without --view checks the run") from error
    with window:
        while window.is_running():
            tick = time.perf_counter()
            _drive(model, data, start)
            mujoco.mj_step(model, data)
            window.sync()
            time.sleep(max(0.0, model.opt.timestep - (time.perf_counter() - tick)))


def _drive(model: mujoco.MjModel, data: mujoco.MjData, start: InitialStates) -> None:
    """Set the inputs that change over time; the others are the user's."""
    step = np.array([round(data.time / model.opt.timestep)])
    inputs = start.inputs(0, model.opt.timestep, step)[0]
    own = np.concatenate(
        [part.ravel() for part in (data.ctrl, data.xfrc_applied, data.mocap_pos, data.mocap_quat)]
    )
    own[start.driven] = inputs[start.driven]
    apply_inputs(model, data, own)
