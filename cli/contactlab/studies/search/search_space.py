"""Settings that may make a model faster. Safeguards, such as refsafe and clamps, are excluded."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco

from contactlab.budget import Motion
from contactlab.budget.exercised_rows import exercised_rows
from contactlab.modifications.catalogue import list_levers, list_rows
from contactlab.modifications.modification import Lever, Settings
from contactlab.scene.model_edits import FLAG_NAMES, read_flag, read_option
from contactlab.schema.setting_values import as_number
from contactlab.studies.search.configuration import INTEGRATOR


@dataclass(frozen=True)
class Parameter:
    """A setting, and the values to try.

    Attributes:
        name: as in the report.
        values: settings by axis, each tried alone.
        step_sensitive: values that depend on the step, tried once that is found.
        cost_falls: whether each value costs no more than those before it, so that no value saves
            time if the last one does not.
    """

    name: str
    values: Sequence[Settings]
    step_sensitive: Sequence[Settings] = ()
    cost_falls: bool = True


@dataclass(frozen=True)
class SkippedParameter:
    """A setting that is not tried, and why."""

    name: str
    reason: str


def find_parameters(
    model: mujoco.MjModel, motions: Sequence[Motion]
) -> tuple[list[Parameter], list[SkippedParameter]]:
    """Return the parameters of a model, and those that its task does not exercise."""
    parameters, skipped = list[Parameter](), list[SkippedParameter]()
    levers = [lever for lever in list_levers("values") if lever.applies(model)]
    row_names = {name for lever in levers if lever.load for name in lever.rows}
    rows = [row for row in list_rows() if row.name in row_names and row.applies(model)]
    exercised = {name for motion in motions for name in exercised_rows(motion, rows)}
    for lever in levers:
        parameter = _build_parameter(lever, model)
        if lever.load and not exercised & {*lever.rows}:
            reason = f"the task does not load {lever.load}"
            skipped.append(SkippedParameter(lever.setting, reason))
        elif parameter.values or parameter.step_sensitive:
            parameters.append(parameter)
    return parameters, skipped


def find_integrators(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the integrators to try, the model's own first; flexes allow no other."""
    own, (lever,) = str(read_option(model, INTEGRATOR)), list_levers("step")
    if not lever.applies(model):
        return (own,)
    return tuple(dict.fromkeys([own, *map(str, lever.domain)]))


def propose_parameters(model: mujoco.MjModel) -> list[Parameter]:
    """Return all parameters of a model that may save work, whatever its task exercises."""
    levers = [lever for lever in list_levers("values") if lever.applies(model)]
    return [_build_parameter(lever, model) for lever in levers]


def _build_parameter(lever: Lever, model: mujoco.MjModel) -> Parameter:
    values = list[Settings]()
    sensitive = list[Settings]()
    for value in lever.domain:
        if lever.write is None and not _is_worth_trying(lever, model, value):
            continue
        settings = lever.write(model, value) if lever.write else {lever.setting: value}
        late = isinstance(value, (int, float)) and value < lever.step_sensitive_below
        if settings:
            (sensitive if late else values).append(settings)
    return Parameter(lever.setting, values, sensitive, lever.cost_falls)


def _is_worth_trying(lever: Lever, model: mujoco.MjModel, value: object) -> bool:
    name = lever.setting
    own = read_flag(model, name) if name in FLAG_NAMES else read_option(model, name)
    if lever.direction == "other":
        return value != own
    below = as_number(value) < as_number(own)
    return below if lever.direction == "below" else as_number(value) > as_number(own)


def split_condim(settings: Settings) -> list[Settings]:
    """Return the settings of each geom alone, if there are several."""
    fields: list[Settings] = [
        {name: value} for name, value in settings.items() if name.startswith("geom_condim[")
    ]
    return fields if len(fields) > 1 else []
