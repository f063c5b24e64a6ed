"""Watch a run in MuJoCo's own viewer."""

import time

import mujoco

from contactlab.errors import SceneError
from contactlab.trace import Floats


def view(model: mujoco.MjModel, qpos: Floats, qvel: Floats) -> None:
    """Open MuJoCo's viewer and play from a start state, in real time, until it is closed.

    Raises:
        SceneError: there is no display.
    """
    import mujoco.viewer  # noqa: PLC0415 - it looks for a display

    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, qvel
    try:
        window = mujoco.viewer.launch_passive(model, data)
    except (RuntimeError, OSError) as error:
        raise SceneError(f"no viewer: {error}; replay without --view checks the run") from error
    with window:
        while window.is_running():
            tick = time.perf_counter()
            mujoco.mj_step(model, data)
            window.sync()
            time.sleep(max(0.0, model.opt.timestep - (time.perf_counter() - tick)))
