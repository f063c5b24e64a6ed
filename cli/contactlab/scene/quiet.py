"""Keep the engine's own log to itself."""

import mujoco


def quiet() -> None:
    """Keep the engine from writing MUJOCO_LOG.TXT and messages; warnings are counted anyway."""
    config = mujoco.MjLogConfig.get() if hasattr(mujoco, "MjLogConfig") else None
    if config is not None:
        config.logto_file = config.logto_console = False
        config.set()
