"""Check 5: does the model repeat bit for bit, and what must a parallel engine reproduce."""

from dataclasses import replace

from contactlab.measure import METRICS
from contactlab.schema.check_report import CheckResult, Reference
from contactlab.studies.check.check_results import check_result
from contactlab.studies.check.check_runs import CheckRun
from contactlab.studies.check.checked_model import NOMINAL_STORE, CheckedModel

NAME = "repeat"
TOLERANCE = 0.05
"""Largest accepted relative difference between one environment and many in parallel."""

_ASKS = "the same run in another process is the same bit for bit"


def check_repeat(checked: CheckedModel) -> CheckResult:
    """Run the model again in another process, and compare the trajectories."""
    nominal = checked.nominal
    if nominal.record.trajectory_hash is None:
        reason = f"the model could not be run: {nominal.record.status_reason}"
        return check_result(NAME, _ASKS, [], [reason], checked.stores(NOMINAL_STORE))
    other = replace(checked, session=replace(checked.session, workers=1))
    again = other.run(NAME, "The model once more", [{}], checks="none")[0]
    unequal = nominal.record.trajectory_hash != again.record.trajectory_hash
    differing = {"in another process": float(unequal)}
    if (repeats := nominal.record.metrics.get("repeats")) is not None:
        differing["in the same process"] = 1.0 - repeats
    measures = [
        checked.limits.measure("trajectories_differ", value, where)
        for where, value in differing.items()
    ]
    note = f"reference.json has what a parallel engine must reproduce within {TOLERANCE:.0%}"
    return check_result(NAME, _ASKS, measures, [note], checked.stores(NOMINAL_STORE, NAME))


def reference_of(nominal: CheckRun) -> Reference:
    """Return what another engine must reproduce: the nominal run."""
    record = nominal.record
    assert record.trajectory_hash is not None
    metrics = {
        name: value
        for name, metric in METRICS.items()
        if metric.equivalence and (value := record.metrics.get(name)) is not None
    }
    return Reference(
        scene=record.scene,
        scene_hash=record.scene_hash,
        store=NOMINAL_STORE,
        run_id=record.run_id,
        trajectory_hash=record.trajectory_hash,
        engine=record.engine,
        settings=record.settings,
        seed=record.seed,
        duration=record.duration,
        success=record.label == "stable",
        label=record.label,
        metrics=metrics,
        units={name: record.units[name] for name in metrics},
        tolerance=TOLERANCE,
        resolution={name: METRICS[name].resolution for name in metrics},
    )
