"""An engine in which nothing moves."""

import numpy as np

from contactlab.engines import (
    Buffers,
    PreparedRuns,
    Proceed,
    Rollout,
    SimulationEngine,
    Watch,
    no_limit,
    proceed_always,
)


class FrozenEngine(SimulationEngine):
    """Keeps every body where it starts, and counts time."""

    name = "frozen"
    summary = "nothing moves"

    @property
    def version(self) -> str:
        """The version of what computes the trajectories."""
        return "3"

    def roll_out(
        self,
        runs: PreparedRuns,
        buffers: Buffers,
        watch: Watch = no_limit,
        proceed: Proceed = proceed_always,
    ) -> Rollout:
        """Simulate runs; see `SimulationEngine`."""
        steps = runs.steps
        arrays = buffers.arrays(runs.models[0], len(runs.prepared), steps)
        arrays.state[:], arrays.sensors[:], arrays.iterations[:] = 0, 0, 0
        count = 0
        while count < len(runs.prepared) and proceed():
            watch()
            model = runs.models[count]
            arrays.state[count, :, 0] = model.opt.timestep * np.arange(steps + 1)
            arrays.state[count, :, 1 : 1 + model.nq] = runs.starts.qpos[count]
            count += 1
        return Rollout(
            state=arrays.state[:count],
            sensors=arrays.sensors[:count],
            iterations=arrays.iterations[:count],
            steps=(steps,) * count,
            cost=np.full(count, np.nan),
            warnings=tuple({} for _ in range(count)),
            errors=(None,) * count,
        )
