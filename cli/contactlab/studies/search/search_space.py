"""Settings that may make a model faster. Safeguards, such as refsafe and clamps, are excluded."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.exercised_rows import exercised_rows
from contactlab.modifications.catalogue import list_rows
from contactlab.scene.model_edits import FLAG_NAMES, read_flag, read_option
from contactlab.scene.model_names import name_of
from contactlab.scene.parameters import WORDS
from contactlab.scene.unreachable import filtered_pairs
from contactlab.schema.setting_values import as_number
from contactlab.studies.search.configuration import INTEGRATOR

Settings = Mapping[str, object]
_SMALLER_VALUES: Mapping[str, tuple[int, ...]] = {
    "iterations": (50, 20, 10, 5, 3),
    "ls_iterations": (20, 10, 5),
    "noslip_iterations": (3, 0),
    "ccd_iterations": (12,),
}
STEP_SENSITIVE_ITERATIONS = 20
"""Solver and line search iterations below this may be too few at longer steps."""
_LOOSER_TOLERANCES = (1e-8, 1e-6, 1e-4)
_OPTIONAL_FLAGS = ("multiccd", "diagexact", "speculative")
SLEEP_SETTINGS: Settings = {"sleep": True, "island": True}
"""Sleep needs islands."""
_CONTACT_DIMENSIONS = (3, 4)
"""Contact dimensions. Fewer than three have no friction, which this task may not show."""
EXERCISED_ROWS = {
    "cone": (("cone", "pyramids"), "friction"),
    "impratio": (("impratio",), "friction"),
    "noslip_iterations": (("noslip",), "friction"),
    "condim": (("condim 3",), "torsional friction"),
    "multiccd": (("contact softness",), "contacts"),
}
"""Budget rows that the task must exercise before a setting may change, and their load."""


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
    row_names = {name for names, _ in EXERCISED_ROWS.values() for name in names}
    rows = [row for row in list_rows() if row.name in row_names and row.applies(model)]
    exercised = {name for motion in motions for name in exercised_rows(motion, rows)}
    for parameter in propose_parameters(model):
        needed, load = EXERCISED_ROWS.get(parameter.name, ((), ""))
        if needed and not exercised & {*needed}:
            skipped.append(SkippedParameter(parameter.name, f"the task does not load {load}"))
        elif parameter.values or parameter.step_sensitive:
            parameters.append(parameter)
    return parameters, skipped


def find_integrators(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the integrators to try, the model's own first; flexes allow no other."""
    own = str(read_option(model, INTEGRATOR))
    if model.nflex:
        return (own,)
    return tuple(dict.fromkeys([own, "Euler", "implicitfast", "implicit", "RK4"]))


def propose_parameters(model: mujoco.MjModel) -> Iterator[Parameter]:
    """Yield all parameters of a model that may save work, whatever its task exercises."""

    def option(name: str) -> float:
        return as_number(read_option(model, name))

    for name in ("solver", "jacobian", "cone"):
        own = read_option(model, name)
        others = [word for word in WORDS[name] if word not in (own, "auto")]
        yield Parameter(name, [{name: word} for word in others], cost_falls=False)
    for name, values in _SMALLER_VALUES.items():
        fewer = [value for value in values if value < option(name)]
        hang = name in ("iterations", "ls_iterations")
        tight = [value for value in fewer if hang and value < STEP_SENSITIVE_ITERATIONS]
        yield Parameter(
            name,
            [{name: value} for value in fewer if value not in tight],
            [{name: value} for value in tight],
        )
    looser = [value for value in _LOOSER_TOLERANCES if value > option("tolerance")]
    yield Parameter("tolerance", [{"tolerance": value} for value in looser])
    if option("impratio") != 1:
        yield Parameter("impratio", [{"impratio": 1.0}])
    yield from _flag_parameters(model)
    yield Parameter(
        "condim",
        [dims for least in _CONTACT_DIMENSIONS[::-1] if (dims := _condim_settings(model, least))],
    )


def _flag_parameters(model: mujoco.MjModel) -> Iterator[Parameter]:
    if "island" in FLAG_NAMES:
        yield Parameter("island", [{"island": not read_flag(model, "island")}])
    for flag in _OPTIONAL_FLAGS:
        if flag in FLAG_NAMES and read_flag(model, flag):
            yield Parameter(flag, [{flag: False}])
    if read_flag(model, "eulerdamp"):
        yield Parameter("eulerdamp", (), [{"eulerdamp": False}])
    if read_flag(model, "contact") and not has_contacts(model):
        yield Parameter("contact", [{"contact": False}])


def may_sleep(model: mujoco.MjModel) -> bool:
    """Return whether some bodies could sleep, but may not in the model as written.

    Driven trees stay awake, and sleep of a single other tree saves little.
    """
    if "sleep" not in FLAG_NAMES or read_flag(model, "sleep"):
        return False
    allowed = (mujoco.mjtSleepPolicy.mjSLEEP_AUTO_ALLOWED, mujoco.mjtSleepPolicy.mjSLEEP_ALLOWED)
    return bool(np.isin(model.tree_sleep_policy, [int(each) for each in allowed]).any())


def has_contacts(model: mujoco.MjModel) -> bool:
    """Return whether any contact is possible: of geoms, listed pairs or flexes."""
    return bool(filtered_pairs(model) or model.npair or model.nflex)


def _condim_settings(model: mujoco.MjModel, least: int) -> Settings:
    """Return settings that reduce the contact dimensions of geoms to `least`."""
    return {
        f"geom_condim[{name_of(model, 'geom', int(geom))}]": least
        for geom in np.flatnonzero(model.geom_condim > least)
    }


def split_condim(settings: Settings) -> list[Settings]:
    """Return the settings of each geom alone, if there are several."""
    fields: list[Settings] = [
        {name: value} for name, value in settings.items() if name.startswith("geom_condim[")
    ]
    return fields if len(fields) > 1 else []
