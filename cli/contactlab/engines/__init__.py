"""Engines: from compiled models and start states to recorded trajectories.

`ENGINES` has every engine by name; a module that is imported here, or a plug-in, declares its own.
Code that depends on properties of an engine asks the engine: no code compares names.
"""

# The order of these imports is the order of engines in lists.
# isort: off
from contactlab.engines import mujoco_engine as mujoco_engine
from contactlab.engines import impulse as impulse
from contactlab.engines import adapted_engine as adapted_engine

# isort: on
from contactlab.engines.engine import ENGINES as ENGINES
from contactlab.engines.engine import Buffers as Buffers
from contactlab.engines.engine import PreparedRuns as PreparedRuns
from contactlab.engines.engine import Proceed as Proceed
from contactlab.engines.engine import Rollout as Rollout
from contactlab.engines.engine import SimulationEngine as SimulationEngine
from contactlab.engines.engine import Watch as Watch
from contactlab.engines.engine import no_limit as no_limit
from contactlab.engines.engine import proceed_always as proceed_always
from contactlab.errors import EngineError
from contactlab.registry import settle
from contactlab.scene.run_spec import RunSpec

settle()


def find_engine(name: str) -> SimulationEngine:
    """Return the engine with this name. Raises an EngineError if there is none here."""
    hint = f"; there are {', '.join(ENGINES)}; if a plug-in adds it, load the plug-in"
    EngineError.unless_known(name, ENGINES, f"no engine '{name}'", hint)
    return ENGINES[name]


def engine_of(run: RunSpec) -> SimulationEngine:
    """Return the engine that simulates a run."""
    return find_engine(run.engine)
