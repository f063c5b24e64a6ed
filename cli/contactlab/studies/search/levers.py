"""Settings that may make a model cheaper. Safeguards, such as refsafe and clamps, are none."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.rows import ROWS
from contactlab.budget.showing import shown_rows
from contactlab.scene.model_edits import FLAGS, read_flag, read_option
from contactlab.scene.model_names import name_of
from contactlab.scene.parameters import WORDS
from contactlab.scene.unreachable import filtered_pairs
from contactlab.schema.setting_values import as_number
from contactlab.studies.search.choice import INTEGRATOR

Settings = Mapping[str, object]
_FEWER: Mapping[str, tuple[int, ...]] = {
    "iterations": (50, 20, 10, 5, 3),
    "ls_iterations": (20, 10, 5),
    "noslip_iterations": (3, 0),
    "ccd_iterations": (12,),
}
_TIGHT = 20
"""Iterations of solver and line search below which longer steps may want more."""
_LOOSER = (1e-8, 1e-6, 1e-4)
_OFF = ("multiccd", "diagexact", "speculative")
ASLEEP: Settings = {"sleep": True, "island": True}
"""What sleeps is an island."""
_DIMENSIONS = (3, 4)
"""Of contacts. Fewer than three have no friction, which no run of this task may tell of."""
_SHOWN = {
    "cone": ("cone", "pyramids"),
    "impratio": ("impratio",),
    "noslip_iterations": ("noslip",),
    "condim": ("condim 3",),
    "multiccd": ("contact softness",),
}
"""Rows of a budget that a task has to exercise before a setting may change."""


@dataclass(frozen=True)
class Lever:
    """A setting, and the values that are tried.

    Attributes:
        name: as the report has it.
        values: settings by axis, each tried by itself.
        tight: more of them, which hang on the step: tried once that is found.
        falls: whether each value costs no more than those before it: where the last saves nothing,
            none does.
    """

    name: str
    values: Sequence[Settings]
    tight: Sequence[Settings] = ()
    falls: bool = True


@dataclass(frozen=True)
class Unsearched:
    """What is not tried, and why."""

    name: str
    reason: str


def levers_of(
    model: mujoco.MjModel, motions: Sequence[Motion]
) -> tuple[list[Lever], list[Unsearched]]:
    """Return the levers of a model, and those that its task does not exercise."""
    found, kept = list[Lever](), list[Unsearched]()
    wanted = {name for names in _SHOWN.values() for name in names}
    rows = [row for row in ROWS if row.name in wanted and row.uses(model)]
    shown = {name for motion in motions for name in shown_rows(motion, rows)}
    for lever in _proposed(model):
        needs = _SHOWN.get(lever.name, ())
        if needs and not shown & {*needs}:
            kept.append(Unsearched(lever.name, "nothing in the task exercises it"))
        elif lever.values or lever.tight:
            found.append(lever)
    return found, kept


def integrators_of(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the integrators to try, that of the model first; flexes allow no other."""
    own = str(read_option(model, INTEGRATOR))
    if model.nflex:
        return (own,)
    return tuple(dict.fromkeys([own, "Euler", "implicitfast", "implicit", "RK4"]))


def _proposed(model: mujoco.MjModel) -> Iterator[Lever]:
    def option(name: str) -> float:
        return as_number(read_option(model, name))

    for name in ("solver", "jacobian", "cone"):
        own = read_option(model, name)
        others = [word for word in WORDS[name] if word not in (own, "auto")]
        yield Lever(name, [{name: word} for word in others], falls=False)
    for name, values in _FEWER.items():
        fewer = [value for value in values if value < option(name)]
        hang = name in ("iterations", "ls_iterations")
        tight = [value for value in fewer if hang and value < _TIGHT]
        yield Lever(
            name,
            [{name: value} for value in fewer if value not in tight],
            [{name: value} for value in tight],
        )
    looser = [value for value in _LOOSER if value > option("tolerance")]
    yield Lever("tolerance", [{"tolerance": value} for value in looser])
    if option("impratio") != 1:
        yield Lever("impratio", [{"impratio": 1.0}])
    yield from _flags(model)
    yield Lever("condim", [dims for least in _DIMENSIONS[::-1] if (dims := _condim(model, least))])


def _flags(model: mujoco.MjModel) -> Iterator[Lever]:
    if "island" in FLAGS:
        yield Lever("island", [{"island": not read_flag(model, "island")}])
    for flag in _OFF:
        if flag in FLAGS and read_flag(model, flag):
            yield Lever(flag, [{flag: False}])
    if read_flag(model, "eulerdamp"):
        yield Lever("eulerdamp", (), [{"eulerdamp": False}])
    if read_flag(model, "contact") and not collides(model):
        yield Lever("contact", [{"contact": False}])


def may_sleep(model: mujoco.MjModel) -> bool:
    """Return whether bodies of a model would be left alone at rest, which the model forbids now.

    Trees that are driven stay awake, and one that falls asleep alone is worth little.
    """
    if "sleep" not in FLAGS or read_flag(model, "sleep"):
        return False
    allowed = (mujoco.mjtSleepPolicy.mjSLEEP_AUTO_ALLOWED, mujoco.mjtSleepPolicy.mjSLEEP_ALLOWED)
    return bool(np.isin(model.tree_sleep_policy, [int(each) for each in allowed]).any())


def collides(model: mujoco.MjModel) -> bool:
    """Return whether any contact can be: of geoms, listed pairs or flexes."""
    return bool(filtered_pairs(model) or model.npair or model.nflex)


def _condim(model: mujoco.MjModel, least: int) -> Settings:
    """Return the geoms whose contacts have more dimensions, with so many."""
    return {
        f"geom_condim[{name_of(model, 'geom', int(geom))}]": least
        for geom in np.flatnonzero(model.geom_condim > least)
    }


def condim_alone(settings: Settings) -> list[Settings]:
    """Return the settings of each geom by itself, if there are several."""
    fields: list[Settings] = [
        {name: value} for name, value in settings.items() if name.startswith("geom_condim[")
    ]
    return fields if len(fields) > 1 else []
