"""What a sweep will take, before it runs: counts, time, disk, and settings that look wrong."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from contactlab.law import stiffness_damping
from contactlab.pipeline.job import PlannedRun
from contactlab.pipeline.jobs import planned_runs
from contactlab.plan import Plan
from contactlab.scene import Resolved, Scene
from contactlab.sim import Buffers, bytes_of_run, quiet, roll_out

# Above this product of step and natural frequency, contacts gain energy under the Euler family.
_FASTEST = 0.8
_SAMPLES = 12
_SAMPLE_STEPS = 200
# What recording, metrics and traces add to the stepping, least and most.
_OVERHEAD = (1.2, 2.5)
# What compression leaves of a trace, least and most.
_COMPRESSED = (0.1, 0.6)

Planned = Sequence[tuple[PlannedRun, Resolved]]


@dataclass(frozen=True)
class Forecast:
    """What a sweep will take.

    Attributes:
        runs: distinct runs.
        steps: steps of all runs.
        seconds: wall time, least and most likely [s].
        bytes: size of the traces, least and most likely.
        warnings: what looks wrong but stops nothing.
    """

    runs: int
    steps: int
    seconds: tuple[float, float]
    bytes: tuple[float, float]
    warnings: tuple[str, ...]


def forecast(plan: Plan, scene: Scene, workers: int) -> Forecast:
    """Return what a sweep will take, from a few hundred steps of a few of its runs."""
    planned = list(planned_runs(plan, scene))
    steps = sum(resolved.steps for _, resolved in planned)
    per_step = [_step_cost(scene, resolved) for resolved in _sample(planned)] or [0.0]
    share = steps / max(1, workers)
    size = _trace_bytes(plan, scene, planned)
    return Forecast(
        runs=len(planned),
        steps=steps,
        seconds=(
            float(np.quantile(per_step, 0.25)) * share * _OVERHEAD[0],
            float(np.quantile(per_step, 0.75)) * share * _OVERHEAD[1],
        ),
        bytes=(size * _COMPRESSED[0], size * _COMPRESSED[1]),
        warnings=tuple(_warnings(plan, planned)),
    )


def _sample(planned: Planned) -> Iterator[Resolved]:
    stride = max(1, len(planned) // _SAMPLES)
    return (resolved for _, resolved in islice(planned, 0, None, stride))


def _step_cost(scene: Scene, resolved: Resolved) -> float:
    """Return CPU seconds a step."""
    quiet()
    base = scene.base(resolved.structure)
    steps = min(resolved.steps, _SAMPLE_STEPS)
    model = base.prepare(resolved.edits()).model
    return float(roll_out([model], scene.starts([resolved]), steps, Buffers()).cost[0]) / steps


def _trace_bytes(plan: Plan, scene: Scene, planned: Planned) -> float:
    rule = plan.sweep.trace
    total = sum(
        bytes_of_run(scene.base(resolved.structure).model, resolved.steps)
        for _, resolved in planned
    )
    if rule == "none":
        return 0.0
    if rule.startswith("sample:"):
        return total * min(1.0, int(rule.removeprefix("sample:")) / len(planned))
    return float(total)


def _warnings(plan: Plan, planned: Planned) -> Iterator[str]:
    yield from (warning.message for warning in plan.warnings)
    if plan.count > len(planned):
        yield f"{plan.count - len(planned)} runs are the same as others and run once"
    fast = Counter(round(_speed(resolved), 1) > _FASTEST for _, resolved in planned)[True]
    if fast:
        yield (
            f"{fast} of {len(planned)} runs step too far for their contacts: "
            f"timestep / (timeconst * dampratio) is above {_FASTEST}, where contacts gain energy"
        )
    clamped = sum(_clamped(resolved) for _, resolved in planned)
    if clamped:
        yield (
            f"in {clamped} of {len(planned)} runs refsafe raises the time constant of solref to "
            "2 timesteps, so that solref is not what the sweep says"
        )


def _speed(resolved: Resolved) -> float:
    """Return the timestep times the contact's natural frequency, after refsafe's clamp."""
    solref = resolved.settings.get("solref")
    if not isinstance(solref, tuple):
        return 0.0
    if _clamped(resolved):
        solref = (2 * resolved.timestep, solref[1])
    return resolved.timestep * float(stiffness_damping(solref)[0]) ** 0.5


def _clamped(resolved: Resolved) -> bool:
    solref = resolved.settings.get("solref")
    if not isinstance(solref, tuple) or solref[0] <= 0 or not resolved.flags["refsafe"]:
        return False
    return bool(solref[0] < 2 * resolved.timestep)
