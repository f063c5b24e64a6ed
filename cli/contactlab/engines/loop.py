"""What stands for loops that somebody else stepped and contactlab recorded."""

from contactlab.engines.engine import (
    Rollout,
    SimulationEngine,
    package_version,
)
from contactlab.errors import SceneError
from contactlab.scene.model_edits import LOOP_ENGINE
from contactlab.scene.resolution import ResolvedRun
from contactlab.scene.scene import Scene

_NOT_HERE = (
    "a loop of somebody's own made the run, whose code is not in the store; it can be read, "
    "compared and drawn, not simulated again"
)


class LoopEngine(SimulationEngine):
    """Simulates nothing: what loops did was read from MuJoCo's data as they did it."""

    name = LOOP_ENGINE
    summary = "a recorded loop"

    @property
    def version(self) -> str:
        """The version of MuJoCo, which the loop stepped."""
        return package_version("mujoco")

    def refusal(self, scene: Scene, run: ResolvedRun) -> str | None:  # noqa: ARG002 - none is run
        """Return why it runs nothing."""
        return _NOT_HERE

    def roll_out(self, *_: object, **__: object) -> Rollout:
        """Raise a SceneError."""
        raise SceneError(_NOT_HERE)
