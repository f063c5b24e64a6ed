"""Error budgets of a sampled sweep: the effect of its axes in the windows of one run."""

import math
from collections.abc import Iterator, Mapping

import mujoco
import numpy as np

from contactlab.budget.measuring import PhaseMeasure, Settings
from contactlab.budget.motion import motion_of_run
from contactlab.errors import ContactlabError
from contactlab.mjcf import MODEL_ENGINE
from contactlab.modifications.modification import ModelChange, Row
from contactlab.plan.sampled_shares import configuration_of
from contactlab.run.passes import SweepSession
from contactlab.scene.model_draft import fields_of
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.schema.drive import PolicyDrive
from contactlab.schema.evidence import ParameterBudget
from contactlab.schema.strict_model import finite_or_none
from contactlab.schema.sweep_schema import MOST_SENSITIVITIES, Sweep
from contactlab.schema.vocabulary import Loguniform, Sampled

_BUDGET_SETTINGS = Settings(check=False, energy=False, places=False, excess=False)
# Settings that a reference chooses itself.
_REFERENCE_FIELDS = {
    *("opt.timestep", "opt.integrator", "opt.solver", "opt.jacobian"),
    *("opt.iterations", "opt.tolerance", "opt.ls_iterations", "opt.ls_tolerance"),
}


def parameter_budgets(session: SweepSession) -> Iterator[ParameterBudget]:
    """Yield a budget for each configuration and seed with reported sensitivities.

    Its run is in the middle of the ranges of the sampled axes, and a row for each axis changes the
    reference's model to that of either end; the larger counts. An axis that changes no number of
    the model, such as one of the start or the drive, has no row. Other engines and policies have no
    budget.
    """
    sweep, seen_keys = session.task.sweep, set[object]()
    if sweep.sample is None or sweep.sample.method != "saltelli":
        return
    for run in session.index.iterate_runs():
        shared = configuration_of(run.axes, sweep.drawn_axes)
        if (shared, run.seed) in seen_keys or isinstance(run.drive, PolicyDrive):
            continue
        seen_keys.add((shared, run.seed))
        if len(seen_keys) > MOST_SENSITIVITIES:
            return
        if run.engine == MODEL_ENGINE:
            yield from _budgets_of_run(session.scene, sweep, run, dict(shared))


def _budgets_of_run(
    scene: Scene, sweep: Sweep, run: RunSpec, shared: Mapping[str, object]
) -> Iterator[ParameterBudget]:
    ranges = {
        name: _axis_range(axis) for name, axis in sweep.axes.items() if isinstance(axis, Sampled)
    }
    try:
        middle = {name: _canonical_value(scene, name, values[1]) for name, values in ranges.items()}
        own, resolved = _prepared_model(scene, {**shared, **middle}, run)
        starts = scene.initial_states([resolved])
        rows = [
            Row(
                name,
                f"{name} at {low:g} and {high:g}",
                "unknown",
                tuple(_change_towards(own, model) for model in ends),
                has_time=False,
            )
            for name, (low, _, high) in ranges.items()
            if (ends := _end_models(scene, {**shared, **middle}, name, (low, high), run, own))
        ]
        motion = motion_of_run(own, starts, 0, resolved.steps)
        phase = PhaseMeasure(motion, rows, _BUDGET_SETTINGS).measure_budget()
    except (ContactlabError, ValueError):
        return  # no movable body has mass, or the middle is not a valid run
    rows = [
        {
            "axis": row.name,
            "low": ranges[row.name][0],
            "high": ranges[row.name][2],
            "share": finite_or_none(row.error),
            "body": phase.bodies[row.body],
        }
        for row in phase.rows
    ]
    own_share = finite_or_none(phase.run.error)
    common_fields = {"shared": {**shared, "seed": run.seed}, "middle": middle}
    yield ParameterBudget.model_validate({**common_fields, "run": own_share, "rows": rows})


def _axis_range(axis: Sampled) -> tuple[float, float, float]:
    if isinstance(axis, Loguniform):
        low, high = axis.loguniform
        return low, math.sqrt(low * high), high
    low, high = axis.uniform
    return low, (low + high) / 2, high


def _canonical_value(scene: Scene, name: str, value: float) -> object:
    spec = scene.catalogue.find_axis(name)
    assert spec is not None
    try:
        return spec.parse(value)
    except ValueError:
        return spec.parse(round(value))


def _prepared_model(
    scene: Scene, values: Mapping[str, object], run: RunSpec
) -> tuple[mujoco.MjModel, RunSpec]:
    resolved = scene.resolve(values, run.seed, run.duration)
    return scene.prepare(resolved, scene.initial_states([resolved])).model, resolved


def _end_models(
    scene: Scene,
    values: Mapping[str, object],
    name: str,
    ends: tuple[float, float],
    run: RunSpec,
    own: mujoco.MjModel,
) -> list[mujoco.MjModel]:
    """Return the models at both ends of an axis; empty if no number differs, or the layout does."""
    try:
        models = [
            _prepared_model(scene, {**values, name: _canonical_value(scene, name, end)}, run)[0]
            for end in ends
        ]
    except (ContactlabError, ValueError):
        return []
    before = _model_numbers(own)
    if any(_array_shapes(_model_numbers(model)) != _array_shapes(before) for model in models):
        return []
    differ = any(_changed_numbers(before, _model_numbers(model)) for model in models)
    return models if differ else []


def _model_numbers(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    owners = {"": model, "opt.": model.opt}
    return {
        prefix + name: value
        for prefix, owner in owners.items()
        for name, value in fields_of(owner).items()
        if value.dtype.kind in "fiub" and prefix + name not in _REFERENCE_FIELDS
    }


def _array_shapes(numbers: Mapping[str, np.ndarray]) -> dict[str, tuple[int, ...]]:
    return {name: value.shape for name, value in numbers.items()}


def _changed_numbers(
    before: Mapping[str, np.ndarray], after: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    return {
        name: value.copy()
        for name, value in after.items()
        if value.tobytes() != before[name].tobytes()
    }


def _change_towards(own: mujoco.MjModel, other: mujoco.MjModel) -> ModelChange:
    """Return the change that gives a model the numbers of another that differ from the own."""
    fields = _changed_numbers(_model_numbers(own), _model_numbers(other))

    def change(model: mujoco.MjModel, _own: mujoco.MjModel) -> None:
        for path, value in fields.items():
            owner = model.opt if path.startswith("opt.") else model
            name = path.removeprefix("opt.")
            if isinstance(getattr(owner, name), np.ndarray):
                getattr(owner, name)[...] = value
            else:
                setattr(owner, name, value.item())

    return change
