"""Which effects are on in a run, and why."""

from collections.abc import Mapping, MutableMapping

from contactlab.scene.effects.effect import (
    NOT_IN_MODEL,
    Effect,
    EffectRequest,
    EffectState,
    RunState,
)
from contactlab.scene.effects.table import COMPILED, EFFECTS
from contactlab.scene.engine_flags import FLAGS, write_flags

Settings = MutableMapping[str, object]
_INTEGRATOR = {False: "Euler", True: "implicitfast"}
_NOSLIP = 3


def choose(run: RunState, request: EffectRequest) -> dict[str, EffectState]:
    """Decide every effect of a run, whose settings and request are written into its model."""
    return {name: _choose(effect, run, request) for name, effect in EFFECTS.items()}


def leave_out(run: RunState, chosen: Mapping[str, EffectState]) -> None:
    """Write into a run's model, in place, that what is not chosen is off."""
    # What is on is read before anything is written: friction effects share their dimensions.
    off = [each for name, each in EFFECTS.items() if not chosen[name].on and each.is_on(run)]
    write_flags(run.model, {each.name: False for each in off if each.name in FLAGS})
    for effect in off:
        if effect.turn is not None and effect.name not in FLAGS:
            effect.turn(run.model, False)


def _choose(effect: Effect, run: RunState, request: EffectRequest) -> EffectState:
    on = effect.is_on(run)
    if effect.name in request.asked:
        # What is left out of such a model may still be in it, idle.
        return EffectState(
            on and (request.asked[effect.name] or effect.name not in COMPILED), "as asked"
        )
    if not on:
        return EffectState(False, NOT_IN_MODEL)
    if not request.auto:
        return EffectState(True, "all that the model has is on")
    if set_here := sorted(request.changed.intersection(effect.touches)):
        return EffectState(True, f"the sweep sets {', '.join(set_here)}")
    proof = effect.unused(run)
    return EffectState(proof is None, proof or effect.called_by)


def fold(name: str, *, on: bool, settings: Settings) -> bool:
    """Write an effect that is a matter of settings into them; say whether it is one.

    What is on already stays as it is.
    """
    writer = _FOLDED.get(name)
    if writer is not None:
        writer(settings, on)
    return writer is not None


def _fold_cone(settings: Settings, on: bool) -> None:
    settings["cone"] = "elliptic" if on else "pyramidal"


def _fold_noslip(settings: Settings, on: bool) -> None:
    present = settings["noslip_iterations"]
    settings["noslip_iterations"] = (present or _NOSLIP) if on else 0


def _fold_air(settings: Settings, on: bool) -> None:
    if not on:
        settings.update(density=0.0, viscosity=0.0, wind=(0.0, 0.0, 0.0))


def _fold_integrator(settings: Settings, on: bool) -> None:
    if (settings["integrator"] not in ("Euler", "RK4")) != on:
        settings["integrator"] = _INTEGRATOR[on]


_FOLDED = {
    "elliptic": _fold_cone,
    "noslip": _fold_noslip,
    "air": _fold_air,
    "implicit": _fold_integrator,
}
