"""What a sweep will take, before it runs: counts, time, disk, and settings that look wrong."""

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from contactlab.law import stiffness_damping
from contactlab.pipeline.clamping import is_clamped
from contactlab.pipeline.jobs import Planned, planned_runs
from contactlab.pipeline.pass_forecast import accuracy_steps, timing_seconds
from contactlab.plan import Plan
from contactlab.scene import Resolved, Scene, has_batch
from contactlab.sim import Buffers, bytes_of_run, quiet, roll_out

# Above this product of step and natural frequency, contacts gain energy under the Euler family.
_FASTEST = 0.8
_SAMPLES = 12
_SAMPLE_STEPS = 200
# What recording, metrics and traces add to the stepping, least and most.
_OVERHEAD = (1.2, 2.5)
# What compression leaves of a trace, least and most.
_COMPRESSED = (0.1, 0.6)


@dataclass(frozen=True)
class Forecast:
    """What a sweep will take.

    Attributes:
        runs: distinct runs.
        steps: steps of all runs.
        seconds: wall time of all passes, least and most likely [s].
        accuracy_seconds: how much of it references and what is held against them take [s].
        timing_seconds: how much of it times and work take [s].
        bytes: size of the traces, least and most likely.
        warnings: what looks wrong but stops nothing.
    """

    runs: int
    steps: int
    seconds: tuple[float, float]
    accuracy_seconds: float
    timing_seconds: float
    bytes: tuple[float, float]
    warnings: tuple[str, ...]


def forecast(plan: Plan, scene: Scene, workers: int) -> Forecast:
    """Return what a sweep will take, from a few hundred steps of a few of its runs."""
    planned = list(planned_runs(plan, scene))
    steps = sum(resolved.steps for _, resolved in planned)
    per_step = [_step_cost(scene, resolved) for resolved in _sample(planned)] or [0.0]
    share = steps / max(1, workers)
    size = _trace_bytes(plan, scene, planned)
    likely, sweep = float(np.median(per_step)), plan.sweep
    accuracy = likely * accuracy_steps(sweep.accuracy, planned, scene) / max(1, workers)
    # What is counted is run once more by the workers, before the clock runs.
    counting = likely * share if sweep.timing else 0.0
    timing = counting + timing_seconds(sweep.timing, planned, likely)
    return Forecast(
        runs=len(planned),
        steps=steps,
        seconds=(
            float(np.quantile(per_step, 0.25)) * share * _OVERHEAD[0] + accuracy + timing,
            float(np.quantile(per_step, 0.75)) * share * _OVERHEAD[1] + accuracy + timing,
        ),
        accuracy_seconds=accuracy,
        timing_seconds=timing,
        bytes=(size * _COMPRESSED[0], size * _COMPRESSED[1]),
        warnings=tuple(_warnings(plan, planned)),
    )


def _sample(planned: Planned) -> Iterator[Resolved]:
    stride = max(1, len(planned) // _SAMPLES)
    return (resolved for _, resolved in islice(planned, 0, None, stride))


def _step_cost(scene: Scene, resolved: Resolved) -> float:
    """Return CPU seconds a step."""
    quiet()
    steps = min(resolved.steps, _SAMPLE_STEPS)
    starts = scene.starts([resolved])
    model = scene.prepare(resolved, starts).model
    begin = time.thread_time()
    cost = float(roll_out([model], starts, steps, Buffers()).cost[0])
    # Where Python makes the steps, what it takes for them counts as well.
    return (cost if has_batch() else time.thread_time() - begin) / steps


def _trace_bytes(plan: Plan, scene: Scene, planned: Planned) -> float:
    rule = plan.sweep.trace
    total = sum(
        bytes_of_run(scene.base_of(resolved).model, resolved.steps) for _, resolved in planned
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
    return isinstance(solref, tuple) and is_clamped(resolved, [solref])
