"""Which effects are on in a run, and why; how the others are left out of its model."""

from collections.abc import Collection, Mapping

import mujoco

from contactlab.scene.effects.effect import (
    NOT_IN_MODEL,
    Effect,
    EffectRequest,
    EffectState,
    ModelFacts,
    RunState,
)
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.recording_sensors import PREFIX

_COMPILED = ("sensor", "tendon", "energy")


def choose(run: RunState, request: EffectRequest) -> dict[str, EffectState]:
    """Decide every effect of a run, into whose model its settings and request are written."""
    return {name: _choose(effect, run, request) for name, effect in EFFECTS.items()}


def leave_out(run: RunState, chosen: Mapping[str, EffectState]) -> None:
    """Turn off the effects that are not chosen in a run's model, in place."""
    # All are read before any is written: friction effects share condim.
    off = [each for name, each in EFFECTS.items() if not chosen[name].on and each.switch.is_on(run)]
    for effect in off:
        effect.switch.write(run.model, False)


def _choose(effect: Effect, run: RunState, request: EffectRequest) -> EffectState:
    on = effect.switch.is_on(run)
    if effect.name in request.requested:
        # A tendon that is left out may still be in the model, idle.
        requested = request.requested[effect.name] or effect.name not in _COMPILED
        return EffectState(on and requested, "as asked")
    if not on:
        return EffectState(on=False, reason=NOT_IN_MODEL)
    if not request.auto:
        return EffectState(on=True, reason="all that the model has is on")
    if set_here := sorted(request.changed.intersection(effect.switch.settings)):
        return EffectState(on=True, reason=f"the sweep sets {', '.join(set_here)}")
    proof = effect.unused(run)
    return EffectState(proof is None, proof or effect.called_by)


def left_uncompiled(facts: ModelFacts, request: EffectRequest) -> frozenset[str]:
    """Return the effects that a run's model is compiled without.

    Args:
        facts: of the whole model.
        request: the effects that the run requests.
    """
    requested, default = request.requested, not request.auto
    out: set[str] = set()
    if facts.sensors and not requested.get("sensor", default):
        out.add("sensor")
    read = facts.sensors and "sensor" not in out
    named = any(name.startswith("tendon_") for name in request.changed)
    spare = facts.tendons and facts.idle_tendons and not read and not named
    if spare and not requested.get("tendon", default):
        out.add("tendon")
    if not requested.get("energy", True):
        out.add("energy")
    return frozenset(out)


def remove(spec: mujoco.MjSpec, without: Collection[str]) -> None:
    """Delete sensors and tendons from a model's specification, before its run's own are added."""
    for sensor in list(spec.sensors) if "sensor" in without else ():
        if not sensor.name.startswith(PREFIX) and sensor.type != mujoco.mjtSensor.mjSENS_PLUGIN:
            spec.delete(sensor)
    for tendon in list(spec.tendons) if "tendon" in without else ():
        spec.delete(tendon)
