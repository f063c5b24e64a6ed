"""Check 1: is the timestep short enough for the task, the geometry and the contacts."""

import math
from collections.abc import Iterator

import numpy as np

from contactlab.contact.contact_laws import stiffness_damping
from contactlab.scene.run_setup import make_setup
from contactlab.scene.setting_values import as_vector
from contactlab.schema.check_report import CheckResult, Measure, TaskKind
from contactlab.studies.check.check_results import check_result, informative, utilization, violated
from contactlab.studies.check.check_runs import pair_speeds
from contactlab.studies.check.checked_model import NOMINAL_STORE, CheckedModel
from contactlab.studies.check.contact_checks import contact_sets, rounded_down
from contactlab.studies.session import Values

NAME = "timestep"
LONGEST: dict[TaskKind, float] = {"manipulation": 2e-3, "locomotion": 4e-3}
"""Longest accepted timestep [s] by kind of task."""

_ASKS = "the timestep suits the task, the thinnest geometry and the stiffest contact"


def check_timestep(checked: CheckedModel) -> CheckResult:
    """Compare the timestep with the kind of task, the thinnest geoms and the stiffest contact."""
    step, limit = checked.resolved.timestep, LONGEST[checked.kind]
    measures = [
        checked.limits.measure("timestep", step, checked.kind, limit=limit),
        *_ratios(checked),
        *_travels(checked),
    ]
    notes = list(_notes(checked))
    return check_result(NAME, _ASKS, measures, notes, checked.stores(NOMINAL_STORE))


def _ratios(checked: CheckedModel) -> Iterator[Measure]:
    """Yield the timestep times the natural frequency of each contact: h / (timeconst dampratio).

    Up to 0.8 a contact gains no energy with Euler. The solref is the engine's effective one.
    """
    for each in contact_sets(checked):
        stiffness, _ = stiffness_damping(each.solref)
        ratio = checked.resolved.timestep * math.sqrt(max(float(stiffness), 0.0))
        yield checked.limits.measure("step_ratio", ratio, each.name)


def _travels(checked: CheckedModel) -> Iterator[Measure]:
    """Yield the travel of each pair's surfaces in a step, against half its thinnest geom."""
    base, model = checked.base, checked.prepared.model
    if not base.pairs or not checked.nominal.is_complete or not checked.resolved.flags["contact"]:
        return
    trace, step = checked.nominal.trace, checked.resolved.timestep
    speeds = pair_speeds(model, base.pairs, trace.qpos, trace.qvel, step=step)
    thickness = make_setup(base, None, [checked.resolved], [model], {}).thickness
    for pair, speed, half in zip(base.pairs, speeds, thickness, strict=True):
        if math.isfinite(half):
            travel = float(speed) * step
            yield checked.limits.measure("travel", travel, pair.name, limit=float(half))
    gravity = float(np.linalg.norm(as_vector(checked.settings["gravity"])))
    fall = math.sqrt(2 * gravity * model.stat.extent)
    yield informative("travel_of_a_fall", fall * step, "m", "over the model's extent")


def shorter_timestep(checked: CheckedModel, result: CheckResult) -> Iterator[Values]:
    """Yield the longest timestep, to two digits, at which every limit holds."""
    failed = violated(result.measures)
    timestep = checked.resolved.timestep
    longest = [timestep / utilization(each) for each in failed if each.name != "step_ratio"]
    ratios = [each.limit or 0.0 for each in failed if each.name == "step_ratio"]
    if ratios:
        # By solref as the model has it: raised time constants shrink with the timestep.
        records = [each.record.solref for each in contact_sets(checked)]
        stiffness, _ = stiffness_damping(records)
        longest.append(min(ratios) / float(stiffness.max()) ** 0.5)
    if longest and min(longest) > 0:
        yield {"timestep": rounded_down(min(longest))}


def _notes(checked: CheckedModel) -> Iterator[str]:
    for each in contact_sets(checked):
        if each.solref != each.record.solref:
            yield (
                f"the engine raises the time constant of solref {each.record.solref[0]:g} "
                f"{each.record.solref[1]:g} to {each.solref[0]:g} s, two timesteps (refsafe)"
            )
