"""Check 1: is the timestep short enough for the task, the geometry and the contacts."""

import math
from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from contactlab.contact.contact_laws import stiffness_damping
from contactlab.contact.trace_arrays import Floats
from contactlab.scene.contact_pairs import MonitoredPair
from contactlab.scene.run_setup import make_setup
from contactlab.schema.check_report import Change, CheckResult, Measure, TaskKind
from contactlab.studies.check.check_results import (
    change,
    check_result,
    informative,
    upper_limit,
    violated,
)
from contactlab.studies.check.checked_model import NOMINAL_STORE, CheckedModel, CheckRunner
from contactlab.studies.check.contact_sets import ContactSet, contact_sets, rounded_down

NAME = "timestep"
LONGEST: dict[TaskKind, float] = {"manipulation": 2e-3, "locomotion": 4e-3}
"""Longest accepted timestep [s] by kind of task."""

RATIO = 0.8
"""Limit of h / (timeconst dampratio): up to it a contact gains no energy with Euler."""

_ASKS = "the timestep suits the task, the thinnest geometry and the stiffest contact"
_SLACK = 1 + 1e-9


def check_timestep(runner: CheckRunner) -> CheckResult:
    """Compare the timestep with the kind of task, the thinnest geoms and the stiffest contact."""
    checked = runner.checked
    measures = [
        upper_limit(
            "timestep", checked.resolved.timestep, "s", LONGEST[checked.kind], checked.kind
        ),
        *_ratios(checked),
        *_travels(runner),
    ]
    return check_result(
        NAME,
        _ASKS,
        _reason(checked, measures),
        measures,
        changes=list(_changes(checked, measures)),
        notes=list(_notes(checked)),
        stores=runner.stores(NOMINAL_STORE),
    )


def _ratios(checked: CheckedModel) -> Iterator[Measure]:
    """Yield h / (timeconst dampratio) of each contact, with the engine's effective solref."""
    for each in contact_sets(checked):
        yield upper_limit("step_ratio", step_ratio(checked, each), "1", RATIO * _SLACK, each.name)


def step_ratio(checked: CheckedModel, contact: ContactSet) -> float:
    """Return the timestep times the natural frequency of a contact: h / (timeconst dampratio)."""
    stiffness, _ = stiffness_damping(contact.solref)
    return checked.resolved.timestep * math.sqrt(max(float(stiffness), 0.0))


def _travels(runner: CheckRunner) -> Iterator[Measure]:
    """Yield the travel of each pair's surfaces in a step, against half its thinnest geom."""
    checked = runner.checked
    base, model = checked.base, checked.prepared.model
    if not base.pairs or not runner.nominal.is_complete:
        return
    trace = runner.nominal.trace
    speeds = pair_speeds(model, base.pairs, trace.qpos, trace.qvel)
    thickness = make_setup(base, None, [checked.resolved], [model], {}).thickness
    for pair, speed, half in zip(base.pairs, speeds, thickness, strict=True):
        if math.isfinite(half):
            travel = float(speed) * checked.resolved.timestep
            yield upper_limit("travel", travel, "m", float(half), pair.name)
    fall = math.sqrt(
        2 * float(np.linalg.norm(checked.settings.vector("gravity"))) * model.stat.extent
    )
    yield informative(
        "travel_of_a_fall", fall * checked.resolved.timestep, "m", "over the model's extent"
    )


def _reason(checked: CheckedModel, measures: Sequence[Measure]) -> str:
    timestep = checked.resolved.timestep * 1e3
    first = measures[0]
    verb = "is above" if first.holds is False else "is within"
    parts = [f"{timestep:g} ms {verb} the {(first.limit or 0) * 1e3:g} ms of {first.of}"]
    ratios = [each for each in measures if each.name == "step_ratio"]
    if ratios:
        worst = max(ratios, key=lambda each: each.value or 0.0)
        parts.append(f"h/(tc dr) is {worst.value:.2g} at most (limit {RATIO:g})")
    travels = [each for each in measures if each.name == "travel"]
    if travels:
        worst = max(travels, key=_utilization)
        parts.append(
            f"a step moves {worst.of} by {(worst.value or 0) * 1e3:.2g} mm at most, "
            f"against a half thickness of {(worst.limit or 0) * 1e3:.2g} mm"
        )
    return "; ".join(parts)


def _utilization(measure: Measure) -> float:
    """Return a measure as a fraction of its limit."""
    return (measure.value if measure.value is not None else math.inf) / (measure.limit or 1e-300)


def _changes(checked: CheckedModel, measures: Sequence[Measure]) -> Iterator[Change]:
    """Yield the longest timestep, to two digits, at which every limit holds."""
    failed = violated(measures)
    if not failed:
        return
    timestep = checked.resolved.timestep
    longest = [timestep / _utilization(each) for each in failed if each.name != "step_ratio"]
    if any(each.name == "step_ratio" for each in failed):
        # By solref as the model has it: raised time constants shrink with the timestep.
        stiffness, _ = stiffness_damping([each.record.solref for each in contact_sets(checked)])
        longest.append(RATIO / float(stiffness.max()) ** 0.5)
    shown = "not run; every limit holds at this timestep if the motion stays the same"
    yield change(checked, {"timestep": rounded_down(min(longest))}, cures=None, shown=shown)


def _notes(checked: CheckedModel) -> Iterator[str]:
    for each in contact_sets(checked):
        if each.solref != each.record.solref:
            yield (
                f"the engine raises the time constant of solref {each.record.solref[0]:g} "
                f"{each.record.solref[1]:g} to {each.solref[0]:g} s, two timesteps (refsafe)"
            )


_MOST_STATES = 5000


def pair_speeds(
    model: mujoco.MjModel, pairs: Sequence[MonitoredPair], qpos: Floats, qvel: Floats
) -> Floats:
    """Return (P,) a bound on how fast the geoms of each pair move against each other [m/s].

    The relative speed of their centres, and for the rotation of each its angular speed times how
    far off its centre a ball of its least half extent can lie: a sphere that spins goes nowhere.

    Args:
        model: the run's model.
        pairs: the pairs.
        qpos: (N, nq) configurations; of more than 5000, an evenly spaced part.
        qvel: (N, nv) velocities.
    """
    geoms = sorted({geom for pair in pairs for side in pair.geoms for geom in side})
    places = {geom: place for place, geom in enumerate(geoms)}
    reach = np.array([_reach(model, geom) for geom in geoms])
    data = mujoco.MjData(model)
    speeds = np.zeros(len(pairs))
    stride = max(1, -(-len(qpos) // _MOST_STATES))
    velocity = np.zeros((len(geoms), 6))
    sides = [[[places[geom] for geom in side] for side in pair.geoms] for pair in pairs]
    for row in range(0, len(qpos), stride):
        data.qpos[:], data.qvel[:] = qpos[row], qvel[row]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        for place, geom in enumerate(geoms):
            kind = mujoco.mjtObj.mjOBJ_GEOM
            mujoco.mj_objectVelocity(model, data, kind, geom, velocity[place], 0)
        turning = np.linalg.norm(velocity[:, :3], axis=1) * reach
        for index, (first, second) in enumerate(sides):
            apart = velocity[first, None, 3:] - velocity[None, second, 3:]
            moving = np.linalg.norm(apart, axis=2)
            total = moving + turning[first][:, None] + turning[None, second]
            speeds[index] = max(speeds[index], float(total.max()))
    return speeds


def _reach(model: mujoco.MjModel, geom: int) -> float:
    """Return how far off a geom's centre a ball in it can lie [m]; 0 for a plane."""
    inside = float(model.geom_aabb[geom, 3:].min())
    return max(float(model.geom_rbound[geom]) - inside, 0.0)
