"""What steps models: MuJoCo's own batch where it has one, else a loop in Python."""

from typing import TYPE_CHECKING

from contactlab.scene import has_batch

if TYPE_CHECKING or has_batch():
    from mujoco.batch import Batch, SimulationError
else:
    from contactlab.engines.older_mujoco import SimulationError
    from contactlab.engines.older_mujoco import StepLoop as Batch

__all__ = ["Batch", "SimulationError"]
