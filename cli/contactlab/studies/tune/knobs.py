"""Settings that may make a model cheaper, and those of which its runs say nothing."""

from collections.abc import Collection, Iterator, Mapping

import numpy as np

from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.effects.proofs import RunState, no_damping
from contactlab.scene.parameters import WORDS
from contactlab.schema.coverage import Exercised, Feature
from contactlab.schema.setting_values import as_number
from contactlab.schema.study_reports import Kept
from contactlab.studies.effects.effect_toggles import find_toggles
from contactlab.studies.effects.effects_request import AblationSetup
from contactlab.studies.session import Values
from contactlab.studies.tune.search import Knob, Space
from contactlab.studies.tune.tune_request import SAVERS

INTEGRATORS = ("Euler", "implicitfast", "implicit", "RK4")
_LADDER = (1 / 8, 1 / 5, 1 / 4, 2 / 5, 1 / 2, 4 / 5, 1, 1.25, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10)
"""Timesteps that are tried, over that of the model."""
_FEWEST_STEPS = 50
_OPTIONS: Mapping[str, tuple[float, ...]] = {
    "iterations": (100, 20, 5),
    "tolerance": (1e-8, 1e-6, 1e-4),
    "ls_iterations": (50, 10),
    "noslip_iterations": (10, 3),
}
"""Values that cost less than those above (of iterations) or below (of tolerances) them."""
_SOFTER = (1.5, 2.0, 4.0)


def space_of(
    setup: AblationSetup, exercised: Exercised, free: Collection[str]
) -> tuple[Space, list[Kept]]:
    """Return what is searched for a model, and what is not, for want of a run that exercises it."""
    base = setup.scene.base({})
    written: dict[str, object] = {**base.settings, **base.flags, **setup.base}
    kept: list[Kept] = []
    knobs: list[Knob] = []
    for knob, features in _proposed(setup, base, written, free):
        if (lack := exercised.lack(features)) and knob.name not in free:
            reason = f"not tested: {lack}, or --free {knob.name}"
            kept.append(Kept(name=knob.name, reason=reason))
        elif knob.values:
            knobs.append(knob)
    names = {name for knob in knobs for value in knob.values for name in value}
    step = as_number(written["timestep"])
    longest = (setup.duration or setup.scene.duration) / _FEWEST_STEPS
    if lack := exercised.lack(["contact"]):
        longest = min(longest, _least_time_constant(base) / 2)
        kept.append(Kept(name="timestep", reason=f"at most {longest:g} s: not tested: {lack}"))
    steps = [step if factor == 1 else float(f"{factor * step:.6g}") for factor in _LADDER]
    space = Space(
        # An effect that may be left out is on.
        written={
            name: written.get(name, True) for name in ("timestep", "integrator", *sorted(names))
        },
        timesteps=tuple(length for length in steps if length <= max(step, longest)),
        integrators=integrators_of(base, str(written["integrator"])),
        knobs=tuple(knobs),
        first=() if written["solver"] == "Newton" else (Knob("solver", ({"solver": "Newton"},)),),
    )
    return space, kept


def integrators_of(base: CompiledScene, written: str) -> tuple[str, ...]:
    """Return the integrators to try, that of the model first.

    Where no force of joints depends on velocity, implicitfast takes the steps that Euler takes.
    """
    run = RunState(base.model, base.facts, straight=False)
    same = not base.model.nu and no_damping(run)
    others = (integrator for integrator in INTEGRATORS if not same or integrator != "implicitfast")
    return tuple(dict.fromkeys([written, *others]))


def _proposed(
    setup: AblationSetup, base: CompiledScene, written: Values, free: Collection[str]
) -> Iterator[tuple[Knob, list[Feature]]]:
    """Yield the knobs of a model, each with what runs must exercise to show what it does."""
    for name in ("solver", "jacobian"):
        others = [word for word in WORDS[name] if word not in (written[name], "auto")]
        yield Knob(name, tuple({name: word} for word in others)), []
    fewer = {
        name: tuple({name: value} for value in values if (value < own) != (name == "tolerance"))
        for name, values in _OPTIONS.items()
        for own in [as_number(written[name])]
    }
    fewer_noslip = fewer.pop("noslip_iterations")
    for name, values in fewer.items():
        yield Knob(name, values), []
    yield Knob("island", ({"island": not base.flags["island"]},)), []
    if not base.flags.get("sleep", True):
        yield Knob("sleep", (EFFECTS["sleep"].on,)), []
    for toggle in find_toggles(setup):
        if toggle.effect in SAVERS and toggle.on and not toggle.proof:
            feature = EFFECTS[toggle.effect].feature
            values = (toggle.values, *(fewer_noslip if toggle.effect == "noslip" else ()))
            yield Knob(toggle.effect, values), [feature] if feature else []
    solref = written.get("solref")
    if "solref" in free and isinstance(solref, tuple) and solref[0] > 0:
        softer = ((solref[0] * factor, solref[1]) for factor in _SOFTER)
        yield Knob("solref", tuple({"solref": setting} for setting in softer)), []


def _least_time_constant(base: CompiledScene) -> float:
    """Return the least time constant that contacts, limits or equalities have [s]; 0 if none."""
    model = base.model
    tables = (model.geom_solref, model.pair_solref, model.jnt_solref, model.eq_solref)
    constants = np.concatenate([np.asarray(table).reshape(-1, 2)[:, 0] for table in tables])
    return float(constants[constants > 0].min(initial=np.inf))
