"""Engines: from compiled models and start states to recorded trajectories.

`ENGINES` has every engine by name; plug-ins add theirs to it. What must know an engine asks it:
nothing compares names.
"""

from contactlab.engines.adapted_engine import adapted_engines
from contactlab.engines.engine import Buffers as Buffers
from contactlab.engines.engine import PreparedRuns as PreparedRuns
from contactlab.engines.engine import Proceed as Proceed
from contactlab.engines.engine import Rollout as Rollout
from contactlab.engines.engine import SimulationEngine as SimulationEngine
from contactlab.engines.engine import Watch as Watch
from contactlab.engines.engine import no_limit as no_limit
from contactlab.engines.engine import proceed_always as proceed_always
from contactlab.engines.impulse import ImpulseEngine
from contactlab.engines.mujoco_engine import LoopEngine, MujocoEngine, OlderMujocoEngine
from contactlab.errors import EngineError
from contactlab.registry import Registry
from contactlab.scene.mujoco_versions import has_batch
from contactlab.scene.resolution import ResolvedRun

ENGINES: Registry[SimulationEngine] = Registry("engine")
ENGINES.add(MujocoEngine() if has_batch() else OlderMujocoEngine())
ENGINES.add(ImpulseEngine())
ENGINES.add(LoopEngine())
for _engine in adapted_engines():
    ENGINES.add(_engine)


def find_engine(name: str) -> SimulationEngine:
    """Return the engine of this name; an EngineError if there is none here."""
    rest = "; if a plug-in adds it, load that"
    EngineError.unless_known(name, ENGINES, f"no engine '{name}'", rest=rest)
    return ENGINES[name]


def engine_of(run: ResolvedRun) -> SimulationEngine:
    """Return the engine that simulates a run."""
    return find_engine(run.engine)
